# SPDX-License-Identifier: Apache-2.0
"""Raw subscriptions whose messages a loop takes itself, and the wait for them.

Two kinds with one behaviour: *direct*, where the messages wait in the middleware and one wait set
holds the data subscriptions alone; *plain*, where rclpy's executor queues them (for an rclpy whose
internals have changed).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Protocol

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from adaptive_blf_control.runtime.rclpy_internals import (
    DirectWait,
    Message,
    NoExecutor,
    take_message,
)

__all__ = ['LARGEST_BATCH', 'LONGEST_WAIT', 'Batch', 'Channel', 'DirectChannel', 'Handler',
           'PlainChannel', 'PlainWait', 'Wait', 'each_of', 'new_channel', 'new_wait', 'newest_of']

# Called with CDR and message info; False where the message could not be used.
Handler = Callable[[bytes, dict[str, int]], bool | None]
# Called with all messages that one wait has brought, oldest first.
Batch = Callable[[Sequence[Message]], None]
# A wait for data alone does not see a request to stop: it ends at least this often to look.
LONGEST_WAIT = 0.05  # s
LARGEST_BATCH = 1000  # messages taken at a time: a fast sender must not keep the watchdogs waiting


class Channel(Protocol):
    """A raw subscription and the messages that wait in it."""

    subscription: Subscription

    def messages(self) -> list[Message]:
        """Take the waiting messages, oldest first."""
        ...


class Wait(Protocol):
    """Waits for the channels of one loop."""

    def wait(self, timeout: float) -> None:
        """Return when there is something to do or ``timeout`` [s] has passed."""
        ...


class DirectChannel:
    """Messages wait in the middleware until they are taken, at most LARGEST_BATCH at a time."""

    def __init__(self, node: Node, message_type: type, topic: str, qos: QoSProfile) -> None:
        """Subscribe where no executor looks."""
        self.subscription = node.create_subscription(
            message_type, topic, lambda _: None, qos, callback_group=NoExecutor(), raw=True)

    def messages(self) -> list[Message]:
        """See :class:`Channel`."""
        messages: list[Message] = []
        while len(messages) < LARGEST_BATCH:
            message = take_message(self.subscription)
            if message is None:
                break
            messages.append(message)
        return messages


class PlainChannel:
    """The executor's callback only queues; the loop handles, as with :class:`DirectChannel`."""

    def __init__(self, node: Node, message_type: type, topic: str, qos: QoSProfile) -> None:
        """Subscribe as any node does."""
        self._waiting: deque[Message] = deque(maxlen=qos.depth)

        def keep(data: bytes, info: dict[str, int]) -> None:
            self._waiting.append((data, info))

        # rclpy hands over the info to callbacks with two arguments; its types know one.
        callback: Callable[..., None] = keep
        self.subscription = node.create_subscription(message_type, topic, callback, qos, raw=True)

    def messages(self) -> list[Message]:
        """See :class:`Channel`."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]


class PlainWait:
    """Serves whatever the executor has, data and requests alike, one at a time."""

    def __init__(self, serve: Callable[[float], None]) -> None:
        """Take what lets an executor serve once, within a time [s]."""
        self._serve = serve

    def wait(self, timeout: float) -> None:
        """Return after one callback of any kind, or when ``timeout`` [s] has passed."""
        self._serve(max(timeout, 0.0))


def new_channel(direct: bool, node: Node, message_type: type, topic: str,
                qos: QoSProfile) -> Channel:
    """Subscribe to raw CDR, directly or through the executor."""
    return (DirectChannel if direct else PlainChannel)(node, message_type, topic, qos)


def new_wait(direct: bool, node: Node, channels: Sequence[Channel],
             serve: Callable[[float], None]) -> Wait:
    """Return the wait for ``channels``; ``serve`` is that of :class:`PlainWait`."""
    if direct:
        return DirectWait([channel.subscription for channel in channels], node.context)
    return PlainWait(serve)


def each_of(handler: Handler) -> Batch:
    """Return what hands every message to ``handler``, oldest first."""
    def handle(messages: Sequence[Message]) -> None:
        for message in messages:
            handler(*message)
    return handle


def newest_of(handler: Handler) -> Batch:
    """Return what hands over the last message only that ``handler`` can use.

    Others, e.g. a gripper, may send on the same topic.
    """
    def handle(messages: Sequence[Message]) -> None:
        for message in reversed(messages):
            if handler(*message) is not False:
                return
    return handle
