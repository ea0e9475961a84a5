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

__all__ = ['LARGEST_BATCH', 'LONGEST_WAIT', 'Channel', 'DirectChannel', 'Handler', 'PlainChannel',
           'PlainWait', 'Wait', 'new_channel', 'new_wait']

# Called with CDR and message info; False where the message could not be used.
Handler = Callable[[bytes, dict[str, int]], bool | None]
# A wait for data alone does not see a request to stop: it ends at least this often to look.
LONGEST_WAIT = 0.05  # s
LARGEST_BATCH = 1000  # messages taken at a time: a fast sender must not keep the watchdogs waiting


class Channel(Protocol):
    """A raw subscription and the messages that wait in it."""

    subscription: Subscription

    def take(self, handler: Handler, newest_only: bool = False) -> int:
        """Hand the waiting messages to ``handler``, oldest first, and return how many there were.

        Args:
            handler: Called with bytes and info.
            newest_only: Call it with the last message that it can use only.
        """
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

    def take(self, handler: Handler, newest_only: bool = False) -> int:
        """See :class:`Channel`."""
        messages: list[Message] = []
        while len(messages) < LARGEST_BATCH:
            message = take_message(self.subscription)
            if message is None:
                break
            messages.append(message)
        _handle(messages, handler, newest_only)
        return len(messages)


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

    def take(self, handler: Handler, newest_only: bool = False) -> int:
        """See :class:`Channel`."""
        messages = [self._waiting.popleft() for _ in range(len(self._waiting))]
        _handle(messages, handler, newest_only)
        return len(messages)


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


def _handle(messages: Sequence[Message], handler: Handler, newest_only: bool) -> None:
    if not newest_only:
        for message in messages:
            handler(*message)
        return
    for message in reversed(messages):  # others, e.g. a gripper, may send on the same topic
        if handler(*message) is not False:
            return
