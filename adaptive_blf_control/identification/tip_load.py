# SPDX-License-Identifier: Apache-2.0
"""A load at the tip as the only thing that has changed: few parameters, known after a moment.

A rigid body on the last link changes θ by B p, p its ten inertial parameters. With θ_s as it was
before, r = τ_f − Y_f θ_s is Y_f B p for one constant p, whatever the motion: p is the Bayesian
mean of the pairs since, each weighted with what the change monitor expects of r², pairs within
the memory of the filters counting as one. What pushes from outside is no such r: it depends on
where the arm is and obeys no gravity, so that the p of the pairs before does not predict it. That
is tested, pair by pair, before the pair counts.

Ten free numbers would leave more open after half a second than a wrist of 5e-4 kg·m² can bear.
Before any pair speaks, the centre of the mass m is therefore within ``REACH`` of the origin of the
link, and the inertia that of m in this point, with a radius of gyration of ``GYRATION`` about it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.compiled import borrowed, jit, jit_apart
from adaptive_blf_control.linear_algebra import inverse, matrix_product, product

__all__ = ['TipLoad', 'certain_part', 'fit_tip_load', 'forget_tip_load', 'load_directions',
           'new_tip_load', 'open_torque']

MASS, REACH = 5.0, 0.2  # kg, m: standard deviations before anything is known
GYRATION = 0.1  # m: its square is the deviation of the inertia about that centre, over m
LEAST_MASS = 0.5  # kg: another load of the same mass may have another centre
_SCALES = MASS * np.array([1.0, *3 * (REACH,), *6 * (REACH ** 2,)])
CAP = 500.0  # d² of a pair that counts at most
START = 4.0  # d² before the first pair: a load that predicts all is not made to wait


class TipLoad(NamedTuple):
    """The load and what is known of it; arrays are changed in place.

    Attributes:
        directions: B, each column scaled by the standard deviation of its p, shape (m, k).
        base: θ_s without the load, shape (m,).
        information: Σ Bᵀ Y_fᵀ W Y_f B, shape (k, k).
        moment: Σ Bᵀ Y_fᵀ W r, shape (k,).
        inverse: The covariance of p, shape (k, k).
        found: p, shape (k,).
        applied: The p that θ̂ and the recorded pairs have, shape (k,).
        statistic: Windowed mean of the d² with which p is predicted, shape (n,).
    """

    directions: np.ndarray
    base: np.ndarray
    information: np.ndarray
    moment: np.ndarray
    inverse: np.ndarray
    found: np.ndarray
    applied: np.ndarray
    statistic: np.ndarray


def load_directions(arm: Any) -> np.ndarray:
    """Return what a load at the tip changes in θ, in scaled columns, shape (m, k).

    Ten for an arm that knows its base parameters, a point mass for one that has a
    ``payload_direction``, none for any other.
    """
    standard = getattr(arm, 'base_from_standard', None)
    last = getattr(arm, 'last_body', None)
    if standard is not None and last is not None:
        result = np.zeros((arm.m, PER_BODY))
        result[:len(standard)] = standard[:, PER_BODY * last:PER_BODY * (last + 1)] * _SCALES
        return result
    point = getattr(arm, 'payload_direction', None)
    return np.zeros((arm.m, 0)) if point is None else MASS * np.reshape(point, (-1, 1))


def new_tip_load(n: int, directions: np.ndarray) -> TipLoad:
    """Return a fit without pairs, for n joints and B of shape (m, k)."""
    m, k = directions.shape
    return TipLoad(np.ascontiguousarray(directions), np.zeros(m), np.zeros((k, k)), np.zeros(k),
                   np.eye(k), np.zeros(k), np.zeros(k), np.zeros(n))


@jit
def forget_tip_load(fit: TipLoad, base: np.ndarray) -> None:
    """Begin again from θ_s = ``base``, shape (m,)."""
    fit = borrowed(fit)
    fit.base[:] = base
    fit.information[:] = 0.0
    fit.moment[:] = 0.0
    fit.found[:] = 0.0
    fit.applied[:] = 0.0
    fit.statistic[:] = START
    fit.inverse[:] = 0.0
    for i in range(fit.found.size):
        fit.inverse[i, i] = 1.0


@jit_apart
def fit_tip_load(fit: TipLoad, part: float, gain: float, regressor: np.ndarray, torque: np.ndarray,
             scale: np.ndarray) -> None:
    """Test a pair against p, then let it count.

    Args:
        fit: The load; changed in place.
        part: How much of a pair this one is: the interval over the memory of the filters, ≤ 1.
        gain: Of the windowed mean.
        regressor: Y_f, shape (n, m).
        torque: τ_f, shape (n,) [N·m].
        scale: What the change monitor expects of r², shape (n,) [N²·m²].
    """
    fit = borrowed(fit)
    seen = matrix_product(regressor, fit.directions)
    rest = torque - product(regressor, fit.base)
    error = rest - product(seen, fit.found)
    spread = np.sum(matrix_product(seen, fit.inverse) * seen, axis=1)
    square = np.minimum(error * error / (scale + spread), CAP)
    fit.statistic[:] = fit.statistic + gain * (square - fit.statistic)
    weighted = (part / scale).reshape(-1, 1) * seen
    fit.information[:] = fit.information + matrix_product(seen.T, weighted)
    fit.moment[:] = fit.moment + product(weighted.T, rest)
    mean, weight = _expected(fit)
    fit.inverse[:] = inverse(np.diag(weight) + fit.information)
    fit.found[:] = product(fit.inverse, fit.moment + weight * mean)


@jit
def _expected(fit: TipLoad) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and inverse variance of p for a body with the mass and centre that it has.

    In scaled columns, shape (k,) each; that of a load with a mass alone is 0 ± 1.
    """
    fit = borrowed(fit)
    k = fit.found.size
    mean, weight = np.zeros(k), np.ones(k)
    if k != PER_BODY:
        return mean, weight
    mass, open_mass = MASS * fit.found[0], MASS * math.sqrt(max(fit.inverse[0, 0], 0.0))
    most = abs(mass) + open_mass + LEAST_MASS
    x, y, z = MASS * REACH * fit.found[1], MASS * REACH * fit.found[2], MASS * REACH * fit.found[3]
    point = np.array([y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])
    scale = MASS * REACH ** 2
    mean[4:] = point * (mass / (mass ** 2 + open_mass ** 2) / scale)
    weight[1:4] = max(MASS / most, 1.0) ** 2
    weight[4:] = max(scale / (most * GYRATION ** 2), 1.0) ** 2
    return mean, weight


@jit
def certain_part(fit: TipLoad) -> np.ndarray:
    """Return p without what may as well be zero: p_i³/(p_i² + s_i²), s_i its deviation, (k,)."""
    fit = borrowed(fit)
    square = fit.found ** 2
    return fit.found * square / (square + np.diag(fit.inverse) + 1e-300)


@jit
def open_torque(fit: TipLoad, regressors: np.ndarray) -> np.ndarray:
    """Return the variance that p leaves to the torque of pairs, (P, n, m) → (n,) [N²·m²]."""
    fit = borrowed(fit)
    count, n, _ = regressors.shape
    total = np.zeros(n)
    for j in range(count):
        seen = matrix_product(regressors[j], fit.directions)
        total += np.sum(matrix_product(seen, fit.inverse) * seen, axis=1)
    return total / count
