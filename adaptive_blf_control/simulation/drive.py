# SPDX-License-Identifier: Apache-2.0
"""The drives of a simulated arm: a command is limited, acts later, and with a wrong gain."""

from __future__ import annotations

from collections import deque
import math

import numpy as np

from adaptive_blf_control.control.law import limited
from adaptive_blf_control.simulation.settings import DriveSettings

__all__ = ['Drive']


class Drive:
    """Commands on their way to the joints, in the order in which they were given.

    A command of time t acts from t + delay + jitter·u on, u drawn uniformly from [0, 1) for each
    command; one that would overtake an older one acts together with it.

    Attributes:
        effort: Torque that the drives take to act now, shape (n,) [N·m].
    """

    def __init__(self, settings: DriveSettings, torque_limit: np.ndarray) -> None:
        """Start without torque.

        Args:
            settings: Delay, jitter and gain error, the latter of shape (n,).
            torque_limit: Where the drives saturate, shape (n,) [N·m].
        """
        self._settings = settings
        self._limit = torque_limit.copy()  # the limit is compiled for arrays that may be written
        self._gain = 1.0 + settings.gain_error
        self._random = np.random.default_rng(settings.seed)
        self._under_way: deque[tuple[float, np.ndarray]] = deque()
        self.effort = np.zeros(self._limit.size)

    @property
    def torque(self) -> np.ndarray:
        """Torque that acts now, shape (n,) [N·m]."""
        return np.asarray(self._gain * self.effort)

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
        self._under_way.append((at, limited(torque, self._limit)))
        if at <= t:
            self.advance_to(t)

    def advance_to(self, t: float) -> None:
        """Let act what is due at ``t`` [s]."""
        while self._under_way and self._under_way[0][0] <= t:
            self.effort = self._under_way.popleft()[1]

    def stop(self) -> None:
        """Drop every command, without torque from now on."""
        self._under_way.clear()
        self.effort = np.zeros_like(self.effort)
