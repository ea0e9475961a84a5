# SPDX-License-Identifier: Apache-2.0
"""Where the arm is when the torque acts that answers a state.

What a command finds is not the state it answers: until it acts, for the delay d of the loop, the
torques act that were commanded before. The model is followed that far, q̈ = M_c⁻¹ (τ(t − d) − h_c),
so that the filter decides for the state that its torque meets (a Smith predictor for a state that
is measured).
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.arms.mass_and_bias import mass_and_bias
from adaptive_blf_control.compiled import Handle, jit
from adaptive_blf_control.limits.filter_look import FilterParts
from adaptive_blf_control.linear_algebra import inverse, product

__all__ = ['Prediction']

LONGEST_STEP = 0.002  # of the model [s]
KEPT = 64  # commands


class Prediction:
    """The commands of the last samples, and where the model is when the next one acts."""

    def __init__(self, n: int, delay: float) -> None:
        """Take the number of joints and the delay d [s]."""
        self.delay = delay
        self._times, self._torques = np.full(KEPT, -np.inf), np.zeros((KEPT, n))

    def commanded(self, t: float, torque: np.ndarray) -> None:
        """Note the torque that answers the state of ``t`` [s], shape (n,) [N·m]."""
        if t < self._times[-1]:  # of another clock: nobody knows which of them still act
            self._times[:] = -np.inf
        if self.delay > 0.0:
            self._times[:-1], self._torques[:-1] = self._times[1:], self._torques[1:]
            self._times[-1], self._torques[-1] = t, torque

    def state(self, parts: Handle, t: float, q: np.ndarray,
              qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [rad] and velocities [rad/s] at t + d, each (n,).

        Args:
            parts: Handle of the filter, see `FilterParts`.
            t: Of the state [s].
            q: Its positions, shape (n,) [rad].
            qd: Its velocities, shape (n,) [rad/s].
        """
        if self.delay <= 0.0:
            return q, qd
        return _ahead(parts, q, qd, t - self._times, self._torques, self.delay)


@jit
def _ahead(parts: Handle, q: np.ndarray, qd: np.ndarray, ages: np.ndarray, torques: np.ndarray,
           delay: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the state after the delay, under torques that were commanded ``ages`` [s] before it.

    Before the first command the joints are taken to go on as they are.
    """
    filter_: FilterParts = parts.value
    steps = math.ceil(delay / LONGEST_STEP)
    step = delay / steps
    for k in range(steps):
        begin, end = delay - k * step, delay - (k + 1) * step  # ages of what acts in the step
        torque, known = np.zeros(q.size), 0.0
        for i in range(ages.size):
            until = ages[i + 1] if i + 1 < ages.size else 0.0
            part = (min(begin, ages[i]) - max(end, until)) / step
            if part > 0.0 and ages[i] < np.inf:
                known += part
                torque += part * torques[i]
        if known > 0.0:
            inertia, bias = mass_and_bias(filter_.model.value.centre, q, qd)
            a = known * product(inverse(inertia), torque / known - bias)
            q, qd = q + step * (qd + 0.5 * step * a), qd + step * a
        else:
            q = q + step * qd
    return q, qd
