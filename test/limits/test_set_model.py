# SPDX-License-Identifier: Apache-2.0
"""Facts about the model of the safety filter: its set is the prior, or what is left of it."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose
import pytest

from adaptive_blf_control.arms.mass_and_bias import mass, mass_and_bias, model_of
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.control.limit_settings import PriorSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.acceleration_error import (
    acceleration_error,
    model_inverses,
    Posture,
)
from adaptive_blf_control.limits.cause_intervals import CauseBounds
from adaptive_blf_control.limits.set_model import SetModel
from adaptive_blf_control.linear_algebra import inverse


def model_with(arm: UrdfArm, mass_error: float, payload: float, friction: float) -> SetModel:
    """Return the model of a prior."""
    return SetModel(arm, PriorSettings(mass_error=mass_error, payload=payload, friction=[friction],
                                       unexplained=[0.1]).resolved(joints=arm.n))


@pytest.fixture(name='whole')
def _whole(panda: UrdfArm) -> SetModel:
    return model_with(panda, 0.3, 3.0, 2.0)


def bounds_of(model: SetModel, least: np.ndarray, most: np.ndarray) -> CauseBounds:
    """Return a box of z in the units of the causes."""
    causes = model.prior.causes
    middle, half = (np.array([getattr(cause, name) for cause in causes])
                    for name in ('middle', 'half'))
    return CauseBounds(tuple(cause.name for cause in causes), middle + half * least,
                       middle + half * most)


def boxes(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a box within that of the prior."""
    ends = np.sort(np.random.default_rng(seed).uniform(-1.0, 1.0, (2, count)), axis=0)
    return ends[0], ends[1]


@pytest.mark.parametrize('seed', range(20))
def test_inertia_and_acceleration_of_every_arm_of_the_box_are_within_the_bounds(panda, whole,
                                                                               seed):
    random = np.random.default_rng(100 + seed)
    least, most = boxes(seed, len(whole.prior.causes))
    model = whole.narrowed(bounds_of(whole, least, most))
    z = random.choice([least, most, random.uniform(least, most)])
    theta = whole.prior.centre + whole.prior.generators @ z
    q, qd, qdd = random.normal(size=(3, 7))
    value = model.handle.value
    light, heavy = mass(value.least, q), mass(value.most, q)
    own = mass(model_of(panda, theta), q)
    assert np.linalg.eigvalsh(own - light).min() > -1e-9
    assert np.linalg.eigvalsh(heavy - own).min() > -1e-9
    inertia, bias = mass_and_bias(value.centre, q, qd)
    middle, radius = model_inverses(value, q)
    torque = inertia @ qdd + bias
    posture = Posture(inertia, bias, inverse(inertia), middle, radius)
    error = acceleration_error(value, posture, q, qd, qdd, torque, 0.0)
    true = np.linalg.solve(own, torque - panda.X(q, qd, qd, np.zeros(7)) @ theta)
    assert (np.abs(true - qdd) <= error + 1e-9).all()


def test_a_narrower_box_leaves_less_error(whole):
    random = np.random.default_rng(3)
    count = len(whole.prior.causes)
    narrow = whole.narrowed(bounds_of(whole, np.full(count, -0.2), np.full(count, 0.2)))
    assert narrow.part == pytest.approx(0.2)
    q, qd, qdd = random.normal(size=(3, 7))
    errors = []
    for model in (whole, narrow):
        value = model.handle.value
        inertia, bias = mass_and_bias(value.centre, q, qd)
        posture = Posture(inertia, bias, inverse(inertia), *model_inverses(value, q))
        errors.append(acceleration_error(value, posture, q, qd, qdd, inertia @ qdd + bias, 0.0))
    assert (errors[1] < 0.5 * errors[0]).all()


def test_nothing_known_is_the_model_of_the_prior_again(whole):
    count = len(whole.prior.causes)
    narrow = whole.narrowed(bounds_of(whole, np.full(count, -0.2), np.full(count, 0.2)))
    assert narrow is not whole
    assert narrow.narrowed(None) is whole
    assert narrow.narrowed(bounds_of(whole, -np.ones(count), np.ones(count))) is whole
    assert whole.part == 1.0


def test_bounds_that_are_hardly_narrower_change_nothing_and_wider_ones_do(whole):
    count = len(whole.prior.causes)
    narrow = whole.narrowed(bounds_of(whole, np.full(count, -0.2), np.full(count, 0.2)))
    assert narrow.narrowed(bounds_of(whole, np.full(count, -0.2), np.full(count, 0.199))) is narrow
    rounded = np.full(count, 0.2) + 1e-15  # as an end comes back from a message
    assert narrow.narrowed(bounds_of(whole, np.full(count, -0.2), rounded)) is narrow
    wider = narrow.narrowed(bounds_of(whole, np.full(count, -0.2), np.full(count, 0.201)))
    assert wider is not narrow
    assert_allclose(wider.known.generators, 0.2005 * whole.prior.generators)


def test_a_wider_prior_of_the_identifier_leaves_the_own_one(panda, whole):
    other = model_with(panda, 0.6, 6.0, 4.0)
    count = len(whole.prior.causes)
    assert whole.narrowed(bounds_of(other, -np.ones(count), np.ones(count))) is whole


def test_bounds_without_a_cause_are_refused_by_its_name(panda, whole):
    other = model_with(panda, 0.3, 0.0, 2.0)
    count = len(other.prior.causes)
    with pytest.raises(ParameterError, match=r'payload.*identifier\.parameter_set\.prior'):
        whole.narrowed(bounds_of(other, -np.ones(count), np.ones(count)))


def test_bounds_that_exclude_the_prior_are_refused_with_both_intervals(whole):
    count = len(whole.prior.causes)
    bounds = bounds_of(whole, -np.ones(count), np.ones(count))
    load = bounds.names.index('payload')
    bounds.least[load], bounds.most[load] = 3.5, 4.0
    with pytest.raises(ParameterError, match=r'payload of identifier/parameter_set.*\[3\.5, 4\.0\]'
                                             r'.*0 to 3'):
        whole.narrowed(bounds)
