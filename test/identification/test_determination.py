# SPDX-License-Identifier: Apache-2.0
"""Facts about which parameters the data leave open, with and without noise."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.determination import undetermined
from adaptive_blf_control.identification.identifier import Identifier

T = np.arange(0.0, 4.0, 1e-3)


def learned(noise: float, **changes) -> Identifier:
    """Return an identifier that saw joint 1 swing while joint 2 stands still."""
    arm, random = TwoLinkArm(), np.random.default_rng(0)
    still = np.full_like(T, 0.3)
    q = np.column_stack([0.5 * np.sin(2.0 * T) + 0.3 * np.sin(5.1 * T), still])
    qd = np.column_stack([np.cos(2.0 * T) + 1.53 * np.cos(5.1 * T), 0.0 * T])
    qdd = np.column_stack([-2.0 * np.sin(2.0 * T) - 7.803 * np.sin(5.1 * T), 0.0 * T])
    tau = np.array([arm.X(*state, state[1], acceleration) @ arm.nominal
                    for state, acceleration in zip(zip(q, qd), qdd)])
    qd = qd + noise * random.normal(size=qd.shape)
    identifier = Identifier(arm, **changes)
    identifier.learn(T, q, qd, tau)
    return identifier


@pytest.mark.parametrize('noise', [0.0, 1e-9, 1e-7, 1e-6])
def test_friction_of_a_joint_that_stands_still_is_open_whatever_its_velocity_noise(noise):
    assert 'fv_joint2' in learned(noise).undetermined


def test_what_lacks_rank_is_never_called_determined():
    gram = np.diag([1.0, 1.0, 1e-9])
    assert undetermined(gram, 'abc') == ()
    assert undetermined(gram, 'abc', rank=2) == ('c',)
    turned = np.array([[1.0, 1.0 - 1e-9], [1.0 - 1e-9, 1.0]])
    assert undetermined(turned, 'ab', rank=1) == ('a', 'b')


def test_parameters_of_different_units_are_compared_fairly():
    assert undetermined(np.diag([1.0, 1e-8]), 'ab') == ()


@pytest.mark.parametrize(('t', 'reason'), [
    (1e3 * T, 'no sample could be used'), (0.0 * T, 'no sample could be used'),
    (T[::-1], 'not in the order of time')])
def test_a_log_of_which_no_sample_can_be_used_is_refused(t, reason):
    identifier = Identifier(TwoLinkArm())
    zeros = np.zeros((T.size, 2))
    with pytest.raises(ParameterError, match=reason):
        identifier.learn(t, zeros, zeros, zeros)


def test_the_representation_tells_what_was_not_used():
    identifier = learned(0.0)
    assert 'dropped' not in repr(identifier)
    identifier.update(T[-1], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    assert '1 samples dropped' in repr(identifier)
    identifier.update(T[-1] + 9.0, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    assert '2 restarts of the filter' in repr(identifier)
