# SPDX-License-Identifier: Apache-2.0
"""Facts about least squares over positive definite pseudo-inertias."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.pseudo_inertia import BASIS, inertial_parameters, pseudo_inertias
from adaptive_blf_control.identification.log_det_fit import log_det_fit, Positive

PRIOR = pseudo_inertias(np.array([
    [2.0, 0.2, 0.0, 0.4, 0.3, 0.01, 0.3, 0.0, 0.02, 0.2],
    [1.0, 0.0, 0.1, 0.0, 0.05, 0.0, 0.04, 0.01, 0.0, 0.06]]))
NONE = Positive(np.zeros(0, dtype=int), np.zeros(0), np.zeros(0))
ONE = Positive(np.array([20]), np.array([0.5]), np.array([0.01]))


def start(positive: Positive = NONE) -> np.ndarray:
    return np.append(inertial_parameters(PRIOR).ravel(), positive.centre)


def objective(x: np.ndarray, hessian: np.ndarray, moment: np.ndarray,
              positive: Positive) -> float:
    """Return the objective as the module's docstring states it."""
    value = 0.5 * x @ hessian @ x - moment @ x
    for body, prior in zip(pseudo_inertias(x[:20].reshape(2, 10)), PRIOR, strict=True):
        value += np.trace(body @ np.linalg.inv(prior)) - np.log(np.linalg.det(body))
    small = x[positive.place]
    return float(value + positive.weight @ (small / positive.centre - np.log(small)))


def problem(seed: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return data that pull the bodies out of what is possible."""
    random = np.random.default_rng(seed)
    rows = random.normal(size=(size, size))
    return rows.T @ rows, rows.T @ (rows @ random.normal(size=size))


def test_without_data_the_prior_is_the_answer() -> None:
    fit = log_det_fit(np.zeros((21, 21)), np.zeros(21), PRIOR, ONE, start(ONE))
    np.testing.assert_allclose(fit.x, start(ONE), atol=1e-12)


@pytest.mark.parametrize('weight', [1.0, 1e4])
@pytest.mark.parametrize('seed', range(4))
def test_the_gradient_of_the_objective_is_zero_at_the_answer(seed: int, weight: float) -> None:
    hessian, moment = problem(seed, 21)
    hessian, moment = weight * hessian, weight * moment
    fit = log_det_fit(hessian, moment, PRIOR, ONE, start(ONE))
    assert np.linalg.eigvalsh(pseudo_inertias(fit.x[:20].reshape(2, 10))).min() > 0.0
    assert fit.x[20] > 0.0
    inverse = np.linalg.inv(fit.hessian)
    gradient = np.array([_slope(fit.x, axis, hessian, moment) for axis in np.eye(21)])
    assert gradient @ inverse @ gradient < 1e-5  # the squared Newton decrement


def _slope(x: np.ndarray, axis: np.ndarray, hessian: np.ndarray, moment: np.ndarray) -> float:
    """Return the slope along an axis, the barrier's in closed form."""
    slope = axis @ (hessian @ x - moment)
    bodies = pseudo_inertias(x[:20].reshape(2, 10))
    for body, prior, change in zip(bodies, PRIOR, np.tensordot(axis[:20].reshape(2, 10), BASIS, 1),
                                   strict=True):
        slope += np.trace(change @ (np.linalg.inv(prior) - np.linalg.inv(body)))
    return float(slope + axis[20] * ONE.weight[0] * (1.0 / ONE.centre[0] - 1.0 / x[20]))


def test_no_other_point_is_better() -> None:
    hessian, moment = problem(7, 21)
    fit = log_det_fit(hessian, moment, PRIOR, ONE, start(ONE))
    best = objective(fit.x, hessian, moment, ONE)
    random, compared = np.random.default_rng(8), 0
    for _ in range(200):
        other = fit.x + random.normal(scale=10.0 ** random.uniform(-4.0, -1.0), size=21)
        if other[20] > 0.0 and np.linalg.eigvalsh(
                pseudo_inertias(other[:20].reshape(2, 10))).min() > 0.0:
            compared += 1
            assert objective(other, hessian, moment, ONE) >= best - 1e-9
    assert compared > 20


def test_the_second_derivative_is_that_of_the_objective() -> None:
    hessian, moment = problem(9, 21)
    fit = log_det_fit(hessian, moment, PRIOR, ONE, start(ONE))
    step = 1e-6
    for axis in np.eye(21):
        ahead, behind = (np.array([_slope(fit.x + sign * step * axis, other, hessian, moment)
                                   for other in np.eye(21)]) for sign in (1.0, -1.0))
        np.testing.assert_allclose((ahead - behind) / (2.0 * step), fit.hessian @ axis,
                                   rtol=1e-3, atol=1e-3 * np.abs(fit.hessian).max())


def test_much_data_outweigh_the_prior() -> None:
    wanted = inertial_parameters(1.5 * PRIOR).ravel()
    fit = log_det_fit(1e8 * np.eye(20), 1e8 * wanted, PRIOR, NONE, start())
    np.testing.assert_allclose(fit.x, wanted, rtol=1e-4, atol=1e-6)
