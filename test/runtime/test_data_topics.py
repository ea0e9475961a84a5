# SPDX-License-Identifier: Apache-2.0
"""Order in which the loop handles what has arrived, and what it passes over."""

from __future__ import annotations

import time

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Int32

from adaptive_blf_control.messages.cdr import decode_int32
from adaptive_blf_control.messages.topics import published_by
from adaptive_blf_control.runtime.data_topics import DataTopics
from adaptive_blf_control.runtime.loop_statistics import LoopStatistics
from patience import PATIENCE


@pytest.fixture
def node(graph) -> Node:
    """Return a plain node."""
    return graph.add(Node('node', context=graph.context))


def _topics(node: Node, lockstep: bool = False) -> DataTopics:
    return DataTopics(node, LoopStatistics(), lambda _: None, direct=True, lockstep=lockstep)


class _Senders:
    """Publishes numbers to two topics and waits until both have arrived at a listener."""

    def __init__(self, graph, wait_until, topics: DataTopics, first: int = 2,
                 second: int = 2) -> None:
        peer = graph.peer()
        self._heard = {name: peer.listen(Int32, name) for name in ('first', 'second')}
        self._publishers = {name: peer.create_publisher(Int32, name, 100) for name in self._heard}
        self._wait_until = wait_until
        wait_until(lambda: [publisher.get_subscription_count()
                            for publisher in self._publishers.values()] == [first, second])

    def send(self, **numbers: list[int]) -> None:
        for name, values in numbers.items():
            heard = self._heard[name]
            end = len(heard) + len(values)
            for value in values:
                self._publishers[name].publish(Int32(data=value))
            self._wait_until(lambda heard=heard, end=end: len(heard) == end)


def test_topics_that_do_not_wake_the_loop_are_handled_first(graph, wait_until, node) -> None:
    topics, order = _topics(node), []
    topics.subscribe(Int32, 'first', lambda data, _: order.append(decode_int32(data)),
                     reliable=True)
    topics.subscribe(Int32, 'second', lambda data, _: order.append(decode_int32(data)), wake=False,
                     reliable=True)
    _Senders(graph, wait_until, topics).send(first=[1, 2], second=[3])

    def all_handled() -> bool:
        topics.handle()
        return len(order) >= 3

    wait_until(all_handled)
    assert order == [3, 1, 2]


@pytest.mark.parametrize(('lockstep', 'expected'), [(True, [7]), (False, [])])
def test_in_lockstep_alone_a_message_can_be_put_off(node, lockstep, expected) -> None:
    topics, seen = _topics(node, lockstep), []
    topics.later(lambda: seen.append(7))
    assert seen == []
    topics.handle()
    topics.handle()
    assert seen == expected


def test_a_kind_of_node_has_a_publisher_for_each_topic_that_is_declared_for_it(node) -> None:
    topics = _topics(node)
    made = topics.declared('identifier')
    assert {name: publisher.topic_name.lstrip('/') for name, publisher in made.items()} == {
        topic.name: topic.name for topic in published_by('identifier')}
    for publisher in list(made.values()):
        topics.end_publisher(publisher)
    assert topics.publishers == []


@pytest.mark.parametrize('direct', [True, False])
def test_a_message_between_the_look_and_the_wait_is_not_slept_over(
        graph, wait_until, node, direct) -> None:
    executor = SingleThreadedExecutor(context=graph.context)
    executor.add_node(node)
    topics = DataTopics(node, LoopStatistics(), lambda timeout: executor.spin_once(timeout),
                        direct=direct, lockstep=False)
    seen: list[int] = []
    topics.subscribe(Int32, 'first', lambda data, _: seen.append(decode_int32(data)),
                     reliable=True)
    senders = _Senders(graph, wait_until, topics, second=1)
    for number in range(5):
        topics.handle()  # the look: nothing is there
        wait = topics.ready()
        senders.send(first=[number])  # has arrived at the host when it returns
        begin = time.monotonic()
        while len(seen) <= number:
            wait.wait(PATIENCE)
            topics.handle()
        assert time.monotonic() - begin < 0.5 * PATIENCE
    assert seen == list(range(5))
    executor.shutdown()


def test_a_message_that_comes_while_another_is_handled_is_not_slept_over(
        graph, wait_until, node) -> None:
    topics, seen = _topics(node), []

    def handle(data: bytes, _: object) -> None:
        seen.append(decode_int32(data))
        if len(seen) < 5:
            senders.send(first=[len(seen)])

    topics.subscribe(Int32, 'first', handle, newest_only=True, reliable=True)
    senders = _Senders(graph, wait_until, topics, second=1)
    senders.send(first=[0])
    begin = time.monotonic()
    while len(seen) < 5:
        topics.ready().wait(PATIENCE)
        topics.handle()
    assert time.monotonic() - begin < 0.5 * PATIENCE
    assert seen == list(range(5))


def test_an_ended_subscription_is_given_back_with_the_next_wait(node) -> None:
    topics = _topics(node)
    subscription = topics.subscribe(Int32, 'first', lambda *_: None)
    topics.ready()
    topics.unsubscribe(subscription)
    assert (len(topics), topics.leaving) == (0, 1)
    topics.ready()
    assert topics.leaving == 0
    assert node.count_subscribers('first') == 0
