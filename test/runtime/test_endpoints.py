# SPDX-License-Identifier: Apache-2.0
"""Names of the nodes behind a topic, before and after the graph knows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
import time

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here: there is no graph')

from rclpy.context import Context
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import String

from adaptive_blf_control.runtime import endpoints
from adaptive_blf_control.runtime.endpoints import Endpoints, full_name, UNNAMED
from adaptive_blf_control.runtime.stop_flag import StopFlag
from patience import PATIENCE

TRIES = 100


def _info(name: str = '_NODE_NAME_UNKNOWN_', gid: int = 1) -> TopicEndpointInfo:
    namespace = '_NODE_NAMESPACE_UNKNOWN_' if name.startswith('_') else '/arm'
    return TopicEndpointInfo(node_name=name, node_namespace=namespace, endpoint_gid=[gid, 0])


@pytest.fixture
def newcomer(graph) -> Iterator[Callable[[str], None]]:
    """Return ``newcomer(topic)``: a participant publishes the topic; the one before it ends."""
    running: list[tuple[Context, Node]] = []

    def end() -> None:
        for context, node in running:
            node.destroy_node()
            context.try_shutdown()
        running.clear()

    def start(topic: str) -> None:
        end()
        context = Context()
        context.init(domain_id=graph.context.get_domain_id())
        node = Node('newcomer', context=context, namespace='/arm', enable_rosout=False,
                    start_parameter_services=False)
        running.append((context, node))
        node.create_publisher(String, topic, 1)

    yield start
    end()


def test_a_node_that_the_graph_does_not_know_yet_has_no_name_until_it_has_its_own(
        monkeypatch, graph, newcomer) -> None:
    monkeypatch.setattr(endpoints, 'NAME_TIMEOUT', PATIENCE)
    observer = graph.add(Node('observer', context=graph.context))
    for attempt in range(TRIES):
        # A topic of its own: DDS may show a participant that ends at once for a long time.
        topic = f'/topic_{attempt}'
        publishers = Endpoints(partial(observer.get_publishers_info_by_topic, topic))
        newcomer(topic)
        first: list[str | None] = []
        give_up = time.monotonic() + PATIENCE
        while not first and time.monotonic() < give_up:  # no pause: the moment is short
            first = publishers.names()
        assert publishers.wait_for_names(StopFlag()) == ['/arm/newcomer']
        if first == [None]:
            return
        assert first == ['/arm/newcomer']
    pytest.fail(f'DDS was never ahead of the name in {TRIES} tries')


def test_an_endpoint_that_stays_without_a_name_is_taken_for_a_program_without_ros(
        monkeypatch) -> None:
    monkeypatch.setattr(endpoints, 'NAME_TIMEOUT', 0.05)
    seen = Endpoints(lambda: [_info(), _info('driver', 2)])
    assert seen.names() == [None, '/arm/driver']
    assert seen.wait_for_names(StopFlag()) == [UNNAMED, '/arm/driver']
    assert seen.names() == [UNNAMED, '/arm/driver']


def test_the_time_without_a_name_is_that_of_the_endpoint_and_not_of_the_topic(
        monkeypatch) -> None:
    present = [_info(gid=1)]
    seen = Endpoints(lambda: present)
    assert seen.names() == [None]
    monkeypatch.setattr(endpoints, 'NAME_TIMEOUT', 0.0)
    assert seen.names() == [UNNAMED]
    monkeypatch.undo()
    present[:] = [_info(gid=2)]
    assert seen.names() == [None]


def test_a_request_to_stop_ends_the_wait_for_names() -> None:
    stop = StopFlag()
    stop.set()
    looks = []

    def query() -> list[TopicEndpointInfo]:
        looks.append(1)
        return [_info()]

    assert Endpoints(query).wait_for_names(stop) == [UNNAMED]
    assert len(looks) == 1


@pytest.mark.parametrize(('namespace', 'expected'), [('/', '/driver'), ('/left', '/left/driver')])
def test_a_full_name_has_its_namespace_once(namespace: str, expected: str) -> None:
    assert full_name(TopicEndpointInfo(node_name='driver', node_namespace=namespace)) == expected
