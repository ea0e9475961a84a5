# SPDX-License-Identifier: Apache-2.0
"""A load is found beside the model of the arm without it, and known when it comes and goes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from adaptive_blf_control.arms.load_frame import load_map
from adaptive_blf_control.arms.pseudo_inertia import pseudo_inertias
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.payload import PayloadEstimate, PayloadEstimator
from spatial_arm import spatial_arm, true_theta

PERIOD = 0.01
NOISE = 0.1  # N·m
RATES = np.array([2.1, 3.3, 4.7])


def inertial(mass: float, com: tuple[float, float, float] = (0.02, -0.01, 0.05)) -> np.ndarray:
    """Return the ten parameters of a ball of 5 cm radius, shape (10,)."""
    c = np.array(com)
    about = mass * (0.4 * 0.05 ** 2 * np.eye(3) + c @ c * np.eye(3) - np.outer(c, c))
    return np.array([mass, *(mass * c), about[0, 0], about[0, 1], about[1, 1], about[0, 2],
                     about[1, 2], about[2, 2]])


@cache
def motion() -> tuple[np.ndarray, np.ndarray]:
    """Return times, shape (N,) [s], and regressors along 20 s of sinusoids, (N, n, m)."""
    arm, t = spatial_arm(), PERIOD * np.arange(1, 2001)
    return t, np.array([arm.Y(0.8 * np.sin(RATES * s), 0.8 * RATES * np.cos(RATES * s),
                              -0.8 * RATES ** 2 * np.sin(RATES * s)) for s in t])


def estimator(**changes) -> PayloadEstimator:
    arm = spatial_arm()
    return PayloadEstimator(load_map(arm, 'tool'), true_theta(arm), 0.05, **changes)


def run(found: PayloadEstimator, loads: dict[float, np.ndarray], noise: float = NOISE,
        ) -> Iterator[tuple[float, PayloadEstimate]]:
    """Move the arm with each load from its time on, and yield every judgement."""
    (t, regressors), theta = motion(), true_theta(spatial_arm())
    columns, random = load_map(spatial_arm(), 'tool'), np.random.default_rng(1)
    for s, regressor in zip(t, regressors):
        begun = [load for begin, load in loads.items() if begin <= s]
        torque = regressor @ (theta + columns @ (begun[-1] if begun else np.zeros(10)))
        if found.take(s, regressor, torque + random.normal(scale=noise, size=3)):
            assert found.estimate is not None
            yield s, found.estimate


def test_mass_and_centre_of_a_load_are_found_within_three_seconds() -> None:
    judged = list(run(estimator(), {5.0: inertial(1.5)}))
    assert not any(each.attached for t, each in judged if t < 5.0)
    after = [each for t, each in judged if t <= 8.0][-1]
    assert after.attached
    assert 5.0 - 0.26 <= after.since <= 5.5
    assert after.load.mass == pytest.approx(1.5, rel=0.05)
    np.testing.assert_allclose(after.load.com, (0.02, -0.01, 0.05), atol=0.01)
    last = judged[-1][1]
    assert abs(last.load.mass - 1.5) < 4.0 * last.std.mass < 0.2
    assert last.std.mass < after.std.mass


def test_a_load_that_is_there_in_the_first_block_was_attached_once() -> None:
    found = estimator()
    judged = list(run(found, {0.0: inertial(4.0)}, noise=0.02))
    assert judged[0][1].attached
    assert found.changes == 1
    assert judged[-1][1].since == judged[0][1].since


def test_that_a_load_is_removed_is_noticed() -> None:
    found = estimator()
    judged = list(run(found, {0.0: inertial(1.5), 10.0: inertial(0.0)}))
    assert [each.attached for t, each in judged if 5.0 < t < 10.0] == [True] * 20
    assert not any(each.attached for t, each in judged if t > 11.5)
    last = judged[-1][1]
    assert last.load.mass == 0.0
    assert last.since == pytest.approx(10.0, abs=0.5)
    assert np.isinf(last.std.com).all()
    assert not found.added_torque(motion()[1][0]).any()


def test_another_load_replaces_the_first() -> None:
    judged = list(run(estimator(), {0.0: inertial(1.0), 10.0: inertial(2.5)}))
    assert [each.load.mass for t, each in judged if t < 10.0][-1] == pytest.approx(1.0, rel=0.05)
    assert judged[-1][1].load.mass == pytest.approx(2.5, rel=0.05)
    assert judged[-1][1].since == pytest.approx(10.0, abs=0.5)


def test_what_was_before_an_attachment_that_was_lost_in_noise_is_left_out() -> None:
    """With it in the same segment the mass is a fifth too small for many seconds."""
    judged = list(run(estimator(), {3.1: inertial(1.0)}, noise=2.0))
    assert not any(each.attached for t, each in judged if t < 3.1)
    first = next(each for _, each in judged if each.attached)
    assert first.since == pytest.approx(3.0, abs=0.26)
    assert first.load.mass == pytest.approx(1.0, rel=0.1)
    assert judged[-1][1].load.mass == pytest.approx(1.0, rel=0.05)


def test_a_load_is_no_surer_for_errors_that_happen_to_be_small_at_first() -> None:
    """The errors of a model are alike for seconds: what was known of their size still counts."""
    (t, regressors), theta = motion(), true_theta(spatial_arm())
    added = load_map(spatial_arm(), 'tool') @ inertial(1.5)
    random, found = np.random.default_rng(1), estimator()
    for s, regressor in zip(t[t < 12.0], regressors):
        noise = random.normal(scale=0.5, size=3) * (s < 10.0)
        found.take(s, regressor, regressor @ (theta + added * (s >= 10.0)) + noise)
    assert found.estimate is not None
    assert found.estimate.attached
    assert found.estimate.std.mass > 0.058  # 0.067; 0.047 where a second of before counts


def test_noise_alone_is_no_load() -> None:
    found = estimator()
    assert not any(each.attached for _, each in run(found, {}, noise=1.0))
    assert found.changes == 0


def test_no_load_is_above_what_may_be_there_unnoticed() -> None:
    """The mass that is said not to be exceeded falls, and the load is at no time above it."""
    judged = [each for _, each in run(estimator(), {0.0: inertial(1.0)}, noise=3.0)]
    assert judged[0].undecided
    assert not judged[0].attached
    assert all(each.most > 1.0 for each in judged)
    without = [each for _, each in run(estimator(), {})]
    assert not without[-1].undecided
    assert without[-1].most < 0.1 < without[0].most


def test_a_load_is_a_body_that_can_be_however_noisy_the_torque() -> None:
    judged = [each for _, each in run(estimator(), {0.0: inertial(1.0)}, noise=3.0)]
    loads = [each.inertial for each in judged if each.attached]
    assert loads
    for pseudo in pseudo_inertias(np.array(loads)):
        assert np.linalg.eigvalsh(pseudo)[0] > 0.0


def test_the_torque_is_predicted_no_worse_than_without_the_load() -> None:
    found, errors = estimator(), []
    (t, regressors), theta = motion(), true_theta(spatial_arm())
    added = load_map(spatial_arm(), 'tool') @ inertial(1.5)
    random = np.random.default_rng(2)
    for s, regressor in zip(t, regressors):
        more = regressor @ added * (s >= 5.0) + random.normal(scale=NOISE, size=3)
        errors.append((more @ more, np.sum((more - found.added_torque(regressor)) ** 2)))
        found.take(s, regressor, regressor @ theta + more)
    without, along = np.cumsum(np.array(errors)[500:], axis=0).T
    assert (along <= without * (1.0 + 1e-9)).all()
    assert along[-1] < 0.1 * without[-1]


def test_what_a_single_posture_tells_is_no_load() -> None:
    """At rest any of many loads explains 2 N·m: none is certain, however long it lasts."""
    arm, found = spatial_arm(), estimator()
    still = arm.Y(np.array([0.0, 0.4, 0.3]), np.zeros(3), np.zeros(3))
    torque = still @ true_theta(arm) + np.array([0.0, -2.0, -2.0])
    for k in range(1, 2001):
        if found.take(PERIOD * k, still, torque):
            assert found.estimate is not None
            assert not found.estimate.attached
            assert found.estimate.undecided
            assert found.estimate.std.mass > 0.1


def test_samples_across_a_gap_make_no_block() -> None:
    (t, regressors), found = motion(), estimator()
    for k in range(0, 40, 10):  # 0.1 s apart: longer than the gap
        assert not found.take(t[k], regressors[k], np.zeros(3))
    assert found.estimate is None


def test_a_sample_without_torque_is_not_taken() -> None:
    arm = spatial_arm()
    identifier = Identifier(arm, history={'size': arm.m},
                            filter={'time_constant': 0.05, 'settle': 1.0})
    found = PayloadEstimator(load_map(arm, 'tool'), true_theta(arm), identifier.memory)
    for k in range(200):
        s = PERIOD * k
        identifier.update(s, 0.8 * np.sin(RATES * s), 0.8 * RATES * np.cos(RATES * s),
                          np.full(3, np.nan))
        assert not found.follow(s, identifier)
    assert found.estimate is None
    assert identifier.dropped['not finite'] == 200


@pytest.mark.parametrize('changes', [{'scale': 0.0}, {'period': np.nan}])
def test_numbers_that_cannot_be_are_refused(changes) -> None:
    with pytest.raises(ParameterError, match='> 0'):
        estimator(**changes)
