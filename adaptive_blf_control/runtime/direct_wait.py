# SPDX-License-Identifier: Apache-2.0
"""Waiting on data subscriptions alone, and what else touches the inside of rclpy.

rclpy's executor builds a new wait set with every service, timer and guard of the node on each
pass. At 1 kHz that costs more than the control law. With :class:`DirectWait` one wait set holds
the data subscriptions; parameters, services and timers stay with an ordinary executor
in a second thread. :class:`PlainWait` does the same work with that executor alone, for
an rclpy whose inside has changed (parameter ``executor``).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
import functools
import time
from typing import Any, Protocol

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.lifecycle.node import LifecycleNodeMixin
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

try:
    from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
    DIRECT = hasattr(_rclpy, 'WaitSet')
    HandleGone: type[Exception] = getattr(_rclpy, 'InvalidHandle', RuntimeError)
except ImportError:
    DIRECT, HandleGone = False, RuntimeError

__all__ = ['DIRECT', 'MOST', 'DataGroup', 'DirectChannel', 'DirectWait', 'HandleGone',
           'PlainChannel', 'PlainWait', 'answer_transitions', 'end_transitions',
           'lifecycle_state', 'overrides_of', 'take_all', 'take_over_clock']

Message = tuple[bytes, dict[str, int]]
Handler = Callable[[bytes, dict[str, int]], bool | None]
MOST = 1000  # messages taken at a time: whoever sends faster must not keep the watchdogs waiting


class DataGroup(CallbackGroup):
    """A callback group whose entities no executor may take: :class:`DirectWait` does."""

    def can_execute(self, entity: object) -> bool:
        """Keep executors away."""
        return False

    def beginning_execution(self, entity: object) -> bool:
        """Keep executors away."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Nothing to end."""


class Channel(Protocol):
    """A raw subscription and the messages that wait in it."""

    subscription: Subscription

    def take(self, handler: Handler, newest_only: bool = False) -> int:
        """Hand every waiting message to ``handler``, oldest first, and return how many."""
        ...


class DirectChannel:
    """Messages wait in the middleware until they are taken."""

    def __init__(self, node: Node, message_type: type, topic: str, qos: QoSProfile) -> None:
        """Subscribe where no executor looks."""
        self.subscription = node.create_subscription(
            message_type, topic, lambda _: None, qos, callback_group=DataGroup(), raw=True)

    def take(self, handler: Handler, newest_only: bool = False) -> int:
        """See :class:`Channel`."""
        return take_all(self.subscription, handler, newest_only)


class PlainChannel:
    """The executor's callback only queues; the loop handles, as with :class:`DirectChannel`."""

    def __init__(self, node: Node, message_type: type, topic: str, qos: QoSProfile) -> None:
        """Subscribe as anybody would."""
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


class DirectWait:
    """Blocks until one of some subscriptions has data."""

    def __init__(self, subscriptions: Sequence[Subscription], context: Context) -> None:
        """Wait on ``subscriptions``; they belong to a :class:`DataGroup`."""
        self._handles = [subscription.handle for subscription in subscriptions]
        self._wait_set = _rclpy.WaitSet(len(self._handles), 0, 0, 0, 0, 0, context.handle)

    def wait(self, timeout: float) -> None:
        """Return when data is there or ``timeout`` [s] has passed."""
        if not self._handles:  # rcl refuses to wait on nothing
            time.sleep(max(timeout, 0.0))
            return
        self._wait_set.clear_entities()
        for handle in self._handles:
            self._wait_set.add_subscription(handle)
        self._wait_set.wait(max(int(timeout * 1e9), 0))


class PlainWait:
    """Serves whatever the executor has, data and requests alike, one at a time."""

    def __init__(self, serve: Callable[[float], None]) -> None:
        """Take what lets an executor serve once, within a time [s]."""
        self._serve = serve

    def wait(self, timeout: float) -> None:
        """Return after one callback of any kind, or when ``timeout`` [s] has passed."""
        self._serve(max(timeout, 0.0))


def take_over_clock(node: Node) -> None:
    """End the node's own subscription to /clock: whoever calls sets the time with each sample.

    rclpy serves it through the executor, for every step of a simulation that makes thousands in
    a second. Where its inside is another, it goes on as it is.
    """
    source = getattr(node, '_time_source', None)
    subscription = getattr(source, '_clock_sub', None)
    if source is not None and subscription is not None:
        node.destroy_subscription(subscription)
        source._clock_sub = None


def lifecycle_state(node: LifecycleNodeMixin) -> tuple[int, str]:
    """Return the present state: a constant of lifecycle_msgs/State and its name."""
    number, name = node._state_machine.current_state
    return int(number), str(name)


def end_transitions(node: LifecycleNodeMixin) -> None:
    """Give back the state machine, which rclpy's own ``destroy_node`` forgets.

    It holds the node: others would see it, and ask it, until the garbage is collected.
    """
    machine = getattr(node, '_state_machine', None)
    if machine is not None:  # None in a node that could not be made
        machine.destroy_when_not_in_use()


def answer_transitions(node: LifecycleNodeMixin, answer: Callable[..., Any]) -> None:
    """Let ``answer(rclpy's own answer, request, response)`` answer requests for a transition."""
    service = node._service_change_state
    service.callback = functools.partial(answer, service.callback)


def overrides_of(node: Node) -> Mapping[str, Parameter]:
    """Return the parameters given to a node, also to one that could not be made."""
    return getattr(node, '_parameter_overrides', {})


def take_all(subscription: Subscription, handler: Handler, newest_only: bool = False) -> int:
    """Take every waiting message, oldest first, as CDR bytes with its info.

    Args:
        subscription: A raw subscription of a :class:`DataGroup`.
        handler: Called with bytes and info.
        newest_only: Call it with the last message that it can use only.

    Returns:
        How many messages were taken, at most ``MOST``.
    """
    messages: list[Message] = []
    while len(messages) < MOST:
        message = subscription.handle.take_message(subscription.msg_type, True)
        if message is None:
            break
        messages.append(message)
    _handle(messages, handler, newest_only)
    return len(messages)


def _handle(messages: Sequence[Message], handler: Handler, newest_only: bool) -> None:
    if not newest_only:
        for message in messages:
            handler(*message)
        return
    for message in reversed(messages):  # others, e.g. a gripper, may send on the same topic
        if handler(*message) is not False:
            return
