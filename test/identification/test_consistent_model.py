# SPDX-License-Identifier: Apache-2.0
"""Facts about the physically consistent model of recorded pairs."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.pseudo_inertia import pseudo_inertias
from adaptive_blf_control.identification.consistent_model import consistent_model, has_links
from spatial_arm import pairs, spatial_arm, true_theta


@pytest.fixture(scope='module')
def arm():
    return spatial_arm()


@pytest.fixture(scope='module')
def theta(arm):
    return true_theta(arm)


def least_squares(regressors, torques):
    return np.linalg.lstsq(regressors.reshape(-1, regressors.shape[2]), torques.ravel(),
                           rcond=None)[0]


def masses_positive(arm, theta) -> bool:
    postures = np.random.default_rng(6).uniform(-3.0, 3.0, (100, arm.n))
    return all(np.linalg.eigvalsh(arm.mass_matrix(q, theta))[0] > 0.0 for q in postures)


def test_exact_data_of_a_possible_robot_give_that_robot(arm, theta):
    model = consistent_model(arm, *pairs(arm, theta))
    np.testing.assert_allclose(model.theta, theta, atol=2e-3)
    assert model.kept == ()


def test_it_is_a_robot_where_the_estimate_is_none(arm, theta):
    regressors, torques = pairs(arm, theta, count=60, noise=3.0)
    assert not masses_positive(arm, least_squares(regressors, torques))
    model = consistent_model(arm, regressors, torques)
    assert masses_positive(arm, model.theta)
    assert np.linalg.eigvalsh(pseudo_inertias(model.inertial)).min() > 0.0
    assert model.rotor.min() > 0.0
    assert model.theta[arm.base_count:][arm.dissipates].min() > 0.0


def test_its_theta_is_that_of_its_links_and_rotors(arm, theta):
    model = consistent_model(arm, *pairs(arm, theta, count=60, noise=1.0))
    np.testing.assert_allclose(model.theta[:arm.base_count],
                               arm.base_from_inertial(model.inertial, model.rotor), atol=1e-12)
    assert model.estimate == dict(zip(arm.parameters, model.theta.tolist(), strict=True))


def test_it_predicts_other_motions_better_than_the_estimate(arm, theta):
    regressors, torques = pairs(arm, theta, count=30, noise=2.0)
    other, exact = pairs(arm, theta, seed=11)
    free, model = (np.sqrt(np.mean((other @ each - exact) ** 2)) for each in (
        least_squares(regressors, torques), consistent_model(arm, regressors, torques).theta))
    assert model < 0.9 * free


def test_what_the_data_do_not_show_stays_as_described_and_is_named(arm, theta):
    model = consistent_model(arm, *pairs(arm, theta, noise=0.01, still=('bend',)))
    assert {'fv_bend', 'fc_bend', 'fs_bend', 'Ia_bend'} <= set(model.kept)
    assert 'fv_lift' not in model.kept
    place = arm.parameters.index('f0_lift')
    assert model.share[place] > 0.99
    still = consistent_model(arm, *pairs(arm, theta, still=arm.joints))
    described = spatial_arm().inertial
    np.testing.assert_allclose(still.inertial[0, 4:7], described[0, 4:7], rtol=0.05)


def test_joints_count_by_how_well_they_are_explained(arm, theta):
    regressors, torques = pairs(arm, theta, count=100)
    random = np.random.default_rng(12)
    torques = torques + random.normal(size=torques.shape) * [20.0, 0.01, 0.01]
    model = consistent_model(arm, regressors, torques)
    other, exact = pairs(arm, theta, seed=13)
    error = np.sqrt(np.mean((other @ model.theta - exact) ** 2, axis=0))
    free = np.sqrt(np.mean((other @ least_squares(regressors, torques) - exact) ** 2, axis=0))
    assert error[2] < 0.1 * free[2]
    assert error[2] < 0.02  # as its noise allows, whatever that of the first one is


def test_pairs_that_are_alike_count_less(arm, theta):
    data = pairs(arm, theta, count=60, noise=0.5)
    alike, independent = (consistent_model(arm, *data, count).std for count in (25.0, 1.0))
    assert np.all(alike >= independent)
    assert np.median(alike / independent) > 1.5


def test_only_an_arm_with_links_can_have_one(arm):
    from adaptive_blf_control.arms.two_link import TwoLinkArm
    assert has_links(arm)
    assert not has_links(TwoLinkArm())
