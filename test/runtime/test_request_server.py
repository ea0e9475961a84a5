# SPDX-License-Identifier: Apache-2.0
"""Requests are served beside the loop, whatever one of them raises."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')

from rclpy.node import Node
from std_srvs.srv import Trigger

from adaptive_blf_control.runtime.request_server import RequestServer
from adaptive_blf_control.runtime.stop_flag import StopFlag


class _Served:
    """A node with two services, one of which raises."""

    def __init__(self, graph) -> None:
        self.node = graph.add(Node('served', context=graph.context))
        self.failures: list[str] = []
        self.stop = StopFlag()
        self.server = RequestServer(self.node, self.stop, self.failures.append)
        self.node.create_service(Trigger, 'good', self._good)
        self.node.create_service(Trigger, 'bad', self._bad)

    @staticmethod
    def _good(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        return response

    @staticmethod
    def _bad(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        raise ValueError('of no use')


@pytest.fixture
def served(graph) -> Iterator[_Served]:
    """Return a node that is not served yet."""
    served = _Served(graph)
    yield served
    served.stop.set()
    served.server.close()


def test_a_request_that_raises_takes_no_service_away(graph, served, wait_until) -> None:
    served.server.start()
    peer = graph.peer()
    bad = peer.create_client(Trigger, 'bad')
    wait_until(bad.service_is_ready)
    bad.call_async(Trigger.Request())
    wait_until(lambda: served.failures)
    assert served.failures == ['ValueError: of no use']
    assert peer.call(Trigger, 'good').success


def test_without_a_thread_each_call_serves_one_request(graph, served, wait_until) -> None:
    client = graph.peer().create_client(Trigger, 'good')
    wait_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())

    def answered() -> bool:
        served.server.serve_once(0.05)
        return future.done()

    wait_until(answered)
    assert future.result().success
