# SPDX-License-Identifier: Apache-2.0
"""The function of a motion's coefficients that is made small: what it teaches, and its limits."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.clearance import Clearance
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.experiment.criterion import criterion
from adaptive_blf_control.experiment.motion_limits import limit_penalty, MotionLimits
from adaptive_blf_control.experiment.periodic_motion import PeriodicMotion, rest_basis, series
from adaptive_blf_control.experiment.torque_rows import torque_rows, torque_sensitivity
from adaptive_blf_control.tuning.inertia import ReferenceStates

__all__ = ['Objective', 'PER_HARMONIC', 'times_of']

PER_HARMONIC = 16  # samples of a period of the highest harmonic
PENALTY = 20.0  # of a limit that is broken by its own size at every sample
SCALE = 0.05  # m: a distance that is short by so much counts as a limit broken by its own size
ROOM = 0.2  # of `SCALE`, by which bodies are to stay farther apart than they have to
AIM = 0.97  # part of the limits that is aimed for: between the samples there is a little more


def times_of(period: float, harmonics: int, per_harmonic: int) -> np.ndarray:
    """Return evenly spaced times of a period, without its end [s]."""
    count = per_harmonic * harmonics
    return np.arange(count) * (period / count)


class Objective:
    """J of a motion plus a penalty on broken limits, of a vector x, with its gradient.

    x holds the centre in half ranges from the middle and, per joint, weights of `rest_basis` in
    amplitudes of half the speed limit.
    """

    def __init__(self, arm: UrdfArm, limits: MotionLimits, noise: np.ndarray, period: float,
                 harmonics: int, clearance: Clearance | None) -> None:
        """Take what the motion is for.

        Args:
            arm: The arm whose parameters are to be learned.
            limits: That the motion must keep.
            noise: Standard deviation of the measured torques, shape (n,) [N·m].
            period: [s].
            harmonics: Number of harmonics, ≥ 3.
            clearance: Bodies that have to stay apart, or None.
        """
        self.arm, self.limits, self.noise, self.period = arm, limits, noise, period
        self._clearance = clearance
        self._basis = rest_basis(harmonics)
        self._times = times_of(period, harmonics, PER_HARMONIC)
        self._tables = series(self._times, period, harmonics)
        self._shape = arm.n, self._basis.shape[0]
        self._middle = 0.5 * (limits.lower + limits.upper)
        self._half = 0.5 * (limits.upper - limits.lower)
        self._unit = 0.5 * limits.velocity * period / (2.0 * np.pi)
        self._aim = limits._replace(
            lower=self._middle - AIM * self._half, upper=self._middle + AIM * self._half,
            velocity=AIM * limits.velocity, acceleration=AIM * limits.acceleration,
            torque=AIM * limits.torque)
        self._known: tuple[np.ndarray, ReferenceStates, np.ndarray] | None = None

    @property
    def size(self) -> int:
        """Length of x."""
        return self._shape[0] * (1 + self._shape[1])

    def random(self, random: np.random.Generator) -> np.ndarray:
        """Return x of a random motion around the middle of the limits."""
        return np.concatenate([np.zeros(self._shape[0]),
                               random.normal(0.0, 0.3, self._shape[0] * self._shape[1])])

    def motion(self, x: np.ndarray) -> PeriodicMotion:
        """Return the motion of x."""
        n, _ = self._shape
        weights = x[n:].reshape(self._shape) * self._unit[:, None]
        cosine, sine = np.hsplit(weights @ self._basis, 2)
        return PeriodicMotion(self.period, self._middle + self._half * x[:n], cosine, sine)

    def value(self, x: np.ndarray) -> float:
        """Return the objective at x."""
        states, rows = self._sampled(x)
        total = criterion(self._gram(rows))[0]
        total += PENALTY * limit_penalty(states, rows, self._aim)[0] / len(rows)
        return total + PENALTY * self._near(states)[0] / len(rows)

    def gradient(self, x: np.ndarray) -> np.ndarray:
        """Return the gradient at x, shape of x."""
        states, rows = self._sampled(x)
        slope = criterion(self._gram(rows))[1]
        weighted = rows / self.noise[:, None] ** 2
        weight = 2.0 * weighted @ slope / len(rows)
        _, direct, in_rows = limit_penalty(states, rows, self._aim)
        weight += PENALTY * in_rows / len(rows)
        along = torque_sensitivity(self.arm.arrays, *states, np.ascontiguousarray(weight))
        along += PENALTY * direct / len(rows)
        along[0] += PENALTY * self._near(states)[1] / len(rows)
        coefficients = sum(part.T @ table for part, table in zip(along, self._tables))
        weights = coefficients @ self._basis.T * self._unit[:, None]
        return np.concatenate([along[0].sum(axis=0) * self._half, weights.ravel()])

    def _sampled(self, x: np.ndarray) -> tuple[ReferenceStates, np.ndarray]:
        if self._known is None or not np.array_equal(self._known[0], x):
            motion = self.motion(x)
            coefficients = np.hstack([motion.cosine, motion.sine])
            q, qd, qdd = (table @ coefficients.T for table in self._tables)
            states = ReferenceStates(motion.centre + q, qd, qdd)
            self._known = x.copy(), states, torque_rows(self.arm.arrays, *states)
        return self._known[1:]

    def _gram(self, rows: np.ndarray) -> np.ndarray:
        """Return the information of one sample, the mean of YᵀY / σ², shape (m, m)."""
        scaled = (rows / self.noise[:, None]).reshape(-1, rows.shape[-1])
        result: np.ndarray = scaled.T @ scaled / len(rows)
        return result

    def _near(self, states: ReferenceStates) -> tuple[float, np.ndarray]:
        """Return the penalty on short distances and its gradient in q, shape (N, n)."""
        total, slope = 0.0, np.zeros_like(states.q)
        if self._clearance is None:
            return total, slope
        for k, beyond, away in self._clearance.near(states.q, ROOM * SCALE):
            short = ROOM - beyond / SCALE
            total += short ** 2
            slope[k] -= 2.0 * short / SCALE * away
        return total, slope
