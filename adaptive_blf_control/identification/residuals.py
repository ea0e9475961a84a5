# SPDX-License-Identifier: Apache-2.0
"""How the residuals of the learned model behave over time, sample by sample.

Residuals of a robot are alike for a while: the filters remember, friction is not quite what its
columns say. How long decides how much a recorded pair tells beside its neighbours. With
ρ(t) = exp(−t/T), a low-pass of time constant L leaves the part T/(T + L) of the variance, which
gives T without any past samples being kept.
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.identification.history import History
from adaptive_blf_control.identification.identifier import Identifier

__all__ = ['Residuals']

_LOW_PASS = 5.0  # L in time constants of the filters
_WINDOW = 10.0  # s: residuals of longer ago, when θ̂ was still on its way, are forgotten
_LONGEST = 0.9  # of the variance that a low-pass may leave: T is at most nine times L


class Residuals:
    """Correlation time of the residuals per joint, and when the recorded pairs were taken."""

    def __init__(self, n: int) -> None:
        """Start with nothing seen of ``n`` joints."""
        self._low = np.zeros(n)
        self._mean_square = np.zeros(n)
        self._low_square = np.zeros(n)
        self._memory = 0.0
        self._weight = 0.0
        self._last = -math.inf
        self._insertions = 0
        self._times: dict[bytes, float] = {}

    def observe(self, t: float, identifier: Identifier) -> None:
        """Look at the identifier after it has taken a sample of time ``t`` [s]."""
        if not identifier.settled:
            return
        regressor, torque = identifier.pair
        stack = identifier.stack
        if stack.insertions != self._insertions:
            self._insertions = stack.insertions
            self._note(t, torque, stack)
        residual = torque - regressor @ identifier.theta
        self._memory = identifier.memory
        dt, self._last = t - self._last, t
        gain = -math.expm1(-dt / (_LOW_PASS * self._memory)) if dt > 0.0 else 0.0
        share = -math.expm1(-dt / _WINDOW) if math.isfinite(dt) else 0.0
        self._low = residual if gain == 1.0 else self._low + gain * (residual - self._low)
        self._weight += share * (1.0 - self._weight)
        self._mean_square += share * (residual ** 2 - self._mean_square)
        self._low_square += share * (self._low ** 2 - self._low_square)

    def _note(self, t: float, torque: np.ndarray, stack: History) -> None:
        self._times[torque.tobytes()] = t  # the pair is known by its torque
        if len(self._times) > 4 * stack.size:
            held = {row.tobytes() for row in stack.torques[:stack.count]}
            self._times = {key: time for key, time in self._times.items() if key in held}

    def times(self, stack: History) -> np.ndarray:
        """Return when each recorded pair was taken, shape (count,) [s]; NaN where not seen."""
        return np.array([self._times.get(row.tobytes(), math.nan)
                         for row in stack.torques[:stack.count]])

    @property
    def correlation_time(self) -> np.ndarray:
        """T per joint, at least the filters' memory, shape (n,) [s]."""
        part = np.divide(self._low_square, self._mean_square, where=self._mean_square > 0.0,
                         out=np.zeros_like(self._low_square))
        part = np.minimum(part, _LONGEST)
        return np.maximum(_LOW_PASS * self._memory * part / (1.0 - part), self._memory)

    @property
    def rms(self) -> np.ndarray:
        """RMS residual of the last ten seconds per joint, shape (n,) [N·m]."""
        result: np.ndarray = np.sqrt(self._mean_square / max(self._weight, 1e-12))
        return result
