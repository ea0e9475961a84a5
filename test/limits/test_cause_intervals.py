# SPDX-License-Identifier: Apache-2.0
"""Facts about the intervals of causes: they hold the truth whatever was recorded."""

from __future__ import annotations

from hypothesis import given, settings, strategies as st
import numpy as np
from numpy.testing import assert_allclose
import pytest
from scipy.optimize import linprog

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.limits.cause_intervals import CauseIntervals
from adaptive_blf_control.limits.prior import prior_of
from recorded_pairs import recorded_pairs

ARM = TwoLinkArm()
DELTA = np.array([0.3, 0.1])


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 40), error=st.floats(0.01, 2.0),
       scale=st.floats(1e-3, 30.0), corner=st.booleans())
@settings(max_examples=200, deadline=None)
def test_the_true_causes_are_in_their_intervals_whatever_was_recorded(seed, count, error, scale,
                                                                     corner):
    random = np.random.default_rng(seed)
    prior = prior_of(ARM, mass_error=error)
    z = random.uniform(-1.0, 1.0, prior.generators.shape[1])
    z = np.sign(z) if corner else z
    known = CauseIntervals(prior, DELTA)
    for _ in range(3):  # what was found stays, though the pairs are others
        assert known.update(*recorded_pairs(
            random, ARM, prior.centre + prior.generators @ z, count, DELTA, scale))
        assert (known.least - 1e-7 <= z).all()
        assert (z <= known.most + 1e-7).all()


def _exact(known: CauseIntervals, regressors: np.ndarray,
           torques: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest z that a solver of linear programs finds."""
    prior = known.prior
    rows = regressors.reshape(-1, prior.centre.size) @ prior.generators
    values = (torques - regressors @ prior.centre).reshape(-1)
    delta = np.tile(DELTA, len(torques))
    ends = [[linprog(sign * axis, np.vstack([rows, -rows]),
                     np.concatenate([values + delta, delta - values]),
                     bounds=(-1.0, 1.0)).fun * sign for axis in np.eye(rows.shape[1])]
            for sign in (1.0, -1.0)]
    return np.array(ends[0]), np.array(ends[1])


def test_the_intervals_are_nearly_those_of_the_linear_program():
    random = np.random.default_rng(4)
    known = CauseIntervals(prior_of(ARM, mass_error=0.3), DELTA)
    given_pairs = recorded_pairs(random, ARM, ARM.nominal, 30, 0.5 * DELTA)
    for _ in range(10):
        known.update(*given_pairs)
    least, most = _exact(known, *given_pairs)
    assert (known.least <= least + 1e-7).all()
    assert (known.most >= most - 1e-7).all()
    assert (known.most - known.least <= 1.3 * (most - least) + 1e-6).all()
    assert 0.1 < (most - least).max() < 1.5  # there is something to be found


def test_a_load_is_found_in_its_unit(panda: UrdfArm):
    random = np.random.default_rng(5)
    prior = prior_of(panda, mass_error=0.1, payload=3.0, friction=2.0)
    friction = np.array([0.5 if name.startswith('fv_') else 0.0 for name in panda.parameters])
    theta = panda.nominal + 2.0 * panda.payload_direction + friction
    known = CauseIntervals(prior, np.full(7, 0.1))
    for _ in range(2 * len(prior.causes)):
        assert known.update(*recorded_pairs(random, panda, theta, 60, np.full(7, 0.1), 0.5))
    bounds = known.bounds()
    load, viscous = bounds.names.index('payload'), bounds.names.index('fv_panda_joint2')
    assert bounds.least[load] <= 2.0 <= bounds.most[load] < bounds.least[load] + 0.5
    assert bounds.least[viscous] <= 0.5 <= bounds.most[viscous] < bounds.least[viscous] + 0.5
    assert_allclose([bounds.least[0], bounds.most[0]], [0.9, 1.1], atol=0.1)


def test_pairs_that_contradict_the_prior_give_it_back():
    random = np.random.default_rng(6)
    known = CauseIntervals(prior_of(ARM, mass_error=0.1), DELTA)
    assert known.update(*recorded_pairs(random, ARM, ARM.nominal, 30, DELTA))
    assert (known.most - known.least).min() < 1.0
    assert not known.update(*recorded_pairs(random, ARM, 2.0 * ARM.nominal, 30, DELTA))
    assert_allclose([known.least, known.most], [[-1.0] * 5, [1.0] * 5])


def test_no_pairs_say_nothing():
    known = CauseIntervals(prior_of(ARM), DELTA)
    assert known.update(np.zeros((0, 2, ARM.m)), np.zeros((0, 2)))
    assert_allclose([known.least, known.most], [[-1.0] * 5, [1.0] * 5])


@pytest.mark.parametrize(('error', 'payload'), [(0.3, 3.0), (0.1, 0.0)])
def test_a_prior_that_is_not_narrowed_is_the_prior_bit_for_bit(panda: UrdfArm, error, payload):
    prior = prior_of(panda, mass_error=error, payload=payload)
    count = len(prior.causes)
    same = prior.narrowed(-np.ones(count), np.ones(count))
    assert np.array_equal(same.centre, prior.centre)
    assert np.array_equal(same.generators, prior.generators)
    assert same.causes == prior.causes
