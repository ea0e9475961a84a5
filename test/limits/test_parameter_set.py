# SPDX-License-Identifier: Apache-2.0
"""Facts about the parameter set: θ* is in it whatever was recorded; it says when it cannot."""

from __future__ import annotations

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.parameter_set import ParameterSet
from adaptive_blf_control.limits.prior import Prior, prior_of
from recorded_pairs import recorded_pairs

ARM = TwoLinkArm()
DELTA = np.array([0.3, 0.1])


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60), error=st.floats(0.01, 2.0),
       scale=st.floats(1e-3, 30.0), corner=st.booleans())
@settings(max_examples=300, deadline=None)
def test_the_true_parameters_are_in_the_set_whatever_was_recorded(seed, count, error, scale,
                                                                  corner):
    random = np.random.default_rng(seed)
    prior = prior_of(ARM, mass_error=error)
    z = random.uniform(-1.0, 1.0, prior.generators.shape[1])
    theta = prior.centre + prior.generators @ (np.sign(z) if corner else z)
    learned = ParameterSet(prior, DELTA)
    assert learned.contains(theta)
    assert learned.update(*recorded_pairs(random, ARM, theta, count, DELTA, scale))
    assert learned.contains(theta)
    rows = random.normal(size=(20, ARM.m))
    reach = np.abs(rows @ (theta - learned.centre))
    assert (reach <= learned.support(rows) * (1.0 + 1e-9)).all()


def test_the_support_is_reached_by_a_point_of_the_ellipsoid():
    random = np.random.default_rng(2)
    learned = ParameterSet(prior_of(ARM), DELTA)
    learned.update(*recorded_pairs(random, ARM, ARM.nominal, 200, DELTA))
    row = random.normal(size=(1, ARM.m))
    direction = learned.root @ (learned.root.T @ row[0])
    furthest = direction / np.linalg.norm(learned.root.T @ row[0])
    assert learned.contains(learned.centre + furthest * (1.0 - 1e-6))
    assert not learned.contains(learned.centre + furthest * (1.0 + 1e-6))
    np.testing.assert_allclose(learned.support(row), row @ furthest, rtol=1e-9)


def test_data_make_the_set_smaller_and_an_empty_history_gives_the_prior_back():
    random = np.random.default_rng(3)
    learned = ParameterSet(prior_of(ARM, mass_error=1.0), DELTA)
    before = learned.size
    learned.update(*recorded_pairs(random, ARM, ARM.nominal, 300, DELTA, 3.0))
    assert learned.size < 0.1 * before
    assert learned.update(np.empty((0, 2, ARM.m)), np.empty((0, 2)))
    assert learned.size == before
    np.testing.assert_array_equal(learned.centre, learned.prior.centre)


def test_data_of_an_arm_that_the_prior_excludes_are_noticed():
    random = np.random.default_rng(4)
    learned = ParameterSet(prior_of(ARM, mass_error=0.1), DELTA)
    assert not learned.update(*recorded_pairs(random, ARM, 2.0 * ARM.nominal, 300, DELTA, 3.0))
    np.testing.assert_array_equal(learned.centre, learned.prior.centre)


def test_data_worse_than_their_bound_are_noticed():
    random = np.random.default_rng(5)
    learned = ParameterSet(prior_of(ARM), DELTA)
    regressors, torques = recorded_pairs(random, ARM, ARM.nominal, 300, DELTA)
    assert not learned.update(regressors, torques + 3.0 * DELTA * random.choice([-1, 1], (300, 2)))


@pytest.mark.parametrize('delta', [[0.0, 1.0], [np.nan, 1.0], [-1.0, 1.0]])
def test_a_bound_that_is_none_is_refused(delta):
    with pytest.raises(ParameterError, match='unexplained'):
        ParameterSet(prior_of(ARM), np.array(delta))


def test_the_prior_has_the_nominal_arm_and_those_within_its_errors():
    prior = prior_of(ARM, mass_error=0.2)
    assert prior.contains(ARM.nominal)
    assert prior.contains(1.2 * ARM.nominal)
    assert not prior.contains(1.21 * ARM.nominal)


def test_friction_of_a_prior_reaches_from_none_to_its_largest():
    prior = prior_of(ARM, mass_error=0.1, friction=8.0)
    for friction, known in ((0.0, True), (8.0, True), (8.1, False), (-0.1, False)):
        theta = ARM.nominal.copy()
        theta[3:] = friction
        assert prior.contains(theta) is known


@pytest.mark.parametrize(('changes', 'name'), [
    ({'mass_error': -0.1}, 'mass_error'), ({'payload': np.inf}, 'payload'),
    ({'friction': np.nan}, 'friction'), ({'payload': 1.0}, 'payload'),
    ({'mass_error': 0.0}, 'mass_error')])
def test_a_prior_that_cannot_be_is_refused(changes, name):
    with pytest.raises(ParameterError, match=name):
        prior_of(ARM, **changes)


def test_a_payload_and_link_masses_of_a_urdf_arm_are_in_its_prior(panda):
    prior = prior_of(panda, mass_error=0.3, payload=3.0)
    random = np.random.default_rng(6)
    for _ in range(20):
        scaled = panda.inertial * random.uniform(0.7, 1.3, (panda.n, 1))
        theta = np.concatenate([panda.base_from_inertial(scaled),
                                panda.nominal[panda.base_count:]])
        assert prior.contains(theta + random.uniform(0.0, 3.0) * panda.payload_direction)
        rows = random.normal(size=(5, panda.m))
        assert (np.abs(rows @ (theta - prior.centre)) <= prior.support(rows) + 1e-9).all()
    assert not prior.contains(panda.nominal + 5.0 * panda.payload_direction)


def test_a_zonotope_reaches_as_far_as_its_corners():
    prior = Prior(np.zeros(2), np.array([[1.0, 0.5], [0.0, 2.0]]))
    np.testing.assert_allclose(prior.support(np.array([[1.0, 0.0], [1.0, -1.0]])), [1.5, 2.5])
