# SPDX-License-Identifier: Apache-2.0
"""The actuators of a simulated arm: a command is limited, acts later, and with a wrong gain."""

from __future__ import annotations

from collections import deque
import math

import numpy as np

from adaptive_blf_control.control.law import limited
from adaptive_blf_control.simulation.settings import PlantSettings

__all__ = ['Actuators']


class Actuators:
    """Commands on their way to the joints, in the order in which they were given.

    A command of time t acts from t + delay + jitter·u on, u drawn uniformly from [0, 1) for each
    command; one that would overtake an older one acts together with it. With a dead time t is the
    time of the sample so many samples later. What acts is (1 + gain_error) times what the
    actuators take it to be, and measure.
    """

    def __init__(self, settings: PlantSettings) -> None:
        """Start without torque; arrays of the settings are of shape (n,)."""
        self._settings = settings.actuator
        self._random = np.random.default_rng(self._settings.seed)
        self._under_way: deque[tuple[float, np.ndarray]] = deque()
        # What acts, but for the gain, and what has been commanded last [N·m].
        self._acting = self._commanded = np.zeros(settings.torque_limit.size)
        self._impulse, self._span = np.zeros_like(self._acting), 0.0  # since the last sample
        self._dead_time = -1
        self.retune(settings)
        limited(self._commanded, self._limit)  # compiles it before it is urgent

    def retune(self, settings: PlantSettings) -> None:
        """Take another limit and dead time; what was commanded last is under way for that long."""
        self._limit = settings.torque_limit.copy()  # what is compiled may write its arrays
        if settings.dead_time != self._dead_time:
            self._dead_time = settings.dead_time
            self._waiting = deque([self._commanded] * max(settings.dead_time - 1, 0))

    @property
    def torque(self) -> np.ndarray:
        """Torque that acts now, shape (n,) [N·m]."""
        return np.asarray((1.0 + self._settings.gain_error) * self._acting)

    @property
    def next_switch(self) -> float:
        """Time from which the next command acts [s]; infinity where none is on its way."""
        return self._under_way[0][0] if self._under_way else math.inf

    def command(self, t: float, torque: np.ndarray) -> None:
        """Take a command of time ``t`` [s], shape (n,) [N·m]."""
        self._commanded = limited(torque, self._limit)
        if not self._dead_time:
            self._send(t, self._commanded)

    def _send(self, t: float, torque: np.ndarray) -> None:
        settings = self._settings
        late = settings.jitter * self._random.random() if settings.jitter > 0.0 else 0.0
        self._under_way.append((t + settings.delay + late, torque))
        self.advance_to(t)

    def advance_to(self, t: float) -> None:
        """Let act what is due at ``t`` [s]."""
        while self._under_way and self._under_way[0][0] <= t:
            self._acting = self._under_way.popleft()[1]

    def act(self, dt: float) -> None:
        """Note that the present torque has acted for ``dt`` [s]."""
        self._impulse = self._impulse + dt * self._acting
        self._span += dt

    def sample(self, t: float) -> np.ndarray:
        """Return the torque that is measured of the time since the last sample, (n,) [N·m].

        Its mean, or with ``effort: instant`` that of now; without the error of the gain. Then the
        command whose dead time ends with the sample goes on its way.

        Args:
            t: Time of the sample [s].
        """
        mean = self._span > 0.0 and self._settings.effort == 'mean'
        measured = self._impulse / self._span if mean else self._acting
        self._impulse, self._span = np.zeros_like(self._impulse), 0.0
        if self._dead_time:
            self._waiting.append(self._commanded)
            self._send(t, self._waiting.popleft())
        return np.asarray(measured + self._settings.torque_bias)

    def stop(self) -> None:
        """Drop every command, without torque from now on."""
        self._under_way.clear()
        self._acting = self._commanded = np.zeros_like(self._acting)
        self._waiting = deque([self._acting] * len(self._waiting))
