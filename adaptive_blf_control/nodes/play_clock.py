# SPDX-License-Identifier: Apache-2.0
"""The pace of a player: waits for the time of each message and publishes /clock."""

from __future__ import annotations

import time

from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from adaptive_blf_control.messages.topics import CLOCK
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['PlayClock']

QUEUE_DEPTH = 10


class PlayClock:
    """Bag time against real time, from :meth:`begin` on.

    Attributes:
        ticks: Messages published on /clock.
    """

    def __init__(self, node: Node, frequency: float, rate: float | None, stop: StopFlag) -> None:
        """Make the topic.

        Args:
            node: The node that publishes.
            frequency: Ticks of /clock per bag second [Hz]; 0 for none.
            rate: Bag seconds per second; None where nothing waits for time (lockstep).
            stop: Ends every wait.
        """
        self.ticks = 0
        self._rate = rate
        self._stop = stop
        self._period_ns = round(1e9 / frequency) if frequency > 0.0 else 0
        self._publisher = node.create_publisher(Clock, CLOCK, QUEUE_DEPTH) if frequency else None
        self._message = Clock()
        self._begin_ns = self._first_ns = self._next_ns = 0

    def begin(self, first_ns: int) -> None:
        """Start: bag time ``first_ns`` is now."""
        self._begin_ns = time.monotonic_ns()
        self._first_ns = self._next_ns = first_ns

    def tick_until(self, bag_ns: int) -> None:
        """Publish the ticks up to a bag time, each when it is due."""
        while self._publisher is not None and self._next_ns <= bag_ns:
            if not self.wait_until(self._next_ns):
                return
            self._message.clock.sec, self._message.clock.nanosec = divmod(self._next_ns, 10**9)
            self._publisher.publish(self._message)
            self.ticks += 1
            self._next_ns += self._period_ns

    def wait_until(self, bag_ns: int) -> bool:
        """Wait for a bag time; False where the player was stopped."""
        ahead = 0.0
        if self._rate is not None:  # else time is what the answers make of it
            elapsed = time.monotonic_ns() - self._begin_ns
            ahead = (bag_ns - self._first_ns) / self._rate - elapsed
        return not (self._stop.wait(ahead * 1e-9) if ahead > 0.0 else self._stop.is_set())
