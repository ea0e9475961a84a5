# SPDX-License-Identifier: Apache-2.0
"""How far the acceleration may be from that of a model, for every θ* that is possible.

With M_c a + h_c = τ of the model θc, the true acceleration a* of M* a* + h* = τ + d fulfils

    a* − a = −M*⁻¹ (Y(q, q̇, a)(θ* − θc) − d),

d being what no θ explains, |d_i| ≤ δ_i. Where M_least ⪯ M* ⪯ M_most, M*⁻¹ lies between
N − R and N + R with 2N = M_least⁻¹ + M_most⁻¹, 2R = M_least⁻¹ − M_most⁻¹ ⪰ 0. So

    |a* − a|_i ≤ |N e|_i + √(R_ii) √(eᵀ R e)

(Cauchy-Schwarz in R), e the bracket; both are bounded over the zonotope of θ* by the sum over its
generators, the second as a norm. Over a sample of length h under a held
torque the acceleration moves on by about a_h − a, that of the model at the end of the sample; all
of it is added, twice what the mean over the sample takes: the rest is for what of it depends on
θ*, and for the velocity between the samples.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.mass_and_bias import mass, mass_and_bias
from adaptive_blf_control.arms.regressors import law_regressor
from adaptive_blf_control.compiled import jit
from adaptive_blf_control.linear_algebra import inverse, matrix_product, product

__all__ = ['acceleration_error', 'Model', 'model_inverses', 'no_posture', 'Posture']


class Model(NamedTuple):
    """An arm with the set of its parameters.

    Attributes:
        arm: As `regressors` knows it.
        centre: Model with θc, see `mass_and_bias`.
        least: Model with M_least ⪯ M*.
        most: Model with M* ⪯ M_most.
        generators: D of the zonotope around θc that θ* is in, shape (m, ν).
        unexplained: δ, shape (n,) [N·m].
    """

    arm: Any
    centre: Any
    least: Any
    most: Any
    generators: np.ndarray
    unexplained: np.ndarray


class Posture(NamedTuple):
    """Matrices of the model in a state.

    Attributes:
        inertia: M_c, shape (n, n) [kg·m²].
        bias: h_c, shape (n,) [N·m].
        compliance: M_c⁻¹, shape (n, n) [1/(kg·m²)].
        middle: N, shape (n, n) [1/(kg·m²)].
        radius: R, shape (n, n) [1/(kg·m²)].
    """

    inertia: np.ndarray
    bias: np.ndarray
    compliance: np.ndarray
    middle: np.ndarray
    radius: np.ndarray


def no_posture(n: int) -> Posture:
    """Return what stands for no posture of ``n`` joints where compiled functions ask for one."""
    none = np.zeros((n, n))
    return Posture(none, np.zeros(n), none, none, none)


@jit
def model_inverses(model: Model, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return N and R at a posture, shape (n,) [rad]."""
    n = q.size
    middle, radius = np.zeros((n, n)), np.zeros((n, n))
    for end in range(2):
        part = inverse(mass(model.least if end == 0 else model.most, q))
        for i in range(n):
            for j in range(n):
                middle[i, j] += 0.5 * part[i, j]
                radius[i, j] += (0.5 - end) * part[i, j]
    return middle, radius


@jit
def _energy(model: Model, radius: np.ndarray, moved: np.ndarray) -> float:
    """Return a bound of √(eᵀ R e); ``moved`` is Y D, shape (n, ν)."""
    n, total = radius.shape[0], 0.0
    for g in range(moved.shape[1]):
        value = 0.0
        for i in range(n):
            for j in range(n):
                value += moved[i, g] * radius[i, j] * moved[j, g]
        total += math.sqrt(max(value, 0.0))
    for j in range(n):
        total += model.unexplained[j] * math.sqrt(max(radius[j, j], 0.0))
    return total


@jit
def acceleration_error(model: Model, posture: Posture, q: np.ndarray, qd: np.ndarray,
                       a: np.ndarray, torque: np.ndarray, period: float) -> np.ndarray:
    """Return a bound of |a* − a| at any time of a sample, shape (n,) [rad/s²].

    Args:
        model: The arm with its set.
        posture: Matrices of the model at q and qd.
        q: Positions at the begin, shape (n,) [rad].
        qd: Velocities at the begin, shape (n,) [rad/s].
        a: Acceleration of the model there, shape (n,) [rad/s²].
        torque: Held, shape (n,) [N·m].
        period: h [s].
    """
    moved = matrix_product(law_regressor(model.arm, q, qd, qd, a), model.generators)
    spread, energy = matrix_product(posture.middle, moved), _energy(model, posture.radius, moved)
    n = q.size
    result = np.zeros(n)
    for i in range(n):
        for g in range(spread.shape[1]):
            result[i] += abs(spread[i, g])
        for j in range(n):
            result[i] += abs(posture.middle[i, j]) * model.unexplained[j]
    later, speed, drive = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        result[i] += math.sqrt(max(posture.radius[i, i], 0.0)) * energy
        later[i] = q[i] + period * (qd[i] + 0.5 * period * a[i])
        speed[i] = qd[i] + period * a[i]
    inertia, bias = mass_and_bias(model.centre, later, speed)
    for i in range(n):
        drive[i] = torque[i] - bias[i]
    held = product(inverse(inertia), drive)
    for i in range(n):
        result[i] += abs(held[i] - a[i])
    return result
