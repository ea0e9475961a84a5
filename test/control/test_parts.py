# SPDX-License-Identifier: Apache-2.0
"""Facts about what a reference may ask for."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.parts import controller_parts
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.control.way import way_through
from adaptive_blf_control.errors import ParameterError

JOINTS = ('joint1', 'joint2')


def _settings(**changes) -> ControllerSettings:
    return ControllerSettings.taken(None, changes)


@pytest.mark.parametrize(('amplitude', 'frequency', 'words'), [
    ([0.5], [1000.0], 'asks for 500 rad/s'), ([0.1], [100.0], 'asks for 1000 rad/s²'),
    ([0.2, -0.3], [40.0, -42.0], 'asks for 20.6 rad/s')])
def test_a_reference_beyond_its_limits_is_refused_with_the_numbers(amplitude, frequency, words):
    swing = {'amplitude': amplitude, 'frequency': frequency, 'phase': [0.0] * len(amplitude)}
    with pytest.raises(ParameterError, match=words) as error:
        controller_parts(_settings(reference={'joint2': swing}), JOINTS)
    assert error.value.name == 'controller.reference.joint2'


def test_a_trajectory_beyond_the_limits_of_the_reference_is_refused_with_joint_and_numbers():
    controller = Controller(TwoLinkArm(), safety={'lower': -2.0, 'upper': 2.0},
                            performance={'lower': -0.1, 'upper': 0.1})
    rest = np.zeros(2)
    goal = ReferencePoint(np.array([0.1, 1.0]), rest, rest)
    controller.retune(0.0, rest, **{'reference.acceleration_limit': 50.0})
    with pytest.raises(ParameterError, match=r"57\.74 rad/s² of joint 'joint2'"):
        way_through([(0.316227766, goal)], controller, 0.0)
    way_through([(1.0, goal)], controller, 0.0)


def test_one_phase_is_that_of_all_sinusoids_of_a_joint():
    swing = {'amplitude': [0.3, 0.1], 'frequency': [2.0, 3.0]}
    one, each = (controller_parts(_settings(reference={'joint1': {**swing, 'phase': phase}}),
                                  JOINTS).reference.at(0.7) for phase in ([0.4], [0.4, 0.4]))
    np.testing.assert_array_equal(one, each)
    for change, said in (({'frequency': [1.0] * 3}, '2 of amplitude, 3 of frequency, 1 of phase'),
                         ({'amplitude': [0.3]}, '1 of amplitude, 2 of frequency, 1 of phase')):
        with pytest.raises(ParameterError, match=said):
            controller_parts(_settings(reference={'joint1': {**swing, **change}}), JOINTS)
