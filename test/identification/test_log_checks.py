# SPDX-License-Identifier: Apache-2.0
"""A sound log passes the checks; each fault is found, at the joint that has it."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('pinocchio')

from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.bags.logs import read_log
from adaptive_blf_control.bags.measured_log import MeasuredLog
from adaptive_blf_control.errors import LogError
from adaptive_blf_control.identification.finding import (
    even,
    excerpt,
    Finding,
    listed,
    REFUSED,
    WARNING,
)
from adaptive_blf_control.identification.log_checks import check_log, refuse
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.runs.identification import identify
from adaptive_blf_control.runs.subject import REAL_ROBOT

LINK = """<link name="{0}"><inertial><origin xyz="0.2 0.03 0"/><mass value="2.5"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/></inertial></link>
  <joint name="{1}" type="revolute"><parent link="{2}"/><child link="{0}"/>
  <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-2" upper="2" effort="90" velocity="9"/></joint>"""
URDF = ('<robot name="r"><link name="base"/>' + LINK.format('a', 'shoulder', 'base')
        + LINK.format('b', 'elbow', 'a') + '</robot>')
PERIOD = 0.002
SETTINGS = IdentifierSettings(filter={'time_constant': 0.1})


def arm_with(**options) -> UrdfArm:
    return UrdfArm(URDF, viscous=0.5, friction_coulomb=True, coulomb=0.3, **options)


@pytest.fixture(scope='module')
def arm() -> UrdfArm:
    return arm_with()


@pytest.fixture(scope='module')
def sound(arm) -> MeasuredLog:
    """Return 12 s of a motion with sensor noise."""
    t = PERIOD * np.arange(6000)
    q, qd, qdd = np.zeros((3, t.size, 2))
    for amplitude, rate in ((0.5, 1.3), (0.25, 3.7), (0.05, 9.1)):
        for joint, phase in enumerate((0.0, 1.0)):
            angle = rate * (1.0 + 0.2 * joint) * t + phase
            speed = rate * (1.0 + 0.2 * joint)
            q[:, joint] += amplitude * np.sin(angle)
            qd[:, joint] += amplitude * speed * np.cos(angle)
            qdd[:, joint] -= amplitude * speed ** 2 * np.sin(angle)
    tau = np.array([arm.Y(*row) @ arm.nominal for row in zip(q, qd, qdd)])
    random = np.random.default_rng(1)
    return MeasuredLog(arm.joints, t, q + random.normal(0.0, 2e-5, q.shape),
                       qd + random.normal(0.0, 2e-3, q.shape),
                       tau + random.normal(0.0, 0.05, q.shape), 0)


def found(log, arm, settings=SETTINGS, **options):
    """Return check, joint, level and value of all findings."""
    options.setdefault('weightless', lambda: arm_with(gravity=(0.0, 0.0, 0.0)))
    return [(each.check, each.joint, each.level, each.value)
            for each in check_log(log, arm, settings, **options)]


def with_joint(log, field, function, joint=1):
    """Change a column of a log."""
    values = getattr(log, field).copy()
    values[:, joint] = function(values[:, joint])
    return log.replace(**{field: values})


def later(values, rows):
    return np.concatenate([np.full(rows, values[0]), values[:-rows]])


def test_a_sound_log_passes(sound, arm):
    assert found(sound, arm) == []
    assert listed([], arm.joints) == {'shoulder': 'sound', 'elbow': 'sound'}
    refuse([], 'log')


def test_one_column_of_effort_for_two_joints_is_refused(sound, arm):
    twice = sound.replace(tau=sound.tau[:, [0, 0]])
    assert found(twice, arm) == [('effort', 'elbow', REFUSED, 1.0)]
    carried = sound.replace(q=sound.q[:, [0, 0]], qd=sound.qd[:, [0, 0]],
                            tau=sound.tau[:, [0, 0]])  # as two fingers of a gripper
    assert not any(level == REFUSED for _, _, level, _ in found(carried, arm))


def test_a_section_that_was_copied_is_told(sound, arm):
    rows = np.arange(len(sound.t))
    rows[4000:5200] = rows[1000:2200]
    copied = sound.replace(q=sound.q[rows], qd=sound.qd[rows], tau=sound.tau[rows])
    told, = (each for each in check_log(copied, arm, SETTINGS) if 'there twice' in each.text)
    assert (told.check, told.level) == ('rate', WARNING)
    assert told.value == pytest.approx(0.2, abs=0.01)
    assert 'those from 2.002 s on are at 8.002 s' in told.text
    held = np.arange(len(sound.t)) // 3 * 3
    slow = sound.replace(q=sound.q[held], qd=sound.qd[held], tau=sound.tau[held])
    resting = copied.replace(qd=np.where(rows[:, None] < 5200, 0.0, sound.qd))
    for log in (slow, resting):
        assert not [each for each in check_log(log, arm, SETTINGS) if 'there twice' in each.text]


@pytest.mark.parametrize(('fields', 'expected'), [
    (('q', 'qd'), ('position', 'elbow', WARNING)), (('qd',), ('velocity', 'elbow', REFUSED)),
    (('q', 'qd', 'tau'), ('position', 'elbow', WARNING))], ids='-'.join)
def test_a_column_that_stands_in_a_log_for_two_joints_is_told(sound, arm, fields, expected):
    twice = sound.replace(**{field: getattr(sound, field)[:, [0, 0]] for field in fields})
    told, = (each for each in check_log(twice, arm, SETTINGS)
             if "that of joint 'shoulder' in every row" in each.text)
    assert told[:3] == expected


def test_coupled_joints_may_have_one_velocity_and_two_may_rest_alike(sound, arm):
    apart = sound.q[:, [0, 0]] + [0.0, 0.2]
    resting = np.zeros_like(sound.q)
    for log in (sound.replace(q=apart, qd=sound.qd[:, [0, 0]]),
                sound.replace(q=resting, qd=resting), sound.replace(qd=resting)):
        assert not [each for each in check_log(log, arm, SETTINGS) if 'in every row' in each.text]
    unread = sound.replace(qd=sound.qd[:, [0, 0]], measured_velocity=False)
    assert not [each for each in check_log(unread, arm, SETTINGS) if 'in every row' in each.text]


def clipped(findings):
    return [each for each in findings if 'the end of its range' in each.text]


@pytest.mark.parametrize('parts', [(0.0, 95.0), (5.0, 100.0), (5.0, 95.0)])
def test_an_effort_that_is_cut_off_again_and_again_is_told(sound, arm, parts):
    ends = np.percentile(sound.tau[:, 1], parts)
    log = with_joint(sound, 'tau', lambda tau: np.clip(tau, *ends))
    inner = [end for end, part in zip(ends, parts) if 0.0 < part < 100.0]
    told, = clipped(check_log(log, arm, SETTINGS))
    assert told[:3] == ('effort', 'elbow', WARNING)
    assert told.value == pytest.approx(0.05 * len(inner), abs=1e-3)
    assert all(f'{end:.4g}' in told.text for end in inner)
    assert told.hint.startswith('train')


def test_a_coarse_effort_has_ends_that_it_stays_at_but_is_not_cut_off(sound, arm):
    for step in (0.01, 0.5, 4.0):
        coarse = sound.replace(tau=np.round(sound.tau / step) * step)
        assert clipped(check_log(coarse, arm, SETTINGS)) == []
    halves = sound.replace(tau=sound.tau.astype(np.float16).astype(float))
    assert clipped(check_log(halves, arm, SETTINGS)) == []


def test_an_effort_at_its_end_once_or_at_rest_is_not_cut_off(sound, arm):
    number = np.arange(len(sound.t))
    largest = np.abs(sound.tau[:, 1]).max()
    once = with_joint(sound, 'tau', lambda tau: np.where(number // 300 == 9, 1.1 * largest, tau))
    assert clipped(check_log(once, arm, SETTINGS)) == []
    rests = number // 500 % 4 == 3
    held = np.where(rests, number // 500 * 500, number)  # where each rest begins
    resting = with_joint(sound, 'tau', lambda tau: np.where(rests, 1.1 * largest, tau))
    assert clipped(check_log(resting, arm, SETTINGS)) != []
    resting = resting.replace(q=sound.q[held], qd=np.where(rests[:, None], 0.0, sound.qd))
    assert clipped(check_log(resting, arm, SETTINGS)) == []


def test_a_log_that_was_filled_up_with_repeated_rows_is_told(sound, arm):
    held = np.arange(len(sound.t)) // 2 * 2
    filled = sound.replace(q=sound.q[held], qd=sound.qd[held], tau=sound.tau[held])
    (check, joint, level, part), *_ = [each for each in found(filled, arm) if each[0] == 'rate']
    assert (check, joint, level) == ('rate', None, WARNING)
    assert part == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize(('function', 'level', 'value'), [
    (lambda v: 0.0 * v, REFUSED, 0.0), (lambda v: -v, REFUSED, -1.0),
    (np.rad2deg, REFUSED, 57.3), (lambda v: v * 60.0 / (2.0 * np.pi), REFUSED, 9.55),
    (lambda v: 1.1 * v, WARNING, 1.1), (lambda v: later(v, 15), WARNING, 0.03),
    (lambda v: np.random.default_rng(0).permutation(v), REFUSED, 0.0)],
    ids=['zero', 'sign', 'degrees', 'rpm', 'scale', 'delay', 'noise'])
def test_velocity_that_is_not_the_derivative_is_found(sound, arm, function, level, value):
    result = found(with_joint(sound, 'qd', function), arm)
    assert [each[:3] for each in result if each[0] == 'velocity'] == [('velocity', 'elbow', level)]
    assert result[0][3] == pytest.approx(value, rel=0.05, abs=0.1 if level == REFUSED else 0.003)


def test_velocity_unit_is_named_with_the_option_that_helps(sound, arm):
    finding, = check_log(with_joint(sound, 'qd', np.rad2deg), arm, SETTINGS)
    assert 'as in degrees per second' in finding.text
    assert "filter={'state_order': 4}" in finding.hint
    with pytest.raises(LogError, match=r"^x.csv: joint 'elbow': the velocity is 57.*force=True"):
        refuse([finding], 'x.csv')


def test_a_warning_refuses_nothing():
    warning = Finding('delay', None, WARNING, 0.02, 'the effort is late')
    refuse([warning], 'x.csv')
    with pytest.raises(LogError, match='^x.csv: no joint moves; force=True'):
        refuse([warning, Finding('motion', None, REFUSED, 0.0, 'no joint moves')], 'x.csv')


def test_what_is_refused_is_not_judged_by_a_model(sound, arm):
    """Who has to undo degrees first is not sent after a delay."""
    late = sound.replace(tau=np.roll(sound.tau, 20, axis=0))
    assert [each[0] for each in found(late, arm)] == ['delay']
    assert [each[0] for each in found(with_joint(late, 'qd', np.rad2deg), arm)] == ['velocity']


def test_velocities_that_were_not_read_are_not_judged(sound, arm):
    log = sound.replace(qd=0.0 * sound.qd, measured_velocity=False)
    settings = SETTINGS.replace(filter={'state_order': 4, 'state_time_constant': 0.005})
    assert [each for each in found(log, arm, settings) if each[2] == REFUSED] == []


def test_degrees_and_positions_beyond_the_limits_are_found(sound, arm):
    degrees = sound.replace(q=np.rad2deg(sound.q), qd=np.rad2deg(sound.qd))
    findings = check_log(degrees, arm, SETTINGS)
    assert [(each.joint, each.level) for each in findings] == [
        ('shoulder', REFUSED), ('elbow', REFUSED)]
    assert all('degrees?' in each.text and 'degrees=True' in each.hint for each in findings)
    far = check_log(with_joint(sound, 'q', lambda q: q + 4.0), arm, SETTINGS)
    assert [(each.check, each.joint, each.level) for each in far] == [
        ('position', 'elbow', REFUSED)]
    assert 'another robot' in far[0].text
    near = found(with_joint(sound, 'q', lambda q: q + 2.1 - q.max()), arm)
    assert ('position', 'elbow', WARNING) in [each[:3] for each in near]


@pytest.mark.parametrize('value', [0.0, 3.2])
def test_constant_effort_of_a_moving_joint_is_refused(sound, arm, value):
    assert found(with_joint(sound, 'tau', lambda tau: np.full_like(tau, value)), arm) == [
        ('effort', 'elbow', REFUSED, value)]


def test_a_joint_that_never_moves_is_a_warning_and_a_still_arm_is_refused(sound, arm):
    still = with_joint(with_joint(sound, 'q', lambda q: 0.0 * q), 'qd', lambda qd: 0.0 * qd)
    result = found(with_joint(still, 'tau', lambda tau: 0.0 * tau + 1.0), arm)
    assert [each[:3] for each in result][:2] == [('motion', 'elbow', WARNING),
                                                 ('effort', 'elbow', WARNING)]
    none = sound.replace(q=0.0 * sound.q, qd=0.0 * sound.qd)
    assert ('motion', None, REFUSED, 0.0) in found(none, arm)


def test_a_log_that_mostly_stands_still_is_told(sound, arm):
    moves = (sound.t < 4.0)[:, None]
    log = sound.replace(q=np.where(moves, sound.q, sound.q[2000]),
                         qd=np.where(moves, sound.qd, 0.0))
    still = [each for each in found(log, arm) if each[:3] == ('motion', None, WARNING)]
    assert still[0][3] == pytest.approx(2 / 3, abs=0.02)


def test_a_rate_that_the_filters_cannot_use_says_what_would_help(sound, arm):
    slow = sound.replace(t=50.0 * sound.t)
    finding = next(each for each in check_log(slow, arm, SETTINGS) if each.check == 'rate')
    assert (finding.level, finding.value) == (REFUSED, pytest.approx(10.0))
    assert finding.hint == "filter={'gap': 0.3} filter={'time_constant': 0.3}"
    turned = slow.replace(qd=-slow.qd)  # with so few rows only the rate is judged
    assert [each.check for each in check_log(turned, arm, SETTINGS)] == ['rate']


def test_jitter_is_told(sound, arm):
    rows = np.ones(6000, dtype=bool)
    for start in range(100, 5900, 100):
        rows[start:start + 5] = False
    log = sound.replace(t=sound.t[rows], q=sound.q[rows], qd=sound.qd[rows], tau=sound.tau[rows])
    assert [each[:3] for each in found(log, arm)] == [('rate', None, WARNING)]


@pytest.mark.parametrize('rows', [5, 10, 20, -10])
def test_effort_behind_or_ahead_of_the_motion_is_found(sound, arm, rows):
    log = sound.replace(tau=np.roll(sound.tau, rows, axis=0))
    delay, = (each for each in found(log, arm) if each[0] == 'delay')
    assert delay[1:3] == (None, WARNING)
    assert delay[3] == pytest.approx(PERIOD * rows, abs=0.003)


def test_effort_of_one_joint_behind_the_motion_is_found_at_that_joint(sound, arm):
    log = with_joint(sound, 'tau', lambda tau: later(tau, 20))
    assert [each[:3] for each in found(log, arm)] == [('delay', 'elbow', WARNING)]


def test_rows_at_even_times_keep_their_values_and_the_gaps(sound):
    """Of a sound Panda, whose stamps jitter, no delay was found without this."""
    t = sound.t + np.random.default_rng(2).uniform(-0.4, 0.4, sound.t.shape) * PERIOD
    t[3000:] += 1.0
    result = even(excerpt(sound.replace(t=t, q=np.column_stack([2.0 * t, -t]))))
    gap, = np.flatnonzero(~result.whole)
    assert result.t[gap + 1] - result.t[gap] == pytest.approx(1.0, abs=2.0 * PERIOD)
    np.testing.assert_allclose(np.delete(np.diff(result.t), gap), result.period)
    np.testing.assert_allclose(result.q[2:gap - 2, 0], 2.0 * result.t[2:gap - 2])
    np.testing.assert_allclose(result.q[gap + 3:-3, 1], -result.t[gap + 3:-3])


def test_effort_of_the_opposite_sign_is_found(sound, arm):
    log = with_joint(sound, 'tau', lambda tau: -tau)
    sign = [each for each in check_log(log, arm, SETTINGS) if each.check == 'unit']
    assert [(each.joint, each.level) for each in sign] == [('elbow', WARNING)]
    assert "gain={'elbow': -1}" in sign[0].hint


@pytest.mark.parametrize('fields', [('q', 'qd'), ('q', 'qd', 'tau')])
def test_positions_in_each_others_columns_are_found(sound, arm, fields):
    log = sound.replace(**{field: getattr(sound, field)[:, ::-1] for field in fields})
    finding, = (each for each in check_log(log, arm, SETTINGS) if each.check == 'order')
    assert (finding.joint, finding.level) == ('shoulder', WARNING)
    assert ('efforts of it and of joint' in finding.text) == ('tau' in fields)
    assert finding.hint == 'columns 1 and 2 may be exchanged'


def test_a_base_that_hangs_upside_down_is_told_from_efforts_of_the_wrong_sign(sound, arm):
    base, zero = arm.base_count, np.zeros(2)
    weight = np.array([arm.Y(q, zero, zero)[:, :base] @ arm.nominal[:base] for q in sound.q])
    hanging = sound.replace(tau=sound.tau - 2.0 * weight)
    finding, = (each for each in check_log(hanging, arm, SETTINGS,
                                           lambda: arm_with(gravity=(0.0, 0.0, 0.0)))
                if each.check in ('gravity', 'unit'))
    assert finding.joint is None
    assert 'upside down' in finding.text
    assert finding.hint == 'gravity=[0,0,9.81]'
    turned = sound.replace(tau=-sound.tau)
    assert {each.check for each in check_log(turned, arm, SETTINGS, lambda: arm_with(
        gravity=(0.0, 0.0, 0.0)))} == {'unit'}


def test_effort_without_gravity_is_found_where_gravity_is_to_be_expected(sound, arm):
    base, zero = arm.base_count, np.zeros(2)
    weight = np.array([arm.Y(q, zero, zero)[:, :base] @ arm.nominal[:base] for q in sound.q])
    log = sound.replace(tau=sound.tau - weight)
    gravity = [each for each in check_log(log, arm, SETTINGS,
                                          lambda: arm_with(gravity=(0.0, 0.0, 0.0)))
               if each.check == 'gravity']
    assert [each.joint for each in gravity] == ['shoulder']  # at the elbow it varies by 0.4 N·m
    assert gravity[0].hint == 'gravity=[0.0,0.0,0.0]'


@pytest.mark.parametrize('gains', [(12.0, 14.0), (0.1, 0.1)])
def test_effort_of_another_unit_is_suspected(sound, arm, gains):
    log = sound.replace(tau=sound.tau / gains)
    findings = {each.joint: each for each in check_log(log, arm, SETTINGS) if each.check == 'unit'}
    for joint, gain in zip(arm.joints, gains):
        assert findings[joint].value == pytest.approx(1.0 / gain, rel=0.1)
        assert f"gain={{'{joint}': K}}" in findings[joint].hint
    assert [each for each in check_log(log, arm, SETTINGS, described_masses=False)
            if each.check == 'unit'] == []


def test_an_excerpt_of_a_long_log_marks_its_blocks(sound):
    part = excerpt(sound.replace(breaks=(100,)), 1000, 4)
    assert len(part.t) == 1000
    assert (~part.whole).sum() == 4  # between the blocks, and where the clock was set back
    assert part.period == pytest.approx(PERIOD)
    assert excerpt(sound).whole.all()


@pytest.mark.parametrize(('log', 'urdf'), [
    ('panda_gaz2019/panda_exciting_traj.csv', 'panda_gaz2019/panda_gaz2019.urdf'),
    ('ur10_unisa2025/ur10_exciting.csv', 'ur10_unisa2025/ur10_dh.urdf')])
def test_logs_of_real_robots_pass_without_a_word(realdata, log, urdf):
    options = {'friction_coulomb': True, 'friction_offset': True}
    arm = UrdfArm(str(realdata / urdf), **options)
    assert check_log(read_log(realdata / log, joints=arm.joints), arm, SETTINGS, lambda: UrdfArm(
        str(realdata / urdf), gravity=(0.0, 0.0, 0.0), **options)) == []


MEASURED = {'panda': ('panda_gaz2019/panda_exciting_traj.csv', 'panda_gaz2019/panda_gaz2019.urdf'),
            'ur10': ('ur10_unisa2025/ur10_exciting.csv', 'ur10_unisa2025/ur10_dh.urdf')}


@pytest.fixture(scope='module')
def measured(realdata):
    """Return how a change of a measured log is checked."""
    made = {}

    def check(robot, change):
        if robot not in made:
            log, urdf = (realdata / part for part in MEASURED[robot])
            made[robot] = (load_arm(str(urdf), **REAL_ROBOT['friction']),
                           load_arm(str(urdf), gravity=(0.0, 0.0, 0.0), **REAL_ROBOT['friction']))
            made[robot] += read_log(log, joints=list(made[robot][0].joints)),
        arm, light, log = made[robot]
        return check_log(change(log), arm, IdentifierSettings(filter=REAL_ROBOT['filter']),
                         lambda: light)
    return check


@pytest.mark.parametrize(('robot', 'seconds'), [
    ('panda', 0.02), ('panda', 0.01), ('panda', -0.02), ('ur10', 0.02), ('ur10', -0.02)])
def test_a_delay_of_a_measured_effort_is_found(measured, robot, seconds):
    def late(log):
        return log.replace(tau=np.column_stack([
            np.interp(log.t - seconds, log.t, column) for column in log.tau.T]))
    delay, = (each for each in measured(robot, late) if each.check == 'delay')
    assert delay.value == pytest.approx(seconds - 0.005, abs=0.004)  # sound, it is 5 ms ahead


@pytest.mark.parametrize('robot', ['panda', 'ur10'])
def test_a_measured_effort_of_the_opposite_sign_is_found(measured, robot):
    found = [each for each in measured(robot, lambda log: log.replace(tau=-log.tau))
             if 'sign opposite' in each.text]
    assert found
    assert all(each.check == 'unit' for each in found)


@pytest.mark.parametrize('robot', ['panda', 'ur10'])
def test_measured_efforts_of_two_joints_that_are_exchanged_are_found(measured, robot):
    def exchanged(log):
        tau = log.tau.copy()
        tau[:, [1, 2]] = log.tau[:, [2, 1]]
        return log.replace(tau=tau)
    found, = (each for each in measured(robot, exchanged) if each.check == 'order')
    assert found.hint.startswith('columns 2 and 3')
    assert not [each for each in measured(robot, lambda log: log) if each.check == 'order']


@pytest.mark.parametrize('robot', ['panda', 'ur10'])
def test_a_measured_effort_in_amperes_is_suspected(measured, robot):
    found = measured(robot, lambda log: log.replace(tau=log.tau / 13.0))
    assert 'unit' in {each.check for each in found}


def moved(arm, t, rates) -> MeasuredLog:
    """Return a motion of 0.6 rad at a rate [rad/s] for each joint, without noise."""
    angle = np.outer(t, rates) + [0.0, 1.0]
    q, qd = 0.6 * np.sin(angle), 0.6 * rates * np.cos(angle)
    qdd = -rates ** 2 * q
    tau = np.array([arm.Y(*row) @ arm.nominal for row in zip(q, qd, qdd)])
    return MeasuredLog(arm.joints, t, q, qd, tau + np.random.default_rng(4).normal(
        0.0, 0.05, q.shape), 0)


@pytest.mark.parametrize(('period', 'rates', 'seconds', 'gaps'), [
    (0.002, (0.31, 0.43), 60.0, ()), (0.0002, (2.1, 3.3), 8.0, ()),
    (0.002, (1.3, 2.1), 40.002, (6.0, 17.0, 23.0, 34.0))],
    ids=['slow motion', 'high rate', 'gaps at the edges'])
def test_a_delay_is_found_in_the_blocks_of_a_long_log(arm, period, rates, seconds, gaps):
    """Blocks are long enough for motion and filters, and nothing crosses their edges."""
    t = period * np.arange(round(seconds / period))
    log = moved(arm, t, np.array(rates))
    later_t = t + 0.5 * np.sum(t[:, None] >= np.array(gaps), axis=1)
    assert found(log.replace(t=later_t), arm) == []
    late = log.replace(t=later_t, tau=np.column_stack([
        np.interp(t - 0.04, t, column) for column in log.tau.T]))
    delay, = found(late, arm)
    assert delay[:3] == ('delay', None, WARNING)
    assert delay[3] == pytest.approx(0.04, abs=0.004)


def slow(log, averaged):
    """Return every fifth row of a log with the torque at it, or the mean of the five up to it."""
    tau = log.tau
    if averaged:
        tau = np.array([tau[max(k - 4, 0):k + 1].mean(axis=0) for k in range(len(log))])
    return log.replace(t=log.t[::5], q=log.q[::5], qd=log.qd[::5], tau=tau[::5])


@pytest.mark.parametrize(('averaged', 'taken', 'said'), [
    (False, 'mean', "filter={'effort': 'instant'}"), (False, 'instant', None),
    (True, 'mean', None), (True, 'instant', "filter={'effort': 'mean'}")])
def test_an_effort_that_is_taken_for_the_other_kind_is_told(sound, arm, averaged, taken, said):
    # The mean of five rows ends two rows of 2 ms before the torque at the last one.
    settings = SETTINGS.replace(filter={'effort': taken})
    findings = check_log(slow(sound, averaged), arm, settings)
    assert [each.hint for each in findings if each.check == 'effort kind'] == [said] * bool(said)


@pytest.mark.parametrize(('field', 'check', 'value', 'least'), [
    ('tau', 'effort', 1e6, 9e5), ('q', 'position', 0.0, 0.1), ('qd', 'velocity', -40.0, 30.0)])
def test_rows_that_stand_out_from_their_neighbours_are_told(sound, arm, field, check, value,
                                                            least):
    where = np.arange(500, 5500, 100)

    def spoilt(values):
        values[where] = value
        return values

    findings = check_log(with_joint(sound, field, spoilt), arm, SETTINGS)
    told, = (each for each in findings if 'stand out' in each.text)
    assert told[:3] == (check, 'elbow', WARNING)
    assert told.value > least
    assert 30 < int(told.text.split()[0]) <= 50  # a position may be near zero where it is lost
    first = float(told.text.partition('the first at ')[2].split()[0])
    assert np.abs(sound.t[where] - first).min() < 1e-4


def test_a_controller_that_starts_hard_is_no_spike(sound, arm):
    since = np.arange(len(sound)) - 3000
    kick = np.where(since >= 0, 80.0 * 0.22 ** np.maximum(since, 0), 0.0)
    hard = with_joint(sound, 'tau', lambda values: values + kick)
    assert not [each for each in check_log(hard, arm, SETTINGS) if 'stand out' in each.text]


def test_a_step_that_stays_and_a_row_between_two_pauses_are_no_spikes(sound, arm):
    number = np.arange(len(sound))
    stepped = with_joint(sound, 'tau', lambda values: values + 500.0 * (number // 700 % 2))
    alone = with_joint(sound, 'tau', lambda values: values + 500.0 * (number == 3000)).replace(
        t=sound.t + 20.0 * (number >= 3000) + 20.0 * (number > 3000))
    assert not [each for log in (stepped, alone) for each in check_log(log, arm, SETTINGS)
                if 'stand out' in each.text]


def planar_log(arm: TwoLinkArm, theta: np.ndarray) -> dict[str, np.ndarray]:
    """Return 20 s of a motion that becomes faster, at 100 Hz."""
    t, rates, growth = 0.01 * np.arange(2000), np.array([1.1, 1.7]), np.array([0.12, 0.15])
    angle, speed = np.outer(t, rates) + np.outer(t ** 2, growth), rates + 2.0 * np.outer(t, growth)
    q, qd = 0.5 * np.sin(angle), 0.5 * speed * np.cos(angle)
    qdd = growth * np.cos(angle) - 0.5 * speed ** 2 * np.sin(angle)
    return {'t': t, 'q': q, 'qd': qd, 'tau': inverse_dynamics(arm, theta, q, qd, qdd)}


def test_an_effort_of_the_other_kind_is_blamed_and_not_the_faster_test_span():
    planar = TwoLinkArm()
    log = planar_log(planar, planar.nominal)
    result = identify(log, arm=planar)
    [blamed] = [note for note in result.notes if 'of the tested torques' in note]
    assert 'Above all the effort fits' in blamed
    assert 'test span' not in blamed
    assert repr(result).startswith('note: the effort fits the motion better as the torque at its')
    assert 'note:' not in repr(identify(log, arm=planar, filter={'effort': 'instant'}))


@pytest.mark.parametrize(('factor', 'told'), [
    (1e-3, '0.001 times'), (0.05, None), (1.0, None), (20.0, None), (1e3, '1e+03 times'),
    (-1.0, 'the sign opposite')])
def test_effort_of_another_unit_is_suspected_of_an_arm_without_urdf(factor, told):
    planar = TwoLinkArm()
    log = read_log(planar_log(planar, factor * planar.nominal), joints=planar.joints)
    units = [each for each in check_log(log, planar, SETTINGS) if each.check == 'unit']
    assert [each.joint for each in units] == (list(planar.joints) if told else [])
    assert all(told in each.text and "the arm's nominal parameters" in each.text
               for each in units)
