# SPDX-License-Identifier: Apache-2.0
"""The actuators of a simulated arm: a command is limited, acts later, and with a wrong gain."""

from __future__ import annotations

from collections import deque
import math

import numpy as np

from adaptive_blf_control.control.law import limited
from adaptive_blf_control.simulation.settings import ActuatorSettings

__all__ = ['Actuators']


class Actuators:
    """Commands on their way to the joints, in the order in which they were given.

    A command of time t acts from t + delay + jitter·u on, u drawn uniformly from [0, 1) for each
    command; one that would overtake an older one acts together with it. What acts is
    (1 + gain_error) times what the actuators take it to be, and measure.

    Attributes:
        torque_limit: Where they saturate, shape (n,) [N·m].
    """

    def __init__(self, settings: ActuatorSettings, torque_limit: np.ndarray) -> None:
        """Start without torque.

        Args:
            settings: Delay, errors and what is measured, arrays of shape (n,).
            torque_limit: Where the actuators saturate, shape (n,) [N·m].
        """
        self._settings = settings
        self.torque_limit = torque_limit.copy()  # what is compiled may write its arrays
        self._random = np.random.default_rng(settings.seed)
        self._under_way: deque[tuple[float, np.ndarray]] = deque()
        # What acts, but for the gain [N·m]. This compiles the limit before it is urgent.
        self._commanded = limited(np.zeros(torque_limit.size), self.torque_limit)
        self._impulse, self._span = np.zeros(torque_limit.size), 0.0  # since the last sample

    @property
    def torque(self) -> np.ndarray:
        """Torque that acts now, shape (n,) [N·m]."""
        return np.asarray((1.0 + self._settings.gain_error) * self._commanded)

    @property
    def next_switch(self) -> float:
        """Time from which the next command acts [s]; infinity where none is on its way."""
        return self._under_way[0][0] if self._under_way else math.inf

    def command(self, t: float, torque: np.ndarray) -> None:
        """Take a command of time ``t`` [s], shape (n,) [N·m]."""
        settings = self._settings
        late = settings.jitter * self._random.random() if settings.jitter > 0.0 else 0.0
        at = t + settings.delay + late
        if self._under_way:
            at = max(at, self._under_way[-1][0])
        self._under_way.append((at, limited(torque, self.torque_limit)))
        self.advance_to(t)

    def advance_to(self, t: float) -> None:
        """Let act what is due at ``t`` [s]."""
        while self._under_way and self._under_way[0][0] <= t:
            self._commanded = self._under_way.popleft()[1]

    def act(self, dt: float) -> None:
        """Note that the present torque has acted for ``dt`` [s]."""
        self._impulse = self._impulse + dt * self._commanded
        self._span += dt

    def sample(self) -> np.ndarray:
        """Return the torque that is measured of the time since the last sample, (n,) [N·m].

        Its mean, or with ``effort: instant`` that of now; without the error of the gain.
        """
        mean = self._span > 0.0 and self._settings.effort == 'mean'
        measured = self._impulse / self._span if mean else self._commanded
        self._impulse, self._span = np.zeros_like(self._impulse), 0.0
        return np.asarray(measured + self._settings.torque_bias)

    def stop(self) -> None:
        """Drop every command, without torque from now on."""
        self._under_way.clear()
        self._commanded = np.zeros_like(self._commanded)
