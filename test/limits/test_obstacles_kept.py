# SPDX-License-Identifier: Apache-2.0
"""Facts about obstacles behind the filter: links do not touch them, whatever torque is asked."""

from __future__ import annotations

from copy import copy
import sys

import numpy as np
import pytest

from adaptive_blf_control.arms.chain import Chain
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.control.constraints import Constraints, MotionState
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.safety_filter import FilterSample
from adaptive_blf_control.control.sets import Bounds
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError, SetViolation
from adaptive_blf_control.limits.filter_step import ACTIVE, IDLE, SOFTENED
from adaptive_blf_control.limits.limit_constraints import ClearanceConstraint
from adaptive_blf_control.limits.link_spheres import LinkSpheres, sphere_centres
from adaptive_blf_control.limits.obstacles import sphere
from adaptive_blf_control.limits.safety_filter import LimitsFilter
from adaptive_blf_control.limits.scene import own_pairs, scene_of

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
POLICIES = {'onto the table': (0.0, 60.0, 30.0), 'both at once': (40.0, 40.0, 30.0)}


def made(**obstacles):
    arm = UrdfArm(URDF, ['j1', 'j2', 'j3'])
    settings = ControllerSettings(
        safety_filter='limits', torque_limit=LIMIT, safety={'lower': -2.0, 'upper': 2.0},
        performance={'lower': -0.15, 'upper': 0.15},
        limits={'prior': {'mass_error': 0.1}, 'braking': 6.0, 'link_spheres': SPHERES,
                'period': 0.002, 'obstacles': obstacles or OBSTACLES}).resolved(joints=3)
    return arm, settings, LimitsFilter(arm, settings)


def driven(policy):
    """Push the arm for a third of a second; return clearance, softened samples and motion."""
    arm, settings, filter_ = made()
    truth, near = arm.dynamics(1.1 * arm.nominal), filter_.constraints[1]
    q, qd, least = np.zeros(3), np.zeros(3), np.inf
    for k in range(180):
        wanted = np.clip(arm.X(q, 0.0 * q, 0.0 * q, 0.0 * q) @ arm.nominal + POLICIES[policy],
                         -LIMIT, LIMIT)
        torque = filter_.filtered(FilterSample(0.002 * k, q, qd, wanted, -LIMIT, LIMIT))
        q, qd = truth.advance(q, qd, torque, 0.002)
        least = min(least, near.bounded(_state(q)).margin().min())
    return least, filter_.counts[SOFTENED], np.abs(q).max()


def followed(safety_filter):
    """Swing through the sphere for 0.8 s; return clearance, e1, path time, samples let by."""
    arm, settings, _ = made()
    swing = {f'j{i}': {'amplitude': [1.0 * (i == 1)], 'frequency': [2.0]} for i in (1, 2, 3)}
    controller = Controller(
        arm, settings, safety_filter=safety_filter, k1=100.0, k2=[6.0, 6.0, 3.0],
        start=np.zeros(3), reference={'smooth_start': 0.5, **swing})
    truth, near = arm.dynamics(1.05 * arm.nominal), ClearanceConstraint(scene_of(
        arm, settings.limits))
    q, qd, least, error = np.zeros(3), np.zeros(3), np.inf, 0.0
    for k in range(420):
        output = controller.update(0.002 * k, q, qd, arm.nominal)
        least = min(least, near.bounded(_state(q)).margin().min())
        error = max(error, np.abs(output.e1).max())
        q, qd = truth.advance(q, qd, output.torque, 0.002)
    filter_ = controller.safety_filter
    return (least, error, controller.path_time(0.002 * k),
            filter_.counts[IDLE] if filter_ else 420)


def _state(q):
    return MotionState(0.0, q, q, q, Bounds(q, q, q, q))


@pytest.mark.parametrize('policy', POLICIES)
def test_obstacles_are_not_touched_whatever_torque_is_asked(policy):
    least, softened, moved = driven(policy)
    assert least >= 0.0
    assert least < 0.06  # it was pushed there
    assert softened == 0
    assert moved > 0.1


def test_the_governor_leads_the_arm_round_a_sphere_that_the_law_alone_enters():
    least, _, _, _ = followed('none')
    assert least < -0.05
    least, error, path_time, let_through = followed('limits')
    assert 0.0 < least < 0.05
    assert error < 0.05
    assert path_time > 0.9 * 0.838
    assert let_through == 420  # what the governor asks for, the filter has nothing against


def test_a_reference_that_is_asked_for_late_stops_before_an_obstacle_and_goes_on():
    arm, settings, _ = made()
    swing = {f'j{i}': {'amplitude': [1.0 * (i == 1)], 'frequency': [2.0]} for i in (1, 2, 3)}
    controller = Controller(arm, settings, start=np.zeros(3),
                            reference={'smooth_start': 0.5, **swing})
    governor, near = controller.safety_filter.governor, ClearanceConstraint(scene_of(
        arm, settings.limits))
    t, least, furthest, before = 0.0, np.inf, 0.0, np.zeros(3)
    for k in range(700):  # ten times as late as its torques are taken to be held, now and then
        before = governor.governed(t, before, controller.reference).point.position
        least = min(least, near.bounded(_state(before)).margin().min())
        furthest = max(furthest, governor.off)
        t += 0.002 if k % 12 else 0.02
    assert 0.015 < least < 0.05  # of a margin of 0.02
    assert furthest > 0.2  # the sphere is on the path
    assert governor.off < 0.02  # and the reference goes on with it where it has come back


def test_nothing_is_compiled_in_a_motion_beside_obstacles_after_the_warm_up():
    pytest.importorskip('numba')
    arm, settings, _ = made()
    swing = {f'j{i}': {'amplitude': [1.0 * (i == 1)], 'frequency': [2.0]} for i in (1, 2, 3)}
    controller = Controller(arm, settings, start=np.zeros(3),
                            reference={'smooth_start': 0.5, **swing})
    controller.warm_up(arm.nominal)
    before = _compiled()
    q = np.zeros(3)
    for k in range(200):
        output = controller.update(0.002 * k, q, np.zeros(3), arm.nominal)
        q = output.reference.position
        if k == 100:
            controller.safety_filter.see({'ball': sphere([0.9, 0.0, 0.4], 0.05)}, frozenset())
        if k == 150:  # held fast while the reference goes on: the filter has to act
            controller.update(0.002 * k + 0.001, q, np.array([3.0, 0.0, 0.0]), arm.nominal)
    assert sum(controller.safety_filter.counts[1:]) > 0
    assert _compiled() == before


def _compiled():
    """Return how many versions of each compiled function there are in this process."""
    return {f'{name}.{key}': len(value.overloads)
            for name, module in sys.modules.items() if name.startswith('adaptive_blf_control.')
            for key, value in vars(module).items() if hasattr(value, 'overloads')}


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


def test_an_obstacle_that_comes_is_kept_away_from_and_a_silence_stops_the_path():
    arm, settings, _ = made()
    swing = {f'j{i}': {'amplitude': [0.3 * (i == 1)], 'frequency': [2.0]} for i in (1, 2, 3)}
    controller = Controller(arm, settings, k1=100.0, k2=[6.0, 6.0, 3.0], start=np.zeros(3),
                            reference={'smooth_start': 0.5, **swing})
    filter_ = controller.safety_filter
    controller.update(0.0, np.zeros(3), np.zeros(3), arm.nominal)
    before = filter_.report.clearance
    for k in (1, 2):  # 20 mm a sample towards the tip, at 10 m/s no faster than stated
        filter_.see({'cart': sphere([1.1 - 0.02 * k, 0.0, 0.4], 0.1)}, frozenset())
        controller.update(0.002 * k, np.zeros(3), np.zeros(3), arm.nominal)
    assert filter_.report.clearance < min(before, 0.25)
    assert filter_.constraints[1].scene.obstacles.velocity[-1].tolist() == [-1.0, 0.0, 0.0]
    assert filter_.constraints[1].bounded(_state(np.zeros(3))).margin().min() == (
        filter_.report.clearance)
    assert filter_.complaint == ''
    for k in range(3, 400):  # nothing is heard for longer than half a second
        controller.update(0.002 * k, np.zeros(3), np.zeros(3), arm.nominal)
    assert 'nothing was heard' in filter_.complaint
    assert filter_.governor.pace.rate < 1e-6
    filter_.see({}, frozenset(['cart']))
    controller.update(0.8, np.zeros(3), np.zeros(3), arm.nominal)
    assert filter_.complaint == ''
    assert filter_.report.clearance == before


def overrun(filter_, torque_at, ball, velocity, duration):
    """Let a sphere come at an arm; return the least distances from it and from what stands [m].

    Args:
        filter_: Safety filter of the arm, which sees the sphere.
        torque_at: Returns the torque for a time, positions and velocities.
        ball: Where the sphere is at the begin [m].
        velocity: Of the sphere [m/s].
        duration: How long it comes [s].
    """
    arm, settings, _ = made()
    truth, near, still = arm.dynamics(1.05 * arm.nominal), filter_.constraints[1], None
    scene = scene_of(arm, settings.limits)
    q, qd, least = np.zeros(3), np.zeros(3), np.full(2, np.inf)
    for k in range(round(duration / 0.002)):
        place = np.array(ball) + 0.002 * k * np.array(velocity)
        torque = torque_at(0.002 * k, q, qd)
        still = still or ClearanceConstraint(near.scene)  # before the sphere is seen
        if k % 10 == 1:
            filter_.see({'ball': sphere(place.tolist(), 0.08)}, frozenset())
        q, qd = truth.advance(q, qd, torque, 0.002)
        apart = np.linalg.norm(sphere_centres(scene.chain, scene.spheres, q) - place, axis=1)
        least = np.minimum(least, [(apart - scene.spheres.radius).min() - 0.08,
                                   still.bounded(_state(q)).margin().min()])
    return least


def overrun_in_motion(ball, velocity, duration, **obstacles):
    """Return the distances of `overrun` for an arm that is to hold its posture, and the e1."""
    arm, settings, _ = made(**obstacles)
    controller = Controller(arm, settings, k1=100.0, k2=[6.0, 6.0, 3.0], start=np.zeros(3))
    errors = []

    def torque_at(t, q, qd):
        output = controller.update(t, q, qd, arm.nominal)
        errors.append(np.abs(output.e1).max())
        return output.torque

    least = overrun(controller.safety_filter, torque_at, ball, velocity, duration)
    return *least, max(errors)


FROM_SIDE = ([0.5, -0.6, 0.4], [0.0, 0.3, 0.0], 2.5)


def test_reference_and_arm_give_way_to_a_sphere_that_comes():
    comes, _, error = overrun_in_motion(*FROM_SIDE, spheres=[5.0, 5.0, 5.0, 0.1])
    assert 0.0 < comes < 0.15
    assert error < 0.05


def test_the_filter_alone_gives_way_to_a_sphere_that_comes():
    arm, _, filter_ = made(spheres=[5.0, 5.0, 5.0, 0.1])

    def standing(t, q, qd):
        weight = arm.X(q, 0.0 * q, 0.0 * q, 0.0 * q) @ arm.nominal
        wanted = np.clip(weight - 8.0 * qd, -LIMIT, LIMIT)
        return filter_.filtered(FilterSample(t, q, qd, wanted, -LIMIT, LIMIT))

    comes, _ = overrun(filter_, standing, *FROM_SIDE)
    assert 0.0 < comes < 0.05


def test_between_a_table_and_a_sphere_that_comes_the_arm_gives_way_along_the_table():
    comes, stands, error = overrun_in_motion(
        [0.5, 0.03, 0.9], [0.0, 0.0, -0.2], 2.2, half_spaces=[0.0, 0.0, 0.28, 0.0, 0.0, 1.0])
    assert comes > 0.0
    assert 0.0 < stands < 0.06
    assert error < 0.05


def test_between_two_that_come_nothing_else_gives_way():
    _, _, filter_ = made(spheres=[])
    state = FilterSample(0.0, np.zeros(3), np.zeros(3), np.zeros(3), -LIMIT, LIMIT)
    for k in range(3):
        filter_.filtered(state._replace(t=0.01 * k))
        filter_.see({side: sphere([0.8, side * (0.25 - 0.01 * k), 0.4], 0.08)
                     for side in (-1.0, 1.0)}, frozenset())
    filter_.filtered(state._replace(t=0.03))
    assert filter_.report.kind == ACTIVE
    assert 0.0 < filter_.report.clearance < 0.1


def test_what_is_watched_is_the_worst_since_the_last_call():
    _, _, filter_ = made()
    assert np.isnan(filter_.watch()).all()
    for qd in (0.0, 1.0, 0.0):
        filter_.filtered(FilterSample(0.0, np.zeros(3), np.array([qd, 0.0, 0.0]), np.zeros(3),
                                      -LIMIT, LIMIT))
        if qd:
            worst = filter_.report.stop_clearance
    watched = dict(zip(filter_.watched, filter_.watch()))
    assert watched['stop_clearance'] == worst
    assert watched['kind'] in (0.0, 1.0, 2.0, 3.0)
    assert {'j1.reserve', 'j2.reserve', 'j3.reserve', 'path_rate', 'path_off'} <= set(watched)


def test_links_with_three_joints_between_them_keep_apart_where_asked_for():
    chain = Chain(np.zeros((5, 3, 4)), np.zeros((5, 3)), np.zeros(5, dtype=bool),
                  np.arange(5), np.arange(5), np.zeros(3))
    spheres = LinkSpheres(np.array([1, 2, 4, 5]), np.zeros((4, 3)), np.ones(4))
    assert own_pairs(chain, spheres).tolist() == [[2, -1], [3, -1], [3, -2]]


def test_an_arm_that_may_not_go_on_as_it_wants_goes_on_as_far_as_a_stop_is_free():
    """Masses are uncertain, and torques count as held for three samples: little is free."""
    arm, settings, _ = made()
    settings = settings.replace(limits={'period': 0.006, 'prior': {'mass_error': 0.3}})
    swing = {f'j{i}': {'amplitude': [1.0 * (i == 1), 0.3], 'frequency': [2.0, 5.0]}
             for i in (1, 2, 3)}
    controller = Controller(arm, settings, k1=100.0, k2=[6.0, 6.0, 3.0], start=np.zeros(3),
                            reference={'smooth_start': 0.5, **swing})
    truth, q, qd, error = arm.dynamics(1.2 * arm.nominal), np.zeros(3), np.zeros(3), 0.0
    for k in range(1500):
        output = controller.update(0.002 * k, q, qd, arm.nominal)
        error = max(error, np.abs(output.e1).max())
        q, qd = truth.advance(q, qd, output.torque, 0.002)
    assert error < 0.15
    assert controller.safety_filter.counts[1] > 200  # the filter had to act
    assert controller.safety_filter.counts[2] < 100  # and seldom fell back on the stop
    assert controller.path_time(3.0) > 2.0


def test_a_copy_of_the_filter_moves_no_obstacle_of_the_filter_it_is_of():
    _, _, filter_ = made()
    state = FilterSample(0.0, np.zeros(3), np.zeros(3), np.zeros(3), -LIMIT, LIMIT)
    for t, x in ((0.0, 1.1), (0.02, 1.08), (0.04, 1.06)):
        filter_.filtered(state._replace(t=t))
        filter_.see({'cart': sphere([x, 0.0, 0.4], 0.1)}, frozenset())
    filter_.filtered(state._replace(t=0.041))
    trial, before = copy(filter_), filter_.report.clearance
    trial.filtered(state._replace(t=0.07))  # the sphere goes on at 1 m/s
    assert trial.report.clearance < before - 0.02
    filter_.filtered(state._replace(t=0.0411))
    assert filter_.report.clearance == pytest.approx(before, abs=1e-3)
    filter_.filtered(state._replace(t=0.07))
    assert filter_.report.clearance == pytest.approx(trial.report.clearance, abs=1e-12)
