# SPDX-License-Identifier: Apache-2.0
"""Facts about obstacles behind the filter: links do not touch them, whatever torque is asked."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.control.constraints import Constraints, MotionState
from adaptive_blf_control.control.safety_filter import FilterSample
from adaptive_blf_control.control.sets import Bounds
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError, SetViolation
from adaptive_blf_control.limits.filter_step import SOFTENED
from adaptive_blf_control.limits.limit_constraints import ClearanceConstraint
from adaptive_blf_control.limits.safety_filter import LimitsFilter

pytest.importorskip('pinocchio')

JOINT = """<joint name="j{i}" type="revolute"><parent link="l{before}"/><child link="l{i}"/>
<origin xyz="{x} 0 {z}"/><axis xyz="{axis}"/><dynamics damping="1"/>
<limit lower="-2.5" upper="2.5" effort="80" velocity="3"/></joint>
<link name="l{i}"><inertial><mass value="{mass}"/><origin xyz="0.2 0 0"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial></link>"""
URDF = '<robot name="arm"><link name="l0"/>' + ''.join(
    JOINT.format(i=i, before=i - 1, x=x, z=z, axis=axis, mass=mass)
    for i, x, z, axis, mass in ((1, 0.0, 0.3, '0 0 1', 4), (2, 0.0, 0.1, '0 1 0', 3),
                                (3, 0.4, 0.0, '0 1 0', 2))) + '</robot>'
LIMIT = np.array([60.0, 80.0, 40.0])
SPHERES = [2.0, 0.2, 0.0, 0.0, 0.06, 3.0, 0.0, 0.0, 0.0, 0.06, 3.0, 0.2, 0.0, 0.0, 0.06,
           3.0, 0.4, 0.0, 0.0, 0.06]
OBSTACLES = {'spheres': [0.3, 0.5, 0.4, 0.12], 'half_spaces': [0.0, 0.0, 0.15, 0.0, 0.0, 1.0]}
POLICIES = {'into the sphere': (40.0, 0.0, 0.0), 'onto the table': (0.0, 60.0, 30.0),
            'both at once': (40.0, 40.0, 30.0)}


def made(**obstacles):
    arm = UrdfArm(URDF, ['j1', 'j2', 'j3'])
    settings = ControllerSettings(
        safety_filter='limits', torque_limit=LIMIT, safety={'lower': -2.0, 'upper': 2.0},
        limits={'prior': {'mass_error': 0.1}, 'braking': 6.0, 'link_spheres': SPHERES,
                'period': 0.002, 'obstacles': obstacles or OBSTACLES}).resolved(joints=3)
    return arm, settings, LimitsFilter(arm, settings)


def driven(policy):
    """Push the arm with a torque for half a second; print the smallest clearance and kinds."""
    arm, settings, filter_ = made()
    truth, near = arm.dynamics(1.1 * arm.nominal), filter_.constraints[1]
    q, qd, least = np.zeros(3), np.zeros(3), np.inf
    for k in range(250):
        wanted = np.clip(arm.X(q, 0.0 * q, 0.0 * q, 0.0 * q) @ arm.nominal + POLICIES[policy],
                         -LIMIT, LIMIT)
        torque = filter_.filtered(FilterSample(0.002 * k, q, qd, wanted, -LIMIT, LIMIT))
        q, qd = truth.advance(q, qd, torque, 0.002)
        least = min(least, near.bounded(_state(q)).margin().min())
    print(least, filter_.counts[SOFTENED], np.abs(q).max())


def _state(q):
    return MotionState(0.0, q, q, q, Bounds(q, q, q, q))


@pytest.mark.parametrize('policy', POLICIES)
def test_obstacles_are_not_touched_whatever_torque_is_asked(policy, repository):
    # Uncompiled: to compile what is called here takes longer than to run it.
    path = [str(Path(__file__).parent), str(repository), os.environ.get('PYTHONPATH', '')]
    done = subprocess.run(
        [sys.executable, '-c', f'import test_obstacles_kept as t; t.driven({policy!r})'],
        env={**os.environ, 'NUMBA_DISABLE_JIT': '1', 'PYTHONPATH': os.pathsep.join(path)},
        capture_output=True, text=True, check=True)
    least, softened, moved = map(float, done.stdout.split())
    assert least >= 0.0
    assert least < 0.06  # it was pushed there
    assert softened == 0
    assert moved > 0.1


def test_a_row_of_numbers_that_is_no_obstacle_is_refused():
    for name, value in (('spheres', [0.1, 0.2, 0.3]), ('half_spaces', [0.0] * 6),
                        ('boxes', [0.0, 0.0, 0.0, 1.0, 1.0, -1.0]),
                        ('spheres', [0.0, 0.0, float('nan'), 0.1])):
        with pytest.raises(ParameterError, match='obstacles|half_space|box|sphere'):
            made(**{name: value})


def test_an_obstacle_that_contains_the_arm_at_the_start_is_refused_with_the_distance():
    _, _, filter_ = made(spheres=[0.4, 0.0, 0.4, 0.2])
    near = filter_.constraints[1]
    assert isinstance(near, ClearanceConstraint)
    with pytest.raises(SetViolation, match='arm.*start distance outside the clearance set'):
        Constraints([near], ('j1', 'j2', 'j3')).check_start(_state(np.zeros(3)))
