# SPDX-License-Identifier: Apache-2.0
"""Facts about the arm's own limits against the settings."""

from __future__ import annotations

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.control.arm_limits import limit_warnings

SETTINGS = door.ControllerSettings(
    torque_limit=50.0, safety={'lower': [-2.0, -1.5], 'upper': [2.0, 1.5]},
    reference={'joint1': {'amplitude': [0.5, 0.2], 'frequency': [2.0, -4.0],
                          'phase': [0.0, 0.0]}})


@pytest.fixture
def arm():
    """Return an arm with limits that the settings just keep."""
    subject = door.TwoLinkArm()
    subject.position_lower, subject.position_upper = np.array([-2.0, -1.5]), np.array([2.0, 1.5])
    subject.velocity_limit, subject.torque_limit = np.full(2, 1.8), np.full(2, 50.0)
    return subject


def test_an_arm_without_limits_and_settings_within_them_give_no_warning(arm):
    assert list(limit_warnings(door.TwoLinkArm(), SETTINGS)) == []
    assert list(limit_warnings(arm, SETTINGS)) == []


@pytest.mark.parametrize(('name', 'value', 'text'), [
    ('position_lower', [-2.0, -1.4], "joint 'joint2': the safety set -1.5 .. 1.5 rad goes beyond "
                                     'the limits of the arm, -1.4 .. 1.5 rad'),
    ('position_upper', [1.9, 1.5], "joint 'joint1': the safety set -2 .. 2 rad goes beyond the "
                                   'limits of the arm, -2 .. 1.9 rad'),
    ('velocity_limit', [1.79, 0.1], "joint 'joint1': the reference may reach 1.8 rad/s, the limit "
                                    'of the arm is 1.79 rad/s'),
    ('torque_limit', [50.0, 49.0], "joint 'joint2': torque_limit 50 N·m is above the limit of the "
                                   'arm, 49 N·m')])
def test_a_limit_that_the_settings_go_beyond_is_named_with_both_numbers(arm, name, value, text):
    setattr(arm, name, np.array(value))
    assert list(limit_warnings(arm, SETTINGS)) == [text]


@pytest.mark.parametrize('given', [{'velocity': [0.1, 0.1]},
                                   {'obstacles': {'spheres': [0.5, 0.0, 0.5, 0.2]}}])
def test_limits_that_no_safety_filter_keeps_are_named(given):
    name = 'velocity' if 'velocity' in given else 'obstacles.spheres'
    text = (f"nothing keeps limits.{name}: safety_filter is 'none', safety_filter='limits' keeps "
            'them')
    idle = SETTINGS.replace(limits=given)
    assert list(limit_warnings(door.TwoLinkArm(), idle)) == [text]
    assert list(limit_warnings(door.TwoLinkArm(), idle.replace(safety_filter='limits'))) == []
    controller = door.Controller(door.TwoLinkArm(), idle)
    assert controller.notes == (text,)
    assert repr(controller).endswith(', see its note>')
