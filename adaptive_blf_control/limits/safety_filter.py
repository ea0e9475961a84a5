# SPDX-License-Identifier: Apache-2.0
"""The torque nearest to the law's after which every limit can still be kept.

With the model θc at the centre of the parameter set, M a + h = τ, the law's torque asks for the
acceleration a_w = M⁻¹(τ − h). The filter returns τ = M a + h for the solution of

    min (a − a_w)ᵀ M (a − a_w)   subject to
        −τ̄ ≤ M a + h ≤ τ̄                           torque limits, hard
        a_low + ε ≤ a ≤ a_high − ε                    velocity, and position that can be stopped
        Σ_j J_j (|q̇_j| / ā_j) a_j ≥ −γ H − ḣ + σ      obstacles, H the clearance after a full stop

(M is the metric in which Gauss's principle measures constraints.) ε = |M⁻¹| s(Y) and σ are what
any θ of the set can change, with the support s of `parameter_set`. Where no row is violated the law's
torque is returned bit for bit. Rows on the state are softened where all together cannot be met;
the torque limits never are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.limits.quadratic_program import solve

__all__ = ['ACTIVE', 'BRAKING', 'IDLE', 'Limits', 'limited_torque', 'Rows', 'SOFTENED',
           'stopping_rows']

IDLE, ACTIVE, SOFTENED, BRAKING = 0, 1, 2, 3
"""What the filter did: nothing; another torque within all rows; within the torque limits only;
no torque was found, so the joints are damped."""

SOFTNESS = 1e-8
"""Softness of a softened row, relative to the mean of the diagonal of H⁻¹."""
MARGIN_SHARE = 0.4
"""Largest part of the room between two bounds that the margin ε may take."""
DAMPING = 5.0
"""Damping where the program has no solution [N·m·s/rad]."""


class Limits(NamedTuple):
    """What has to be kept, and with what the arm can brake.

    Attributes:
        torque: τ̄, shape (n,) [N·m].
        braking: ā, shape (n,) [rad/s²].
        approach: γ, how fast a clearance may be used up [1/s].
    """

    torque: np.ndarray
    braking: np.ndarray
    approach: float


class Rows(NamedTuple):
    """Rows c a ≥ b on the accelerations, shapes (k, n) and (k,)."""

    matrix: np.ndarray
    bound: np.ndarray


@jit
def stopping_rows(clearance: np.ndarray, gradient: np.ndarray, rate: np.ndarray, qd: np.ndarray,
                  limits: Limits) -> Rows:
    """Return the rows that keep clearances after a full stop.

    When every joint brakes with ā from q̇ it stops δ_j = q̇_j |q̇_j| / (2 ā_j) further on, where the
    clearance is about H = h + J δ. Its rate is Ḣ = ḣ + Σ_j J_j (|q̇_j| / ā_j) a_j, so the row is
    Ḣ ≥ −γ H; the full brake a_j = −ā_j sign q̇_j has Ḣ = ḣ − J q̇ = 0 for a fixed obstacle and
    satisfies it wherever H ≥ 0.

    Args:
        clearance: h, shape (k,) [m].
        gradient: J = ∂h/∂q, shape (k, n) [m/rad].
        rate: ḣ, shape (k,) [m/s].
        qd: Velocities, shape (n,) [rad/s].
        limits: Braking and approach.
    """
    k, n = gradient.shape
    matrix, bound = np.empty((k, n)), np.empty(k)
    for i in range(k):
        after = clearance[i]
        for j in range(n):
            after += gradient[i, j] * qd[j] * abs(qd[j]) / (2.0 * limits.braking[j])
            matrix[i, j] = gradient[i, j] * abs(qd[j]) / limits.braking[j]
        bound[i] = -limits.approach * after - rate[i]
    return Rows(matrix, bound)


@jit
def limited_torque(torque: np.ndarray, mass: np.ndarray, bias: np.ndarray, qd: np.ndarray,
                   lower: np.ndarray, upper: np.ndarray, margin: np.ndarray, rows: Rows,
                   limits: Limits) -> tuple[np.ndarray, int]:
    """Return the nearest torque that keeps the limits, shape (n,) [N·m], and what was done.

    Args:
        torque: What the law asks for, shape (n,) [N·m].
        mass: M at the centre of the parameter set, shape (n, n).
        bias: h there, shape (n,) [N·m].
        qd: Velocities, shape (n,) [rad/s].
        lower: Smallest accelerations, see `viability.acceleration_bounds`, shape (n,) [rad/s²].
        upper: Largest accelerations, likewise.
        margin: ε, shape (n,) [rad/s²].
        rows: Further rows on the accelerations.
        limits: Torque limits.
    """
    n, k = torque.size, rows.bound.size
    inverse = np.linalg.inv(mass)
    wanted = np.zeros(n)
    for i in range(n):
        for j in range(n):
            wanted[i] += inverse[i, j] * (torque[j] - bias[j])
    matrix, bound = np.zeros((4 * n + k, n)), np.empty(4 * n + k)
    for i in range(n):
        room = min(margin[i], MARGIN_SHARE * max(upper[i] - lower[i], 0.0))
        low, high = lower[i] + room, upper[i] - room
        if low > high:  # not viable any more: the fastest way back
            low = high = 0.5 * (low + high)
        matrix[i, i], bound[i] = 1.0, low
        matrix[n + i, i], bound[n + i] = -1.0, -high
        for j in range(n):
            matrix[2 * n + i, j] = mass[i, j]
            matrix[3 * n + i, j] = -mass[i, j]
        bound[2 * n + i] = -limits.torque[i] - bias[i]
        bound[3 * n + i] = -limits.torque[i] + bias[i]
    for i in range(k):
        matrix[4 * n + i], bound[4 * n + i] = rows.matrix[i], rows.bound[i]
    softness, multipliers = np.zeros(4 * n + k), np.empty(4 * n + k)
    solution, steps = solve(inverse, wanted, matrix, bound, softness, multipliers)
    if steps == 0:
        return torque, IDLE
    state = ACTIVE
    if steps < 0:
        state = SOFTENED
        scale = SOFTNESS * np.trace(inverse) / n
        for i in range(4 * n + k):
            if i < 2 * n or i >= 4 * n:
                length = 0.0
                for j in range(n):
                    length += matrix[i, j] * matrix[i, j]
                softness[i] = scale * length
        solution, steps = solve(inverse, wanted, matrix, bound, softness, multipliers)
    result = np.empty(n)
    for i in range(n):
        value = bias[i]
        for j in range(n):
            value += mass[i, j] * solution[j]
        if steps < 0 or not math.isfinite(value):
            value, state = bias[i] - DAMPING * qd[i], BRAKING
        result[i] = min(max(value, -limits.torque[i]), limits.torque[i])
    return result, state
