# SPDX-License-Identifier: Apache-2.0
"""Facts about standard deviations and intervals."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.identification.uncertainty import (
    integral_correlation_time,
    LEVEL,
    NORMAL,
    uncertainty,
)

TIME = 0.3  # s, correlation time of what is simulated
STEP = 0.05  # s, between pairs


def rows(count: int = 300, seed: int = 1) -> np.ndarray:
    """Return regressors that change as slowly as a motion does, shape (count, 2, 4)."""
    t = STEP * np.arange(count)
    random = np.random.default_rng(seed)
    rates, phases = random.uniform(0.5, 6.0, (2, 4)), random.uniform(0.0, 6.0, (2, 4))
    return np.sin(np.multiply.outer(t, rates) + phases)


def noise(random: np.random.Generator, count: int, correlation: float) -> np.ndarray:
    """Return noise of unit variance with ρ = exp(−t/T), shape (count, 2)."""
    keep = np.exp(-STEP / correlation) if correlation else 0.0
    result = random.normal(size=(count, 2))
    for i in range(1, count):
        result[i] = keep * result[i - 1] + np.sqrt(1.0 - keep ** 2) * result[i]
    return result


@pytest.mark.parametrize(('correlation', 'memory'), [(0.0, 0.01 * STEP), (TIME, STEP)])
def test_intervals_hold_as_often_as_they_are_to(correlation: float, memory: float) -> None:
    """Over 300 draws of the noise, whose correlation time nobody tells."""
    regressors, theta = rows(), np.array([1.0, -2.0, 0.5, 3.0])
    random, held, told = np.random.default_rng(2), [], []
    times, other = STEP * np.arange(len(regressors)), rows(40, seed=5)
    for _ in range(300):
        torques = regressors @ theta + [0.5, 2.0] * noise(random, len(regressors), correlation)
        judged = uncertainty(regressors, torques, times, memory)
        estimate = np.linalg.lstsq(regressors.reshape(-1, 4), torques.ravel(), rcond=None)[0]
        held.append(np.abs(estimate - theta) <= NORMAL * judged.std)
        told.append(np.abs(other @ (estimate - theta)) <= judged.half_width(other,
                                                                            measured=False))
    assert LEVEL - 0.05 <= np.mean(held) <= LEVEL + 0.03
    assert LEVEL - 0.05 <= np.mean(told) <= LEVEL + 0.03


def test_the_integral_correlation_time_is_that_of_the_noise() -> None:
    random = np.random.default_rng(3)
    times = np.cumsum(random.uniform(0.02, 0.08, 2000))
    found = [integral_correlation_time(noise(random, 2000, each), STEP * np.arange(2000), 0.05)
             for each in (0.1, 0.8)]
    np.testing.assert_allclose(found, [[0.1, 0.1], [0.8, 0.8]], rtol=0.5)
    white = integral_correlation_time(random.normal(size=(2000, 2)), times, 0.05)
    np.testing.assert_array_equal(white, 0.05)  # never below what the filters remember


def test_residuals_that_are_alike_widen_the_intervals() -> None:
    regressors = rows()
    torques = noise(np.random.default_rng(3), len(regressors), TIME)
    times = STEP * np.arange(len(regressors))
    shuffled = np.random.default_rng(4).permutation(times)  # as if there were no order
    alone, alike = (uncertainty(regressors, torques, each, STEP) for each in (shuffled, times))
    assert np.all(alone.std < 0.7 * alike.std)
    np.testing.assert_allclose(alone.alike, 1.0, atol=0.05)
    assert np.all(alike.alike > 4.0)


def test_covariance_is_the_sandwich_with_the_kernel_written_out() -> None:
    regressors = rows(40)
    random = np.random.default_rng(4)
    times = np.cumsum(random.uniform(0.01, 0.2, 40))
    torques = random.normal(size=(40, 2))
    inverse = np.linalg.inv(np.einsum('pjm,pjk->mk', regressors, regressors))
    estimate = inverse @ np.einsum('pjm,pj->m', regressors, torques)
    variance = np.mean((torques - regressors @ estimate) ** 2, axis=0) / (1.0 - 4 / 80)
    shuffled = random.permutation(40)
    judged = uncertainty(regressors[shuffled], torques[shuffled], times[shuffled], 0.5)
    correlation = judged.correlation_time
    meat = np.zeros((4, 4))
    for j in range(2):
        kernel = np.exp(-np.abs(times[:, None] - times) / correlation[j])
        meat += variance[j] * regressors[:, j].T @ kernel @ regressors[:, j]
    np.testing.assert_allclose(judged.covariance, inverse @ meat @ inverse, rtol=1e-9)
    np.testing.assert_allclose(judged.residual ** 2, variance, rtol=1e-9)


def test_pairs_of_unknown_time_count_as_independent() -> None:
    regressors = rows(40)
    torques = np.random.default_rng(5).normal(size=(40, 2))
    unknown = uncertainty(regressors, torques, np.full(40, np.nan), TIME)
    far = uncertainty(regressors, torques, 1e3 * np.arange(40), TIME)
    np.testing.assert_allclose(unknown.covariance, far.covariance, rtol=1e-12)


def test_what_is_not_shown_has_no_bound() -> None:
    regressors = rows(40)
    regressors[:, :, 2] = 0.0
    regressors[:, :, 3] = 2.0 * regressors[:, :, 1]
    torques = np.random.default_rng(6).normal(size=(40, 2))
    judged = uncertainty(regressors, torques, STEP * np.arange(40), TIME)
    assert np.isfinite(judged.std).tolist() == [True, False, False, False]
    assert judged.condition == np.inf
    seen, unseen = np.array([[3.0, 1.0, 0.0, 2.0]]), np.array([[3.0, 1.0, 0.0, -2.0]])
    assert np.isfinite(judged.half_width(seen)).all()
    assert np.isinf(judged.half_width(unseen)).all()


def test_what_the_model_does_not_explain_is_judged_on_what_was_left_out() -> None:
    """Twenty parameters for few equations: the residuals alone are far too small."""
    random = np.random.default_rng(7)
    regressors = random.normal(size=(60, 1, 20))
    theta = random.normal(size=20)
    torques = regressors @ theta + random.normal(size=(60, 1))
    judged = uncertainty(regressors, torques, np.arange(60.0), 0.1)
    estimate = np.linalg.lstsq(regressors[:, 0], torques[:, 0], rcond=None)[0]
    assert np.sqrt(np.mean((torques - regressors @ estimate) ** 2)) < 0.9
    assert judged.unexplained[0] > 1.0


def test_condition_is_that_of_columns_of_length_one() -> None:
    regressors = rows(40) * np.array([1.0, 1e3, 1e-3, 1.0])
    judged = uncertainty(regressors, np.zeros((40, 2)), np.arange(40.0), 1.0)
    stacked = regressors.reshape(-1, 4)
    expected = np.linalg.cond(stacked / np.linalg.norm(stacked, axis=0))
    assert judged.condition == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize('count', [1, 2, 9])
def test_few_pairs_are_judged_without_a_complaint(count: int) -> None:
    torques = np.random.default_rng(8).normal(size=(count, 2))
    judged = uncertainty(rows(count), torques, np.arange(float(count)), 0.1)
    assert np.isfinite(judged.unexplained).all()
    assert (judged.std > 0.0).all()
    np.testing.assert_array_equal(np.isfinite(judged.std).all(), count > 1)


def dry_friction(count=400):
    """Return pairs of two joints that slide to and fro: of each its load and tanh(q̇/v_s)."""
    random = np.random.default_rng(3)
    regressors = np.zeros((count, 2, 4))
    regressors[:, 0, :2] = np.column_stack([random.normal(size=count), np.sign(
        random.normal(size=count))])
    regressors[:, 1, 2:] = random.normal(size=(count, 2))
    torques = regressors @ [2.0, -3.0, 1.0, 0.5] + random.normal(0.0, 0.1, (count, 2))
    return uncertainty(regressors, torques, np.arange(float(count)), 0.1, (1, -1))


@pytest.mark.parametrize(('sliding', 'unknown'), [(1.0, 0.0), (-1.0, 0.0), (0.5, 1.5),
                                                   (0.0, 3.0), (-0.2, 2.4)])
def test_a_joint_that_sticks_has_any_friction_up_to_its_full_size(sliding, unknown):
    judged = dry_friction()
    row = np.zeros((2, 4))
    row[0, 1] = sliding
    without = judged._replace(coulomb=np.zeros((2, 4)))
    random = np.random.default_rng(8)
    normal = random.normal(0.0, without.half_width(row)[0] / NORMAL, 200_000)
    error = np.abs(normal + random.uniform(-unknown, unknown, normal.size))
    assert (error <= judged.half_width(row)[0]).mean() == pytest.approx(0.95, abs=0.003)
    assert judged.half_width(row)[1] == without.half_width(row)[1]
    np.testing.assert_array_equal(judged.half_width(row, measured=False),
                                  without.half_width(row, measured=False))


def test_an_interval_at_rest_is_no_wider_than_the_friction():
    judged = dry_friction()
    assert 0.95 * 3.0 < judged.half_width(np.zeros((2, 4)))[0] < 3.0
    assert judged.half_width(np.zeros((2, 4)))[1] < 0.3
