# SPDX-License-Identifier: Apache-2.0
"""The one module that relies on what rclpy does not document, checked with rclpy 7.1 (Jazzy).

With a newer rclpy this is the place to look. :data:`DIRECT` is False where the wait set is
missing: the nodes then run on rclpy's own executor (parameter ``executor: plain``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import functools
import inspect
import os
import sys
import time
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.lifecycle.node import LifecycleNodeMixin
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription

try:
    from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
    DIRECT = hasattr(_rclpy, 'WaitSet')
    HandleGone: type[Exception] = getattr(_rclpy, 'InvalidHandle', RuntimeError)
except ImportError:
    DIRECT, HandleGone = False, RuntimeError

__all__ = ['DIRECT', 'DirectWait', 'HandleGone', 'Message', 'NoExecutor', 'answer_transitions',
           'end_transitions', 'know_callers_of_loggers', 'lifecycle_state', 'overrides_of',
           'take_message', 'take_over_clock']

Message = tuple[bytes, dict[str, int]]  # CDR, and the message info of rmw


class NoExecutor(CallbackGroup):
    """A callback group whose entities no executor takes: :class:`DirectWait` waits for them."""

    def can_execute(self, entity: object) -> bool:
        """Keep executors away."""
        return False

    def beginning_execution(self, entity: object) -> bool:
        """Keep executors away."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Nothing to end."""


class DirectWait:
    """A wait set that holds some subscriptions and nothing else.

    rclpy's executor builds a new wait set with every service, timer and guard condition of the
    node on each pass. At 1 kHz that costs more than the control law.
    """

    def __init__(self, subscriptions: Sequence[Subscription], context: Context) -> None:
        """Wait for ``subscriptions``, which belong to :class:`NoExecutor`."""
        self._handles = [subscription.handle for subscription in subscriptions]
        self._wait_set = _rclpy.WaitSet(len(self._handles), 0, 0, 0, 0, 0, context.handle)

    def wait(self, timeout: float) -> None:
        """Return when one of them has data or ``timeout`` [s] has passed."""
        if not self._handles:  # rcl refuses to wait for nothing
            time.sleep(max(timeout, 0.0))
            return
        self._wait_set.clear_entities()
        for handle in self._handles:
            self._wait_set.add_subscription(handle)
        self._wait_set.wait(max(int(timeout * 1e9), 0))


def take_message(subscription: Subscription) -> Message | None:
    """Take the oldest waiting message of a raw subscription; None where none waits."""
    message: Message | None = subscription.handle.take_message(subscription.msg_type, True)
    return message


def take_over_clock(node: Node) -> None:
    """End the node's subscription to /clock, so that the caller sets the time of its clock.

    rclpy serves that subscription through the executor, for every step of a simulation that makes
    thousands in a second. An rclpy without these attributes keeps its subscription, which costs
    time and changes nothing else.
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

    It holds the node: other nodes would see it, and call its services, until the garbage is
    collected.
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


def know_callers_of_loggers() -> None:
    """Tell inspect where the modules are that log.

    rclpy's logger asks inspect for its caller, which at first looks for the file of every module
    that is loaded: 50 to 200 ms, not to be spent in a control cycle, nor at the start.
    """
    known: dict[str, str] = getattr(inspect, 'modulesbyfile', {})
    for name, module in list(sys.modules.items()):
        file = getattr(module, '__file__', None)
        if file and name.partition('.')[0] in ('adaptive_blf_control', 'rclpy'):
            known.setdefault(os.path.abspath(file), name)
    inspect.getframeinfo(sys._getframe())
