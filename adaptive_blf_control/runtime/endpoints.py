# SPDX-License-Identifier: Apache-2.0
"""Which nodes publish or subscribe to a topic, also while the graph does not know their names.

DDS discovers an endpoint before ROS announces, on ``ros_discovery_info``, the node that it belongs
to, so for some tens of milliseconds the graph shows it under a placeholder. The endpoint of a
program that uses DDS without ROS keeps the placeholder.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time

from rclpy.topic_endpoint_info import TopicEndpointInfo

from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['NAME_TIMEOUT', 'POLL_PERIOD', 'UNNAMED', 'Endpoints', 'full_name', 'process_of']

NAME_TIMEOUT = 3.0  # s after which an endpoint without a name is taken for one without ROS
UNNAMED = 'a program without a node name'
POLL_PERIOD = 0.01  # s between looks at the graph: discovery is no event that can be waited for
_PARTICIPANT = 12  # bytes of a DDS GUID that name the participant; the others the endpoint
_PLACEHOLDER = '_NODE_NAME_UNKNOWN_'  # as in every rmw implementation of ROS 2


def full_name(info: TopicEndpointInfo) -> str | None:
    """Return the name of an endpoint's node with its namespace; None while it is not known."""
    if info.node_name == _PLACEHOLDER:
        return None
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def process_of(info: TopicEndpointInfo) -> tuple[int, ...]:
    """Return what the endpoints of one ROS context have in common: the DDS participant."""
    return tuple(info.endpoint_gid[:_PARTICIPANT])


class Endpoints:
    """The publishers, or the subscriptions, of one topic."""

    def __init__(self, query: Callable[[], Sequence[TopicEndpointInfo]]) -> None:
        """Look at the graph through ``query``, e.g. a node's get_publishers_info_by_topic."""
        self._query = query
        self._unnamed_since: dict[tuple[int, ...], float] = {}  # by gid, monotonic [s]

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._query())

    def names(self) -> list[str | None]:
        """Return the full name of each endpoint's node.

        None where the name may still come; UNNAMED where it has not come within NAME_TIMEOUT.
        """
        now, before = time.monotonic(), self._unnamed_since
        self._unnamed_since = {}
        names: list[str | None] = []
        for info in self._query():
            name = full_name(info)
            if name is None:
                gid = tuple(info.endpoint_gid)
                since = self._unnamed_since[gid] = before.get(gid, now)
                name = UNNAMED if now - since >= NAME_TIMEOUT else None
            names.append(name)
        return names

    def wait_for_names(self, stop: StopFlag) -> list[str]:
        """Return the names once all are known, at the latest after NAME_TIMEOUT or on ``stop``."""
        give_up = time.monotonic() + NAME_TIMEOUT
        while True:
            names = self.names()
            if None not in names or time.monotonic() >= give_up or stop.wait(POLL_PERIOD):
                return [name or UNNAMED for name in names]
