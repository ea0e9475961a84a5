# SPDX-License-Identifier: Apache-2.0
"""Sampled torque filter: Y_f θ* = τ_f without accelerations, equations (12)-(18).

The arm (13) is integrated over each sample interval before it is filtered, so that both sides see
the same first-order lag 1/(k s + 1) of the same signal:

    Y_f ← a Y_f + (1 − a) [(Y1_i − Y1_{i−1})/dt + ½ (Y2_i + Y2_{i−1})],
    τ_f ← a τ_f + (1 − a) τ_i,    a = exp(−dt/k),

where τ_i is the mean torque over the interval that ends at sample i, or, where what is measured
is the torque at the samples, the mean of the two at its ends. Exact for a held torque but for the
trapezoid on Y2. Filtering (14)-(18) term by term instead leaves half a sample between the
two sides, which biases θ̂ for good.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import assign_vector, borrowed, jit
from adaptive_blf_control.errors import ParameterError

__all__ = ['FilteredPair', 'TorqueFilter', 'TorqueFilterArrays', 'filter_pair',
           'forget_pair']


class FilteredPair(NamedTuple):
    """Filtered regressor, shape (n, m), and filtered torque, shape (n,) [N·m] (18)."""

    regressor: np.ndarray
    torque: np.ndarray


class TorqueFilterArrays(NamedTuple):
    """The filter as compiled functions take it; arrays are changed in place.

    Attributes:
        regressor: Y_f, shape (n, m).
        torque: τ_f, shape (n,) [N·m].
        y1: Y1 of the last sample, shape (n, m).
        y2: Y2 of the last sample, shape (n, m).
        tau: Torque of the last sample, shape (n,) [N·m].
        begun: Whether there was one, shape (1,).
        time_constant: k of (14) [s].
        instant: Whether what is measured is the torque at the samples, not its mean.
    """

    regressor: np.ndarray
    torque: np.ndarray
    y1: np.ndarray
    y2: np.ndarray
    tau: np.ndarray
    begun: np.ndarray
    time_constant: float
    instant: bool


@jit
def filter_pair(arrays: TorqueFilterArrays, dt: float, y1: np.ndarray, y2: np.ndarray,
                tau: np.ndarray) -> bool:
    """Filter one sample, see `TorqueFilter.update`; False for the first one."""
    arrays = borrowed(arrays)
    advances = bool(arrays.begun[0])
    if advances:
        a = math.exp(-dt / arrays.time_constant)
        gain = 1.0 - a
        for k in range(tau.size):
            mean = 0.5 * (tau[k] + arrays.tau[k]) if arrays.instant else tau[k]
            arrays.torque[k] = a * arrays.torque[k] + gain * mean
            _filter_row(arrays.regressor[k], a, gain / dt, y1[k], arrays.y1[k], 0.5 * gain, y2[k],
                        arrays.y2[k])
    for k in range(tau.size):
        assign_vector(arrays.y1[k], y1[k])
        assign_vector(arrays.y2[k], y2[k])
    assign_vector(arrays.tau, tau)
    arrays.begun[0] = True
    return advances


@jit
def _filter_row(row: np.ndarray, a: float, rise: float, y1: np.ndarray, y1_last: np.ndarray,
                mean: float, y2: np.ndarray, y2_last: np.ndarray) -> None:
    for i in range(row.size):
        row[i] = a * row[i] + rise * (y1[i] - y1_last[i]) + mean * (y2[i] + y2_last[i])


@jit
def forget_pair(arrays: TorqueFilterArrays) -> None:
    """Begin with the next sample from Y_f = 0, τ_f = 0."""
    arrays = borrowed(arrays)
    arrays.regressor[:, :] = 0.0
    arrays.torque[:] = 0.0
    arrays.begun[0] = False


class TorqueFilter:
    """State of the filter: starts from Y_f = 0, τ_f = 0 and restarts after a gap.

    Attributes:
        arrays: The state.
        gap: Longest interval between samples that is filtered across [s].
    """

    def __init__(self, n: int, m: int, time_constant: float, gap: float = math.inf, *,
                 instant: bool = False) -> None:
        """Set up the filter.

        Args:
            n: Number of joints.
            m: Number of parameters.
            time_constant: k of (14) [s], > 0.
            gap: Longest interval between samples that is filtered across [s].
            instant: Whether what is measured is the torque at the samples, not its mean.
        """
        self.arrays = TorqueFilterArrays(
            np.zeros((n, m)), np.zeros(n), np.zeros((n, m)), np.zeros((n, m)), np.zeros(n),
            np.zeros(1, dtype=bool), 0.0, False)
        self.retune(time_constant, gap, instant=instant)

    def retune(self, time_constant: float, gap: float, *, instant: bool = False) -> None:
        """Change what the filter was made with, all or nothing, without a restart.

        Y_f θ* = τ_f goes on to hold: both sides take their next step with the same new a.
        """
        if not (math.isfinite(time_constant) and time_constant > 0.0):
            raise ParameterError('identifier.filter.time_constant', time_constant,
                                 'a finite time > 0 s')
        if not gap > 0.0:
            raise ParameterError('identifier.filter.gap', gap, 'a time > 0 s')
        self.arrays = self.arrays._replace(time_constant=float(time_constant), instant=instant)
        self.gap = gap

    @property
    def pair(self) -> FilteredPair:
        """A copy of the present pair."""
        return FilteredPair(self.arrays.regressor.copy(), self.arrays.torque.copy())

    def reset(self) -> None:
        """Forget everything; the next sample is the first one."""
        forget_pair(self.arrays)

    def update(self, dt: float, y1: np.ndarray, y2: np.ndarray, tau: np.ndarray) -> bool:
        """Filter one sample.

        Args:
            dt: Time since the last sample [s], > 0; not used for the first one.
            y1: Y1(q, q̇) of this sample, shape (n, m).
            y2: Y2(q, q̇) of this sample, shape (n, m).
            tau: Mean torque over the interval that ends here, or where ``instant`` that of now,
                shape (n,) [N·m].

        Returns:
            Whether :attr:`pair` advanced; False where the filter (re)started.
        """
        if dt > self.gap:
            self.reset()
        return bool(filter_pair(self.arrays, dt, y1, y2, tau))
