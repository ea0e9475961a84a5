# SPDX-License-Identifier: Apache-2.0
"""Order in which the loop handles what has arrived, and what it passes over."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')

from rclpy.node import Node
from std_msgs.msg import Int32

from adaptive_blf_control.messages.cdr import decode_int32
from adaptive_blf_control.messages.topics import published_by
from adaptive_blf_control.runtime.data_topics import DataTopics
from adaptive_blf_control.runtime.loop_statistics import LoopStatistics


@pytest.fixture
def node(graph) -> Node:
    """Return a plain node."""
    return graph.add(Node('node', context=graph.context))


def _topics(node: Node, lockstep: bool = False) -> DataTopics:
    return DataTopics(node, LoopStatistics(), lambda _: None, direct=True, lockstep=lockstep)


class _Senders:
    """Publishes numbers to two topics and waits until both have arrived at a listener."""

    def __init__(self, graph, wait_until, topics: DataTopics) -> None:
        peer = graph.peer()
        self._heard = {name: peer.listen(Int32, name) for name in ('first', 'second')}
        self._publishers = {name: peer.create_publisher(Int32, name, 100) for name in self._heard}
        self._wait_until = wait_until
        wait_until(lambda: all(publisher.get_subscription_count() == 2
                               for publisher in self._publishers.values()))

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


def test_an_ended_subscription_is_given_back_with_the_next_wait(node) -> None:
    topics = _topics(node)
    subscription = topics.subscribe(Int32, 'first', lambda *_: None)
    topics.ready()
    topics.unsubscribe(subscription)
    assert (len(topics), topics.leaving) == (0, 1)
    topics.ready()
    assert topics.leaving == 0
    assert node.count_subscribers('first') == 0
