# SPDX-License-Identifier: Apache-2.0
"""Facts about the friction columns of an arm."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.joint_friction import finite_array, JointFriction
from adaptive_blf_control.errors import ParameterError


def test_columns_stand_in_the_order_of_the_names_behind_those_before() -> None:
    friction = JointFriction(['a', 'b'], {'viscous': [1.0, 2.0], 'coulomb': 3.0, 'offset': -4.0,
                                          'square_root': [5.0, 6.0]}, 0.02)
    assert friction.names == ('fv_a', 'fv_b', 'fc_a', 'fc_b', 'f0_a', 'f0_b', 'fs_a', 'fs_b')
    np.testing.assert_array_equal(friction.nominal, [1.0, 2.0, 3.0, 3.0, -4.0, -4.0, 5.0, 6.0])
    assert friction.first_columns(1).tolist() == [1, 3, 5, 7]


def test_all_but_the_constant_torque_dissipate() -> None:
    friction = JointFriction(['a'], {'viscous': 1.0, 'offset': 0.0, 'square_root': 0.0}, 0.02)
    assert friction.dissipates.tolist() == [True, False, True]


def test_kinds_that_were_not_chosen_are_zero() -> None:
    friction = JointFriction(['a', 'b'], {'offset': [1.0, 2.0]}, 0.02)
    assert friction.names == ('f0_a', 'f0_b')
    assert friction.first_columns(4).tolist() == [-1, -1, 4, -1]
    np.testing.assert_array_equal(friction.coefficients(np.array([5.0, 6.0])),
                                  [[0.0, 0.0], [0.0, 0.0], [5.0, 6.0], [0.0, 0.0]])


@pytest.mark.parametrize('value', [2.0, [2.0, 2.0], np.array([2.0, 2.0])])
def test_numbers_are_an_array_of_their_own_that_may_be_written_to(value) -> None:
    array = finite_array('viscous', value, 2)
    array[0] = 7.0
    assert array.tolist() == [7.0, 2.0]
    assert np.ravel(value)[0] == 2.0


@pytest.mark.parametrize('kind', ['viscous', 'coulomb', 'square_root'])
def test_friction_that_would_drive_the_joint_is_refused(kind: str) -> None:
    with pytest.raises(ParameterError, match=kind):
        JointFriction(['a'], {kind: -0.1}, 0.02)
