# SPDX-License-Identifier: Apache-2.0
"""Facts about what the data determine, and which motion would help."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.identification.confidence import (
    confidence,
    DETERMINED,
    helpful_motion,
    Motion,
    NOT,
    WEAKLY,
)
from adaptive_blf_control.identification.uncertainty import uncertainty
from spatial_arm import pairs, spatial_arm, true_theta


@pytest.fixture(scope='module')
def arm():
    return spatial_arm(friction_square_root=False)


def judged(arm, regressors, torques):
    return uncertainty(regressors, torques, np.arange(float(len(torques))), 0.1)


def told(arm, **changes):
    """Return what the words say about each parameter, by name."""
    theta = true_theta(arm)
    regressors, torques = pairs(arm, theta, **changes)
    return dict(zip(arm.parameters, confidence(
        arm, theta, judged(arm, regressors, torques), regressors), strict=True))


def test_rich_motion_determines_everything(arm):
    assert set(told(arm, noise=0.01).values()) == {DETERMINED}


def test_friction_of_a_joint_that_stands_is_not_determined(arm):
    words = told(arm, noise=0.01, still=('bend',))
    assert words['fv_bend'] == words['fc_bend'] == words['Ia_bend'] == NOT
    assert words['fv_lift'] == DETERMINED


def test_noise_makes_small_parameters_weak(arm):
    assert WEAKLY in told(arm, noise=30.0, count=40).values()


@pytest.mark.parametrize(('name', 'kind'), [('fv_bend', 'speeds'), ('Ia_bend', 'reversals')])
def test_the_motion_that_helps_moves_the_joint_in_question(arm, name, kind):
    regressors, torques = pairs(arm, true_theta(arm), noise=0.01, still=('bend',))
    assert helpful_motion(arm, judged(arm, regressors, torques), [name]) == {
        Motion('bend', kind): [name]}


def test_gravity_shows_in_a_slow_motion_through_the_range(arm):
    theta = true_theta(arm)
    regressors, torques = pairs(arm, theta, noise=0.01, still=('lift', 'bend'))
    motion, = helpful_motion(arm, judged(arm, regressors, torques), ['bend.mx'])
    assert motion.kind == 'range'


def test_with_nothing_to_improve_no_motion_helps(arm):
    regressors, torques = pairs(arm, true_theta(arm), noise=0.01)
    assert helpful_motion(arm, judged(arm, regressors, torques), []) == {}
