# SPDX-License-Identifier: Apache-2.0
"""Waiting on data subscriptions alone: order, bytes, deadlines, and no executor in between."""

from __future__ import annotations

import time

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32

from adaptive_blf_control.messages.cdr import decode_int32, encode_int32
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.runtime.channels import DirectChannel, newest_of
from adaptive_blf_control.runtime.rclpy_internals import DirectWait
from patience import PATIENCE


def _pair(graph, wait_until, topic: str = 'number'):
    """Return a node with a channel, and a matched publisher."""
    node = graph.add(Node('taker', context=graph.context))
    channel = DirectChannel(node, Int32, topic, QoSProfile(depth=100))
    publisher = graph.peer().create_publisher(Int32, topic, 100)
    wait_until(lambda: publisher.get_subscription_count() == 1, what='the match')
    return node, channel, publisher


def _wait_for_data(waiter: DirectWait) -> float:
    begin = time.monotonic()
    waiter.wait(PATIENCE)
    return time.monotonic() - begin


def test_a_message_ends_the_wait_long_before_its_limit(graph, wait_until) -> None:
    _, channel, publisher = _pair(graph, wait_until)
    waiter = DirectWait([channel.subscription], graph.context)
    publisher.publish(Int32(data=7))
    assert _wait_for_data(waiter) < 0.5 * PATIENCE
    assert [data for data, _ in channel.messages()] == [encode_int32(7)]


def test_without_data_the_wait_ends_at_its_limit(graph, wait_until) -> None:
    _, channel, _ = _pair(graph, wait_until)
    waiter = DirectWait([channel.subscription], graph.context)
    begin = time.monotonic()
    waiter.wait(0.05)
    assert 0.045 <= time.monotonic() - begin < 5.0
    assert channel.messages() == []


def test_a_negative_limit_does_not_block_forever(graph, wait_until) -> None:
    _, channel, _ = _pair(graph, wait_until)
    begin = time.monotonic()
    DirectWait([channel.subscription], graph.context).wait(-1.0)
    assert time.monotonic() - begin < 5.0


def test_every_message_is_taken_in_order_with_its_times(graph, wait_until) -> None:
    _, channel, publisher = _pair(graph, wait_until)
    for number in range(20):
        publisher.publish(Int32(data=number))
    taken: list[tuple[bytes, dict[str, int]]] = []

    def all_taken() -> bool:
        taken.extend(channel.messages())
        return len(taken) >= 20
    wait_until(all_taken, what='20 messages')
    assert [decode_int32(data) for data, _ in taken] == list(range(20))
    sent = [info['source_timestamp'] for _, info in taken]
    assert sent == sorted(sent)
    assert all(0 < info['source_timestamp'] <= info['received_timestamp'] for _, info in taken)
    numbers = [info['publication_sequence_number'] for _, info in taken]
    assert numbers == list(range(numbers[0], numbers[0] + 20))


def test_newest_only_hands_over_the_last_of_a_backlog_and_counts_all(graph, wait_until) -> None:
    _, channel, publisher = _pair(graph, wait_until)
    peer = graph.peer()
    echo = peer.listen(Int32, 'number')
    wait_until(lambda: publisher.get_subscription_count() == 2)
    for number in range(10):
        publisher.publish(Int32(data=number))
    wait_until(lambda: len(echo) == 10, what='the backlog')
    handled: list[int] = []
    messages = channel.messages()
    newest_of(lambda data, info: handled.append(decode_int32(data)))(messages)
    assert (len(messages), handled) == (10, [9])


def test_any_of_several_subscriptions_ends_the_wait(graph, wait_until) -> None:
    node, first, _ = _pair(graph, wait_until)
    second = DirectChannel(node, Int32, 'other', QoSProfile(depth=10))
    publisher = graph.peer().create_publisher(Int32, 'other', 10)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    waiter = DirectWait([first.subscription, second.subscription], graph.context)
    publisher.publish(Int32(data=1))
    assert _wait_for_data(waiter) < 0.5 * PATIENCE
    assert (len(first.messages()), len(second.messages())) == (0, 1)


def test_an_executor_leaves_a_channel_alone(graph, wait_until) -> None:
    node, channel, publisher = _pair(graph, wait_until)
    ticks: list[int] = []
    node.create_timer(0.01, lambda: ticks.append(1))
    executor = SingleThreadedExecutor(context=graph.context)
    executor.add_node(node)
    publisher.publish(Int32(data=3))
    DirectWait([channel.subscription], graph.context).wait(PATIENCE)
    while len(ticks) < 3:  # the executor works, and has passed the message by
        executor.spin_once(timeout_sec=1.0)
    executor.shutdown()
    assert len(channel.messages()) == 1


def test_a_node_ends_when_its_context_is_shut_down(graph, wait_until) -> None:
    node = graph.make(ArmDriver)
    states = graph.peer().listen(JointState, 'joint_states')
    runner = graph.run(node)
    wait_until(lambda: len(states) > 5)
    graph.context.shutdown()
    assert runner.join() == 0


def test_waiting_on_nothing_takes_the_time_it_was_given(graph) -> None:
    begin = time.monotonic()
    DirectWait([], graph.context).wait(0.02)
    assert 0.015 < time.monotonic() - begin < 5.0
