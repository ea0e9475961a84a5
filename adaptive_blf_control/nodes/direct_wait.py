# SPDX-License-Identifier: Apache-2.0
"""Waiting on data subscriptions alone: the only module that touches the inside of rclpy.

rclpy's executor builds a new wait set with every service, timer and guard of the node on each
pass. At 1 kHz that costs more than the control law. Here one wait set holds the data
subscriptions; parameters, services, timers and diagnostics stay with an ordinary executor in a
second thread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.subscription import Subscription

__all__ = ['DataGroup', 'DirectWait', 'take_all']


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


def take_all(subscription: Subscription, handler: Callable[[bytes, dict[str, int]], None],
             newest_only: bool = False) -> int:
    """Take every waiting message, oldest first, as CDR bytes with its info.

    Args:
        subscription: A raw subscription of a :class:`DataGroup`.
        handler: Called with bytes and info.
        newest_only: Call it with the last message only.

    Returns:
        How many messages were taken.
    """
    taken = 0
    newest = None
    while True:
        message = subscription.handle.take_message(subscription.msg_type, True)
        if message is None:
            break
        taken += 1
        newest = message
        if not newest_only:
            handler(*message)
    if newest_only and newest is not None:
        handler(*newest)
    return taken
