# SPDX-License-Identifier: Apache-2.0
"""The messages that answer a state, known by its stamp, and the wait for them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
import time
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from adaptive_blf_control.errors import BagError, BlfError
from adaptive_blf_control.messages.stamp import stamp_of
from adaptive_blf_control.runtime.channels import (
    Channel,
    each_of,
    LONGEST_WAIT,
    new_channel,
    new_wait,
    Wait,
)
from adaptive_blf_control.runtime.data_topics import QUEUE_DEPTH
from adaptive_blf_control.runtime.endpoints import POLL_PERIOD
from adaptive_blf_control.runtime.message_class import message_class
from adaptive_blf_control.runtime.rclpy_internals import DIRECT
from adaptive_blf_control.runtime.request_server import RequestServer
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['Answers', 'NoAnswer']


class NoAnswer(BlfError, TimeoutError):
    """A state was not answered in time.

    Attributes:
        topic: Topic without a publisher, a subscription or an answer.
        stamp_ns: Stamp of the state [ns]; None where none was sent yet.
    """

    def __init__(self, topic: str, stamp_ns: int | None, what: str) -> None:
        super().__init__(f'{topic}: {what}: is the identifier running with the same joint names '
                         'and namespace?')
        self.topic = topic
        self.stamp_ns = stamp_ns


class Answers:
    """Topics on which a state is answered by a message of the same stamp.

    Attributes:
        topics: Their names.
        stop: Set it to end every wait.
    """

    def __init__(self, node: Node, topics: Sequence[str], stop: StopFlag) -> None:
        """Subscribe to nothing yet: see :meth:`discover`."""
        self.topics = tuple(topics)
        self.stop = stop
        self._node = node
        self._channels: dict[str, Channel] = {}
        self._heard: dict[str, set[int | None]] = {}
        self._wait: Wait | None = None
        self._requests = RequestServer(node, stop, lambda text: node.get_logger().error(text))

    def discover(self, timeout: float) -> None:
        """Subscribe to each topic once it has a publisher, with the type of that publisher.

        Calling it again does nothing.

        Raises:
            NoAnswer: a topic has no publisher within ``timeout`` [s].
            BagError: its type is not installed here, or has no header.
        """
        give_up = time.monotonic() + timeout
        if self._wait is not None:
            return
        for topic in self.topics:
            while topic not in self._channels and not self.stop.is_set():
                if found := self._node.get_publishers_info_by_topic(topic):
                    self._subscribe(topic, found[0].topic_type, found)
                else:
                    self._pause(topic, timeout, give_up)
        for topic, channel in self._channels.items():
            while channel.subscription.get_publisher_count() == 0 and not self.stop.is_set():
                self._pause(topic, timeout, give_up)
        if not self.stop.is_set():
            self._wait = new_wait(DIRECT, self._node, list(self._channels.values()),
                                  self._requests.serve_once)

    def _pause(self, topic: str, timeout: float, give_up: float) -> None:
        if time.monotonic() >= give_up:
            raise NoAnswer(topic, None, f'nobody publishes it within {timeout:g} s')
        self.stop.wait(POLL_PERIOD)

    def _subscribe(self, topic: str, type_name: str, publishers: Sequence[Any]) -> None:
        kind = message_class(type_name)
        fields = list(kind.get_fields_and_field_types().values())
        if fields[:1] != ['std_msgs/Header']:
            raise BagError(f'{topic} has type {type_name!r}: expected one that begins with a '
                           'header, whose stamp tells which state it answers')
        qos = QoSProfile(depth=QUEUE_DEPTH)
        if any(publisher.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
               for publisher in publishers):
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        self._heard[topic] = set()
        self._channels[topic] = new_channel(DIRECT, self._node, kind, topic, qos)

    def forget(self) -> None:
        """Forget earlier answers, e.g. to the same stamp."""
        self._take()
        for stamps in self._heard.values():
            stamps.clear()

    def wait(self, stamp_ns: int, timeout: float) -> list[str]:
        """Wait at most ``timeout`` [s]; return the topics that have not answered ``stamp_ns``."""
        give_up = time.monotonic() + timeout
        while True:
            self._take()
            missing = [topic for topic, stamps in self._heard.items() if stamp_ns not in stamps]
            left = give_up - time.monotonic()
            if not missing or left <= 0.0 or self._wait is None or self.stop.is_set():
                return missing
            self._wait.wait(min(left, LONGEST_WAIT))

    def _take(self) -> None:
        for topic, channel in self._channels.items():
            each_of(partial(_note, self._heard[topic]))(channel.messages())


def _note(stamps: set[int | None], data: bytes, _: dict[str, int]) -> None:
    stamps.add(stamp_of(data))
