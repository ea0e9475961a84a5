# SPDX-License-Identifier: Apache-2.0
"""The numbers of Theorem 2, and a monitor that says when a run leaves what it guarantees.

With V of (57), V = V1 + ½ e2ᵀ M e2 + ½ θ̃ᵀ Γ⁻¹ θ̃, the theorem says V(t) ≤ V(0), hence (39)-(41).
It holds for a constant θ*, the update law (37), continuous time, unlimited torque and exact
measurements. The numbers need V(0), that is θ* or a bound on ‖θ̃(0)‖.

Where performance.lower = −performance.upper the barrier is the symmetric one (SBLF), joint by
joint, and so are the bounds.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.regressors import ArmInPython, arrays_of, regressors
from adaptive_blf_control.compiled import jit, uncompiled
from adaptive_blf_control.control.barrier import active_bound, barrier, joint_barrier
from adaptive_blf_control.control.law import joint_errors
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.control.step import AblfGains
from adaptive_blf_control.errors import ParameterError

__all__ = ['Departure', 'Guarantee', 'GuaranteeMonitor', 'bounded_value', 'guarantee',
           'lyapunov_along', 'lyapunov_value', 'mass_range']

# Rise of V that counts as none. A sampled loop answers one sample late, which lets
# V rise in O(dt²) from a start at e2 = 0 (2e-5 of V(0) for a Panda under gravity at 1 kHz); one
# that starts with V(0) = 0 stays below the absolute part.
RELATIVE, ABSOLUTE = 1e-3, 1e-9
POSTURES = 500


class Guarantee(NamedTuple):
    """What Theorem 2 guarantees from V(0) on; arrays of shape (n,).

    Attributes:
        value: V(0).
        error_lower: −U_e1 lower (39) [rad], ≥ −k_a.
        error_upper: Ū_e1 (39) [rad], ≤ k_b.
        e2_norm: Bound on ‖e2‖ (40) [rad/s].
        output_lower: Lower end of Ω_y (41) [rad].
        output_upper: Upper end of Ω_y (41) [rad].
    """

    value: float
    error_lower: np.ndarray
    error_upper: np.ndarray
    e2_norm: float
    output_lower: np.ndarray
    output_upper: np.ndarray


class Departure(NamedTuple):
    """Where a run first left what was guaranteed.

    Attributes:
        t: Time [s].
        joint: Joint whose e1 is beyond U_e1; None where V has risen.
        value: e1 [rad] or V.
        bound: U_e1 with its sign [rad] or V(0).
    """

    t: float
    joint: str | None
    value: float
    bound: float

    def __str__(self) -> str:
        """Say it in words."""
        if self.joint is None:
            return f'V = {self.value:.6g} is above V(0) = {self.bound:.6g} at {self.t:.3f} s'
        return (f'joint {self.joint!r}: e1 = {self.value:.6g} rad is beyond U_e1 = '
                f'{self.bound:.6g} rad at {self.t:.3f} s')


def lyapunov_value(arm: Arm, q: np.ndarray, e1: np.ndarray, e2: np.ndarray,
                   performance: JointInterval, theta_hat: np.ndarray, theta_true: np.ndarray,
                   gamma: np.ndarray, weight: np.ndarray) -> float:
    """Equation (57): V = V1 + ½ e2ᵀ M(q) e2 + ½ θ̃ᵀ Γ⁻¹ θ̃ [J].

    Args:
        arm: Whose M(q) θ* gives.
        q: Positions, shape (n,) [rad].
        e1: Tracking error, shape (n,) [rad].
        e2: q̇ − α, shape (n,) [rad/s].
        performance: Performance set (8).
        theta_hat: θ̂, shape (m,).
        theta_true: θ*, shape (m,).
        gamma: Diagonal of Γ, shape (m,).
        weight: Weights of the barrier, shape (n,) [J].
    """
    error = theta_hat - theta_true
    b = active_bound(e1, performance.lower, performance.upper)
    kinetic = 0.5 * float(e2 @ arm.Y1(q, e2) @ theta_true)
    return barrier(e1, b, weight) + kinetic + 0.5 * float(np.sum(error * error / gamma))


@jit
def _lyapunov_rows(arm: Any, q: np.ndarray, qd: np.ndarray, reference: ReferencePoint,
                   lower: np.ndarray, upper: np.ndarray, gains: AblfGains,
                   theta_hat: np.ndarray, theta_true: np.ndarray,
                   gamma: np.ndarray) -> np.ndarray:
    samples, n = q.shape
    values, e2 = np.zeros(samples), np.empty(n)
    for k in range(samples):
        for i in range(n):
            e1, e2[i], _, _, b = joint_errors(
                q[k, i], qd[k, i], reference.position[k, i], reference.velocity[k, i],
                reference.acceleration[k, i], lower[i], upper[i], 0.0, 0.0, gains.k1[i])
            values[k] += joint_barrier(e1, b, gains.weight[i])
        y1, _ = regressors(arm, q[k], e2)
        for j in range(theta_true.size):
            for i in range(n):
                values[k] += 0.5 * e2[i] * y1[i, j] * theta_true[j]
            error = theta_hat[k, j] - theta_true[j]
            values[k] += 0.5 * error * error / gamma[j]
    return values


def lyapunov_along(arm: Arm, q: np.ndarray, qd: np.ndarray, reference: ReferencePoint,
                   performance: JointInterval, gains: AblfGains, theta_hat: np.ndarray,
                   theta_true: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Return V (57) along N samples of a run with one θ*, shape (N,) [J].

    Args:
        arm: Whose M(q) θ* gives.
        q: Positions, shape (N, n) [rad].
        qd: Velocities, shape (N, n) [rad/s].
        reference: y_d with two derivatives, arrays of shape (N, n).
        performance: Performance set (8).
        gains: Of (38).
        theta_hat: θ̂ at each sample, shape (N, m).
        theta_true: θ*, shape (m,).
        gamma: Diagonal of Γ, shape (m,).
    """
    arrays = arrays_of(arm)
    rows = uncompiled(_lyapunov_rows) if arrays is None else _lyapunov_rows
    return rows(ArmInPython(arm) if arrays is None else arrays, q, qd, reference,
                performance.lower.copy(), performance.upper.copy(), gains,
                np.ascontiguousarray(theta_hat), theta_true, gamma.copy())


def bounded_value(e1: np.ndarray, e2: np.ndarray, performance: JointInterval, largest_mass: float,
                  theta_error: float, gamma: np.ndarray, weight: np.ndarray) -> float:
    """Return an upper bound on V (57) where only ‖θ̃‖ ≤ ``theta_error`` is known.

    Args:
        e1: Tracking error, shape (n,) [rad].
        e2: q̇ − α, shape (n,) [rad/s].
        performance: Performance set (8).
        largest_mass: Upper bound on λ_max(M) [kg·m²].
        theta_error: Bound on ‖θ̃‖.
        gamma: Diagonal of Γ, shape (m,).
        weight: Weights of the barrier, shape (n,) [J].

    Raises:
        ParameterError: A bound is negative or not finite.
    """
    for name, value in (('largest_mass', largest_mass), ('theta_error', theta_error)):
        if not (math.isfinite(value) and value >= 0.0):
            raise ParameterError(name, value, 'a finite bound >= 0')
    b = active_bound(e1, performance.lower, performance.upper)
    return (barrier(e1, b, weight) + 0.5 * largest_mass * float(e2 @ e2)
            + 0.5 * theta_error ** 2 / float(np.min(gamma)))


def guarantee(value: float, performance: JointInterval,
              reference: tuple[np.ndarray, np.ndarray], smallest_mass: float,
              weight: np.ndarray) -> Guarantee:
    """Return (39)-(41) for V(0) = ``value``.

    With a weight c of the barrier, ½ c e1²/(b² − e1²) ≤ V(0) gives |e1| ≤ b √(2V(0)/(c + 2V(0))).

    Args:
        value: V(0) or an upper bound on it, ≥ 0.
        performance: Performance set (8).
        reference: Range of y_d, two arrays of shape (n,) [rad].
        smallest_mass: λ_min(M), or a lower bound on it [kg·m²].
        weight: Weights of the barrier, shape (n,) [J].
    """
    if not (math.isfinite(value) and value >= 0.0):
        raise ParameterError('V(0)', value, 'a finite value >= 0')
    part = np.sqrt(2.0 * value / (weight + 2.0 * value))
    lower, upper = part * performance.lower, part * performance.upper
    norm = math.sqrt(2.0 * value / smallest_mass) if smallest_mass > 0.0 else math.inf
    return Guarantee(value, lower, upper, norm, reference[0] + lower, reference[1] + upper)


def mass_range(arm: Arm, theta: np.ndarray, lower: np.ndarray,
               upper: np.ndarray) -> tuple[float, float]:
    """Return the smallest and the largest eigenvalue of M(q) seen in a box of postures [kg·m²].

    Seen in both corners and 500 postures drawn with a fixed seed: close to the extremes, but
    inside them.

    Args:
        arm: The arm.
        theta: Its parameters, shape (m,).
        lower: Lower corner of the box, shape (n,) [rad].
        upper: Upper corner, shape (n,) [rad].
    """
    units = np.eye(arm.n)
    postures = np.random.default_rng(0).uniform(lower, upper, (POSTURES, arm.n))
    masses = np.array([[arm.Y1(q, unit) @ theta for unit in units]
                       for q in (lower, upper, *postures)])
    values = np.linalg.eigvalsh(0.5 * (masses + masses.transpose(0, 2, 1)))
    return float(values[:, 0].min()), float(values[:, -1].max())


class GuaranteeMonitor:
    """Compares a run with a `Guarantee`, rounding allowed for.

    Attributes:
        guaranteed: The guarantee.
        first: Where the run first left it, None so far.
    """

    def __init__(self, guaranteed: Guarantee, performance: JointInterval,
                 joints: tuple[str, ...], weight: np.ndarray) -> None:
        """Watch a run that starts with V(0) = ``guaranteed.value``; ``weight`` as there."""
        self.guaranteed = guaranteed
        self.first: Departure | None = None
        self._joints = joints
        self._limit = guaranteed.value * (1.0 + RELATIVE) + ABSOLUTE
        allowed = guarantee(self._limit, performance, (performance.lower, performance.upper), 1.0,
                            weight)
        self._lower, self._upper = allowed.error_lower, allowed.error_upper

    def observe_along(self, t: np.ndarray, e1: np.ndarray,
                      values: np.ndarray) -> Departure | None:
        """Check N samples, see :meth:`observe`; return the first departure among them.

        Args:
            t: Times, shape (N,) [s].
            e1: Tracking errors, shape (N, n) [rad].
            values: V (57), shape (N,).
        """
        kept = ((e1 >= self._lower) & (e1 <= self._upper)).all(axis=1) & (values <= self._limit)
        if kept.all():
            return None
        k = int(np.argmin(kept))
        return self.observe(float(t[k]), e1[k], float(values[k]))

    def observe(self, t: float, e1: np.ndarray, value: float | None = None) -> Departure | None:
        """Check one sample.

        Args:
            t: Time of the sample [s].
            e1: Tracking error, shape (n,) [rad].
            value: V (57), None where θ* is not known.

        Returns:
            The departure of this sample, e1 before V; None where all is kept. NaN counts as left.
        """
        departure = self._departure(t, e1, value)
        if self.first is None:
            self.first = departure
        return departure

    def _departure(self, t: float, e1: np.ndarray, value: float | None) -> Departure | None:
        inside = (e1 >= self._lower) & (e1 <= self._upper)
        if not inside.all():
            i = int(np.argmin(inside))
            bound = self.guaranteed.error_upper if e1[i] > 0.0 else self.guaranteed.error_lower
            return Departure(t, self._joints[i], float(e1[i]), float(bound[i]))
        if value is not None and not value <= self._limit:
            return Departure(t, None, float(value), self.guaranteed.value)
        return None
