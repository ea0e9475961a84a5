# SPDX-License-Identifier: Apache-2.0
"""Sampled torque filter: Y_f θ* = τ_f without accelerations, equations (12)-(18).

The arm (13) is integrated over each sample interval before it is filtered, so that both sides see
the same first-order lag 1/(k s + 1) of the same signal:

    Y_f ← a Y_f + (1 − a) [(Y1_i − Y1_{i−1})/dt + ½ (Y2_i + Y2_{i−1})],
    τ_f ← a τ_f + (1 − a) τ_i,    a = exp(−dt/k),

where τ_i is the mean torque over the interval that ends at sample i. Exact for a held torque but
for the trapezoid on Y2. Filtering (14)-(18) term by term instead leaves half a sample between the
two sides, which biases θ̂ for good.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError

__all__ = ['FilteredPair', 'TorqueFilter', 'filter_step']


class FilteredPair(NamedTuple):
    """Filtered regressor, shape (n, m), and filtered torque, shape (n,) [N·m] (18)."""

    regressor: np.ndarray
    torque: np.ndarray


@jit
def filter_step(dt: float, a: float, yf: np.ndarray, tf: np.ndarray, y1: np.ndarray,
                y1_last: np.ndarray, y2: np.ndarray, y2_last: np.ndarray, tau: np.ndarray,
                ) -> tuple[np.ndarray, np.ndarray]:
    """One step of the sampled filter; see the module's docstring for the formula."""
    gain = 1.0 - a
    yf = a * yf + (gain / dt) * (y1 - y1_last) + (0.5 * gain) * (y2 + y2_last)
    return yf, a * tf + gain * tau


class TorqueFilter:
    """State of the filter: starts from Y_f = 0, τ_f = 0 and restarts after a gap."""

    def __init__(self, n: int, m: int, time_constant: float, gap: float = math.inf) -> None:
        """Set up the filter.

        Args:
            n: Number of joints.
            m: Number of parameters.
            time_constant: k of (14) [s], > 0.
            gap: Longest interval between samples that is filtered across [s].
        """
        self.retune(time_constant, gap)
        self._zero = FilteredPair(np.zeros((n, m)), np.zeros(n))
        self.reset()

    def retune(self, time_constant: float, gap: float) -> None:
        """Change k and the gap, both or none, without a restart.

        Y_f θ* = τ_f goes on to hold: both sides take their next step with the same new a.
        """
        if not (math.isfinite(time_constant) and time_constant > 0.0):
            raise ParameterError('identifier.filter.time_constant', time_constant,
                                 'a finite time > 0 s')
        if not gap > 0.0:
            raise ParameterError('identifier.filter.gap', gap, 'a time > 0 s')
        self.time_constant = time_constant
        self.gap = gap

    def reset(self) -> None:
        """Forget everything; the next sample is the first one."""
        self.pair = self._zero
        self._y1: np.ndarray | None = None
        self._y2: np.ndarray | None = None

    def update(self, dt: float, y1: np.ndarray, y2: np.ndarray, tau: np.ndarray) -> bool:
        """Filter one sample.

        Args:
            dt: Time since the last sample [s], > 0; not used for the first one.
            y1: Y1(q, q̇) of this sample, shape (n, m).
            y2: Y2(q, q̇) of this sample, shape (n, m).
            tau: Mean torque over the interval that ends here, shape (n,) [N·m].

        Returns:
            Whether :attr:`pair` advanced; False where the filter (re)started.
        """
        y1_last, y2_last = self._y1, self._y2
        self._y1, self._y2 = y1, y2
        if y1_last is None or y2_last is None or dt > self.gap:
            self.pair = self._zero
            return False
        self.pair = FilteredPair(*filter_step(
            dt, math.exp(-dt / self.time_constant), self.pair.regressor, self.pair.torque,
            y1, y1_last, y2, y2_last, tau))
        return True
