# SPDX-License-Identifier: Apache-2.0
"""Facts about motions: how one begins, is lost, resumed, tuned and led through points."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.motion import groups_of, Motion
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.control.way import way_through
from adaptive_blf_control.errors import BlfError, ParameterError, SetViolation

ARM = TwoLinkArm()
THETA = ARM.nominal
SETTINGS = ControllerSettings(
    k1=[1000.0, 800.0], k2=[60.0, 8.0], safety={'lower': [-1.17, -2.17], 'upper': [1.2, 2.2]},
    performance={'lower': [-0.17], 'upper': [0.2]},
    reference={'smooth_start': 0.0, 'resume_time': 2.0, 'of_joint': {
        'joint1': {'amplitude': [1.0], 'frequency': [0.5]},
        'joint2': {'amplitude': [2.0], 'frequency': [0.5], 'phase': [np.pi / 2.0]}}})
Q, QD = np.array([0.01, 1.98]), np.array([0.4, -0.1])
POSTURE, REST = np.array([-0.6, 0.4]), np.zeros(2)
LONGEST = 0.1  # s
MS = 1_000_000
EPOCH = 10**12


class Arm:
    """Hands the states of an arm to a motion, as a node does that is always heard."""

    def __init__(self, settings: ControllerSettings = SETTINGS) -> None:
        self.motion = Motion(ARM, settings)
        self.reasons: list[str] = []

    def answers(self, ms: float, q=Q, qd=QD) -> bool:
        motion, stamp = self.motion, EPOCH + round(ms * MS)
        refusal = motion.refuse(stamp, np.array(q), np.array(qd), LONGEST)
        if refusal is not None:
            self.reasons.append(refusal.reason)
            return False
        if motion.lost:
            motion.end()
        if motion.controller is None:
            motion.begin(stamp, np.array(q), np.array(qd))
        motion.answer(stamp, np.array(q), np.array(qd), THETA)
        return True

    def at(self, t: float) -> ReferencePoint:
        return self.motion.controller.reference.at(t)


@pytest.fixture
def arm() -> Arm:
    """Return an arm whose motion has begun at 0 ms."""
    subject = Arm()
    assert subject.answers(0.0)
    return subject


def points(*goals: tuple[float, list[float]]) -> list[tuple[float, ReferencePoint]]:
    return [(time, ReferencePoint(np.array(goal), REST, REST)) for time, goal in goals]


def test_the_torque_is_that_of_the_controller_for_the_time_since_the_start(arm):
    law = Controller(ARM, SETTINGS, start=Q)
    law.update(0.0, Q, QD, THETA)
    assert arm.answers(50.0, [0.02, 1.97])
    expected = law.update(0.05, np.array([0.02, 1.97]), QD, THETA)
    np.testing.assert_array_equal(arm.motion.output.torque, expected.torque)
    assert arm.motion.t == pytest.approx(0.05)


def test_without_a_motion_nothing_is_answered():
    with pytest.raises(BlfError, match='no motion has begun'):
        Motion(ARM, SETTINGS).answer(0, Q, QD, THETA)


def test_a_state_that_is_refused_leaves_the_motion_as_it_is(arm):
    before = arm.motion.output
    for ms, q in ((0.0, Q), (-1.0, Q), (5000.0, Q), (1.0, [np.nan, 0.0])):
        assert not arm.answers(ms, q)
    assert arm.motion.output is before
    assert arm.reasons == ['joint state out of order'] * 2 + ['stamp jumps ahead',
                                                             'non-finite joint state']
    assert arm.answers(1.0)


def test_on_a_clock_that_stays_ahead_the_motion_begins_again_from_where_the_arm_is(arm):
    assert not arm.answers(9000.0, POSTURE)
    assert arm.answers(9001.0, POSTURE, REST)
    np.testing.assert_allclose(arm.motion.output.reference.position, POSTURE, atol=1e-12)
    assert arm.motion.t == 0.0
    assert not arm.answers(8000.0)


@pytest.mark.parametrize('ms', [3000.0, 50.0, -5e5], ids=[
    'long after', 'within the timeout', 'a clock that was set back'])
def test_after_lost_states_the_motion_begins_again_from_where_the_arm_is(arm, ms):
    arm.motion.lose('joint states lost')
    assert arm.answers(ms, POSTURE, REST)
    assert not arm.motion.lost
    np.testing.assert_allclose(arm.motion.output.e1, 0.0, atol=1e-12)
    assert np.abs(arm.motion.output.torque).max() < 1.0
    assert arm.answers(ms + 1.0, POSTURE, REST)  # and goes on, on the clock it began on
    assert not arm.answers(ms - 1.0, POSTURE, REST)


LIMITED = SETTINGS.replace(torque_limit=50.0, torque_rate_limit=1000.0)  # N·m, N·m/s


def _pushed() -> Arm:
    """Return an arm that is pushed with 10 N·m or more in joint 1, at 1 N·m in each ms."""
    arm = Arm(LIMITED)
    for ms in range(40):
        assert arm.answers(ms, Q, QD + [1.0, 0.0])
    assert np.abs(arm.motion.torque[0]) > 10.0
    return arm


def test_a_motion_that_begins_on_another_clock_changes_the_torque_at_its_rate():
    arm = _pushed()
    before = arm.motion.torque.copy()
    assert not arm.answers(9000.0, POSTURE, REST)
    assert arm.answers(9001.0, POSTURE, REST)  # on its reference the law asks for little
    assert np.abs(arm.motion.torque - before).max() == pytest.approx(1.0)


def test_after_lost_states_the_torque_rises_from_the_zero_that_was_sent():
    arm = _pushed()
    arm.motion.lose('joint states lost')
    assert not arm.motion.torque.any()
    assert arm.answers(500.0, POSTURE, [1.0, 0.0])
    assert np.abs(arm.motion.torque).max() <= 1.0


@pytest.mark.parametrize(('elapsed', 'step'), [(None, 50.0), (0.002, 2.0), (10.0, 50.0)])
def test_the_torque_changes_by_the_real_time_where_stamps_run_ahead_of_it(elapsed, step):
    arm = _pushed()
    before = arm.motion.torque.copy()
    stamp = EPOCH + 89 * MS  # 50 ms after the last one
    arm.motion.answer(stamp, Q, QD - [1.0, 0.0], THETA, elapsed=elapsed)
    assert np.abs(arm.motion.torque - before).max() == pytest.approx(step)


def test_after_lost_states_a_source_that_repeats_its_last_one_begins_nothing(arm):
    arm.motion.lose('joint states lost')
    assert not arm.answers(0.0)
    assert arm.motion.lost == 'joint states lost'
    assert arm.answers(1.0)


def test_a_motion_is_not_resumed_from_outside_the_safety_set(arm):
    arm.motion.lose('joint states lost')
    with pytest.raises(SetViolation, match="'joint2'"):
        arm.answers(3000.0, [0.0, 2.3])
    assert arm.motion.controller is None


@pytest.mark.parametrize('q', [[0.3, 2.0], [0.0, 1.5], [-1.1, 0.1]])
def test_without_a_smooth_start_a_posture_off_the_performance_set_is_joined_all_the_same(q):
    arm = Arm()
    assert arm.answers(0.0, q, REST)
    wanted = Controller(ARM, SETTINGS).reference
    np.testing.assert_allclose(arm.at(0.0).position, q, atol=1e-12)
    assert not np.allclose(arm.at(1.9).position, wanted.at(1.9).position, atol=1e-6)
    np.testing.assert_allclose(arm.at(2.0).position, wanted.at(2.0).position, atol=1e-12)


def test_a_posture_near_the_reference_keeps_its_error_unless_a_motion_came_before():
    arm, q = Arm(), [0.1, 2.05]
    assert arm.answers(0.0, q, REST)
    assert np.abs(arm.motion.output.e1).min() > 0.01
    arm.motion.end()
    assert arm.answers(10.0, q, REST)
    np.testing.assert_allclose(arm.motion.output.e1, 0.0, atol=1e-12)


def test_the_start_is_checked_where_the_arm_rests():
    motion = Motion(ARM, SETTINGS)
    motion.rest(np.array([0.0, 2.3]), REST)
    with pytest.raises(SetViolation, match="'joint2': start position outside the safety set: 2.3"):
        motion.check_start()
    motion.rest(POSTURE, REST)
    motion.check_start()
    assert motion.controller is None


def test_a_gain_set_while_the_motion_has_not_begun_is_used_from_its_first_sample():
    arm = Arm()
    arm.motion.retune(SETTINGS.replace(torque_limit=[1e-3]), {'torque_limit'})
    assert arm.answers(0.0)
    assert np.abs(arm.motion.output.torque).max() <= 1e-3


def test_a_reference_set_during_the_motion_is_faded_to_and_a_set_holds_the_present_state(arm):
    moved = SETTINGS.replace(**{'reference.joint1.offset': 0.1, 'safety.upper': [1.4, 2.2]})
    before = arm.at(0.0).position
    arm.motion.retune(moved, {'reference.joint1.offset', 'safety.upper'})
    np.testing.assert_allclose(arm.at(0.0).position, before, atol=1e-12)
    assert arm.at(5.0).position[0] == pytest.approx(0.1 + np.sin(2.5))
    narrow = moved.replace(**{'safety.upper': [1.4, 1.5], 'k1': 5.0})
    with pytest.raises(SetViolation):
        arm.motion.retune(narrow, {'safety.upper', 'k1'})
    assert arm.motion.settings is moved
    np.testing.assert_array_equal(arm.motion.controller.settings.k1, [1000.0, 800.0])


def test_the_times_of_the_start_concern_the_next_motion_alone(arm):
    reference = arm.motion.controller.reference
    arm.motion.retune(SETTINGS.replace(**{'reference.smooth_start': 3.0}),
                      {'reference.smooth_start'})
    assert arm.motion.controller.reference is reference
    assert groups_of({'reference.smooth_start', 'reference.joint1.offset', 'k1'}) == {
        'reference', 'k1'}


def test_points_are_followed_from_the_planned_moment_on(arm):
    plan = arm.motion.plan(0.1)
    assert arm.motion.follow(plan, way_through(points((1.0, [-0.5, 1.0])), plan.controller,
                                               plan.t))
    wanted = Controller(ARM, SETTINGS).reference
    for part, want in zip(arm.at(0.1), wanted.at(0.1)):
        np.testing.assert_allclose(part, want, atol=1e-12)
    np.testing.assert_allclose(arm.at(1.1).position, [-0.5, 1.0], atol=1e-12)
    assert arm.motion.planned


def test_a_moment_that_has_passed_is_planned_again(arm):
    plan = arm.motion.plan(0.1)
    way = way_through(points((1.0, [-0.5, 1.0])), plan.controller, plan.t)
    assert arm.answers(99.0)
    assert arm.answers(101.0)
    assert arm.motion.follow(plan, way) is False
    assert not arm.motion.planned


@pytest.mark.parametrize('change', [
    {'performance.upper': [0.19]}, {'reference.joint1.amplitude': [0.9]}, None])
def test_points_are_not_followed_where_the_motion_changed_while_they_were_computed(arm, change):
    plan = arm.motion.plan(0.1)
    way = way_through(points((1.0, [-0.5, 1.0])), plan.controller, plan.t)
    if change is None:
        arm.motion.end()
    else:
        arm.motion.retune(SETTINGS.replace(**change), set(change))
    with pytest.raises(BlfError, match='changed meanwhile'):
        arm.motion.follow(plan, way)
    assert not arm.motion.planned


def test_before_the_motion_and_after_lost_states_there_is_nothing_to_plan_from(arm):
    assert Motion(ARM, SETTINGS).plan(0.1) is None
    arm.motion.lose('joint states lost')
    assert arm.motion.plan(0.1) is None


def test_points_that_were_followed_are_not_given_up_for_the_reference_after_lost_states(arm):
    plan = arm.motion.plan(0.1)
    arm.motion.follow(plan, way_through(points((1.0, [-0.5, 1.0])), plan.controller, plan.t))
    arm.motion.lose('joint states lost')
    assert arm.answers(1000.0, POSTURE, REST)
    for t in (0.0, 1.5, 20.0):
        np.testing.assert_allclose(arm.at(t).position, POSTURE, atol=1e-12)
        np.testing.assert_allclose(arm.at(t).velocity, 0.0, atol=1e-12)
    arm.motion.end()
    arm.motion.prepare()  # activated again: the reference of the settings
    assert arm.answers(1001.0, POSTURE, REST)
    assert not np.allclose(arm.at(20.0).position, POSTURE)


def test_a_reference_that_is_set_ends_the_following_of_points(arm):
    plan = arm.motion.plan(0.1)
    arm.motion.follow(plan, way_through(points((1.0, [-0.5, 1.0])), plan.controller, plan.t))
    arm.motion.retune(SETTINGS.replace(k1=500.0), {'k1'})
    assert arm.motion.planned
    arm.motion.retune(SETTINGS.replace(**{'reference.joint1.amplitude': [0.9]}),
                      {'reference.joint1.amplitude'})
    assert not arm.motion.planned


@pytest.mark.parametrize(('goals', 'error', 'message'), [
    ([(0.0, [-0.5, 1.0])], ParameterError, 'ascending'),
    ([(0.0, [-0.5, 1.0]), (1.0, [0.0, 0.0])], SetViolation, 'first point, at 0 s'),
    ([(1.0, [np.nan, 0.0])], ParameterError, 'finite'),
    ([(1.0, [1.1, 1.0])], SetViolation, "'joint1'")])
def test_points_that_cannot_be_followed_are_refused(arm, goals, error, message):
    with pytest.raises(error, match=message):
        way_through(points(*goals), arm.motion.controller, 0.1)


@pytest.mark.parametrize(('safety_filter', 'quickly'), [('none', True), ('limits', False)])
def test_a_motion_with_a_safety_filter_does_not_begin_again_between_two_samples(
        safety_filter, quickly):
    arm = Arm(SETTINGS.replace(safety_filter=safety_filter, limits={'velocity': [9.0, 9.0]}))
    assert not arm.motion.begins_quickly  # nothing has begun
    assert arm.answers(0.0)
    assert arm.motion.begins_quickly is quickly
