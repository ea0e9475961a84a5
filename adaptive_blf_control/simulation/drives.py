# SPDX-License-Identifier: Apache-2.0
"""The drives of a simulated arm in real time: brakes, the torque held, watchdog, ramp to zero.

The arm moves with the clock: a command acts from the moment it arrives, so the delay of the loop
is in the simulation. Until the first command the brakes hold the arm and nothing is measured.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.parameters.table import broadcast
from adaptive_blf_control.simulation.plant import Plant
from adaptive_blf_control.simulation.settings import WatchdogSettings

__all__ = ['Drives', 'Effort']


class Effort(NamedTuple):
    """What the drives did over an interval.

    Attributes:
        torque: Mean torque, shape (n,) [N·m]; NaN while the brakes hold.
        interval: Its length [s]; 0 where there is none.
    """

    torque: np.ndarray
    interval: float


class Drives:
    """Moves a plant with the clock under the commands that it is given; times in ns, of one clock.

    Attributes:
        plant: What is driven.
        released: Whether a first command has released the brakes.
        timed_out: Whether the watchdog acts, for want of commands.
        begun_ns: When the brakes were released.
        sampled_ns: Time of the last sample.
        watchdog: What is done when commands stay away; looked at with every sample.
        ramp_time: Time from the torque at the begin of a ramp to zero [s]; likewise.
    """

    def __init__(self, plant: Plant, watchdog: WatchdogSettings, ramp_time: float) -> None:
        """Take the plant, held by its brakes."""
        self.plant, self.watchdog, self.ramp_time = plant, watchdog, ramp_time
        self.released = self.timed_out = False
        self.begun_ns = self.sampled_ns = self._moved_ns = 0
        self._nothing = np.full_like(plant.torque, np.nan)
        self._impulse = np.zeros_like(plant.torque)  # ∫ τ dt since the last sample [N·m·s]
        self._ramp: tuple[np.ndarray, int] | None = None

    def begin(self, now_ns: int) -> None:
        """Note that the clock runs from ``now_ns`` on."""
        self.sampled_ns = self._moved_ns = now_ns

    def command(self, torque: np.ndarray, now_ns: int, longest_ns: int) -> bool:
        """Apply a torque, shape (n,) [N·m], from ``now_ns`` on; True where it releases the brakes.

        Args:
            torque: Finite values.
            now_ns: When it arrived.
            longest_ns: Longest step of the integration up to then.
        """
        releases = not self.released
        if releases:
            self.released = True
            self.begun_ns = self._moved_ns = now_ns
        self._move_to(now_ns, longest_ns)
        self.timed_out = False
        self.plant.apply(torque)
        return releases

    def step(self, torque: np.ndarray, interval: float) -> None:
        """Apply a torque, shape (n,) [N·m], for an ``interval`` [s]: where no clock runs."""
        self.released = True
        self.plant.apply(torque)
        self.plant.advance(interval)

    def sample(self, due_ns: int, longest_ns: int, silent: bool) -> Effort:
        """Move on to ``due_ns`` and return what the drives did since the last sample.

        Args:
            due_ns: Time of the sample.
            longest_ns: Longest step of the integration up to then.
            silent: Whether no command was heard for ``command_timeout``.
        """
        effort = Effort(self._nothing, 0.0)
        if self.released:
            if self._ramp is not None:
                self._follow_ramp(due_ns, *self._ramp)
                self._move_to(due_ns, longest_ns)
            elif silent:
                self.timed_out = True
                self._move_to(due_ns, longest_ns, self._do_without)
            else:
                self._move_to(due_ns, longest_ns)
            interval = (due_ns - max(self.sampled_ns, self.begun_ns)) * 1e-9
            # No interval yet where a command came before the clock began.
            effort = Effort(self._impulse / interval if interval > 0.0 else self.plant.torque,
                            interval)
            self._impulse = np.zeros_like(self._impulse)
        self.sampled_ns = due_ns
        return effort

    def _move_to(self, now_ns: int, longest_ns: int,
                 command: Callable[[], None] | None = None) -> None:
        """Move on, in steps of a period still after a stall, and call ``command`` before each.

        One long step could be an unstable one, and damping that is held for as long drives the
        arm the other way.
        """
        ahead_ns = now_ns - self._moved_ns
        if ahead_ns > 0:
            steps = -(-ahead_ns // longest_ns)
            for _ in range(steps):
                if command is not None:
                    command()
                self.plant.advance(ahead_ns * 1e-9 / steps)
                self._impulse = self._impulse + self.plant.torque * (ahead_ns * 1e-9 / steps)
            self._moved_ns = now_ns

    def ramp_down(self, now_ns: int) -> None:
        """Begin to bring the torque to zero, the brakes follow."""
        if self.released:
            self._ramp = (self.plant.torque, now_ns)

    def stay(self) -> None:
        """Give up a ramp that is under way: commands are heard again."""
        self._ramp = None

    def brake(self) -> None:
        """Hold the arm where it is, without torque, until the next command."""
        self._ramp = None
        self.released = False
        self.plant.brake()

    def _do_without(self) -> None:
        """Never hold the last torque for ever."""
        braking = np.zeros_like(self._nothing)
        if self.watchdog.timeout_action == 'damping':
            braking = -broadcast(self.watchdog.damping, braking.size) * self.plant.qd
        self.plant.apply(braking)

    def _follow_ramp(self, now_ns: int, torque: np.ndarray, since_ns: int) -> None:
        left = (1.0 - (now_ns - since_ns) * 1e-9 / self.ramp_time if self.ramp_time > 0.0
                else 0.0)
        self.plant.apply(max(min(left, 1.0), 0.0) * torque)
        if left <= 0.0:
            self.brake()
            self._moved_ns = now_ns
