# SPDX-License-Identifier: Apache-2.0
"""What the checks that need no model say, and where their limits are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from adaptive_blf_control.bags.logs import MeasuredLog
from adaptive_blf_control.identification.finding import excerpt, REFUSED, WARNING
from adaptive_blf_control.identification.kinematic_checks import (
    effort_findings,
    motion_findings,
    position_findings,
    rate_findings,
    velocity_findings,
)
from adaptive_blf_control.identification.settings import FilterSettings

PERIOD = 0.002


class Limits(NamedTuple):
    """All that these checks ask of an arm."""

    joints: tuple[str, ...] = ('shoulder', 'elbow')
    position_lower: np.ndarray = np.array([-2.0, -2.0])
    position_upper: np.ndarray = np.array([2.0, 2.0])
    torque_limit: np.ndarray = np.array([90.0, 90.0])


ARM = Limits()


def moving(rows=6000, period=PERIOD, size=1.0, speed=1.0):
    """Return a log in which both joints move, with exact velocities."""
    t = period * np.arange(rows)
    q, qd = np.zeros((2, rows, 2))
    for amplitude, rate in ((0.5, 1.3), (0.25, 3.7), (0.05, 9.1)):
        for joint in (0, 1):
            angle, change = rate * speed * t + joint, size * amplitude
            q[:, joint] += change * np.sin(angle)
            qd[:, joint] += change * rate * speed * np.cos(angle)
    return MeasuredLog(ARM.joints, t, q, qd, 10.0 * q, 0)


def with_elbow(log, field, values):
    changed = getattr(log, field).copy()
    changed[:, 1] = values
    return log.replace(**{field: changed})


def told(check, log, *options):
    """Return joint, level and text of what a check finds."""
    return [(each.joint, each.level, each.text) for each in check(excerpt(log), *options)]


def later(values, rows):
    return np.interp(np.arange(len(values)) - rows, np.arange(len(values)), values)


@pytest.mark.parametrize(('size', 'count'), [(2e-2, 0), (3e-4, 1)])
def test_a_joint_stands_where_it_moves_by_less_than_a_milliradian(size, count):
    log = moving()
    found = told(motion_findings, with_elbow(log, 'q', size * log.q[:, 1]), ARM)
    assert [each[:2] for each in found] == count * [('elbow', WARNING)]


@pytest.mark.parametrize(('part', 'count'), [(0.4, 0), (0.6, 1)])
def test_standing_still_is_told_from_half_of_the_log_on(part, count):
    log = moving()
    stands = int(part * len(log.t))
    q = log.q.copy()
    q[:stands] = q[stands]
    found = told(motion_findings, log.replace(q=q), ARM)
    assert [each[:2] for each in found] == count * [(None, WARNING)]


@pytest.mark.parametrize(('change', 'words'), [
    (lambda v: 0.0 * v, 'the velocity is zero while the position changes by '),
    (lambda v: -v, 'the velocity has the sign opposite'),
    (np.rad2deg, 'the velocity is 57.3 times the derivative of the position, as in degrees'),
    (lambda v: v * 30.0 / np.pi, 'the velocity is 9.55 times the derivative of the position, as '),
    (lambda v: 0.5 * v, 'the velocity is 0.5 times the derivative'),
    (np.random.default_rng(0).permutation, 'the velocity is not the derivative')])
def test_the_fault_of_a_velocity_is_named(change, words):
    log = moving()
    (joint, level, text), = told(
        velocity_findings, with_elbow(log, 'qd', change(log.qd[:, 1])), ARM)
    assert (joint, level) == ('elbow', REFUSED)
    assert text.startswith(words)


@pytest.mark.parametrize(('factor', 'level'), [
    (0.75, REFUSED), (0.85, WARNING), (0.95, None), (1.05, None), (1.15, WARNING),
    (1.3, REFUSED)])
def test_how_far_a_velocity_may_be_off(factor, level):
    log = moving()
    found = told(velocity_findings, with_elbow(log, 'qd', factor * log.qd[:, 1]), ARM)
    assert [each[1] for each in found] == ([level] if level else [])


def test_a_velocity_with_much_else_in_it_is_a_warning():
    log = moving()
    wave = np.sin(5.0 * log.t)
    (_, level, text), = told(velocity_findings, with_elbow(
        log, 'qd', log.qd[:, 1] + 0.9 * log.qd[:, 1].std() * wave), ARM)
    assert level == WARNING
    assert '(correlation 0.8' in text


@pytest.mark.parametrize(('size', 'resolution'), [(2e-3, 1e-3), (2e-3, 1e-9)])
def test_motion_that_is_too_small_to_tell_is_not_judged(size, resolution):
    """As far as the encoder resolves, and as far as anything does: 0.1 mrad in 50 ms."""
    log = moving(size=size, speed=0.5)
    log = log.replace(q=resolution * np.round(log.q / resolution), qd=0.0 * log.qd)
    assert told(velocity_findings, log, ARM) == []


def test_a_coarse_encoder_is_no_fault_of_the_velocity():
    """The steps of 20 mrad are 0.4 rad/s over 50 ms."""
    log = moving(size=0.3)
    log = log.replace(q=2e-2 * np.round(log.q / 2e-2))
    assert told(velocity_findings, log, ARM) == []


@pytest.mark.parametrize(('period', 'rows', 'words'), [
    (0.002, 4, None), (0.002, 15, '30 ms behind'), (0.002, -15, '30 ms ahead of'),
    (0.02, 1, None), (0.02, 3, '60 ms behind')])
def test_a_late_velocity_is_told_from_ten_milliseconds_and_two_rows_on(period, rows, words):
    log = moving(period=period, speed=0.5)
    found = told(velocity_findings, with_elbow(log, 'qd', later(log.qd[:, 1], rows)), ARM)
    assert [words in text for _, _, text in found] == ([True] if words else [])


def test_a_delay_that_explains_little_is_not_told():
    """Of a slow motion with an error of its own any delay is as good as another."""
    log = moving(speed=0.05)
    wave = 0.2 * log.qd[:, 1].std() * np.sin(7.0 * log.t)
    assert told(velocity_findings, with_elbow(log, 'qd', log.qd[:, 1] + wave), ARM) == []


def test_no_delay_is_looked_for_in_a_moment():
    log = moving(rows=1000)
    assert told(velocity_findings, with_elbow(log, 'qd', later(log.qd[:, 1], 15)), ARM) == []


def test_rows_too_far_apart_to_integrate_are_judged_by_their_sign_only():
    log = moving(period=0.1, speed=8.0)
    assert told(velocity_findings, log, ARM) == []
    assert 'sign opposite' in told(velocity_findings, moving(period=0.1, speed=2.0).replace(
        qd=-moving(period=0.1, speed=2.0).qd), ARM)[0][2]


def test_positions_that_jump_in_a_gap_are_no_fault_of_the_velocity():
    log = moving()
    gap = np.arange(len(log.t)) // 500
    assert told(velocity_findings, log.replace(
        t=log.t + 0.5 * gap, q=log.q + 1.5 * gap[:, None]), ARM) == []


def test_a_delay_is_looked_for_in_the_longest_stretch():
    log = moving()
    log = with_elbow(log, 'qd', later(log.qd[:, 1], 15))
    log = log.replace(t=log.t + np.where(np.arange(len(log.t)) < 40, 0.0, 1.0))
    assert [each[:2] for each in told(velocity_findings, log, ARM)] == [('elbow', WARNING)]


@pytest.mark.parametrize(('position', 'level', 'words'), [
    (2.03, None, ''), (2.1, WARNING, '-2 to 2 rad, in 100.0% of the log'),
    (-2.1, WARNING, 'the position of -2.1 rad'), (3.0, REFUSED, 'another order of the joints'),
    (-3.0, REFUSED, 'another order of the joints'), (-90.0, REFUSED, 'degrees?'),
    (400.0, REFUSED, 'another order of the joints')])
def test_positions_beyond_the_limits(position, level, words):
    found = told(position_findings, with_elbow(moving(), 'q', position), ARM)
    assert [each[:2] for each in found] == ([('elbow', level)] if level else [])
    assert all(words in text for _, _, text in found)


@pytest.mark.parametrize(('position', 'found'), [(12.5, 0), (-12.6, 1), (60.0, 1)])
def test_a_joint_without_limits_that_turns_twice_may_be_in_degrees(position, found):
    free = ARM._replace(position_upper=np.array([2.0, np.inf]))
    told_of = told(position_findings, with_elbow(moving(), 'q', position), free)
    assert [each[:2] for each in told_of] == found * [('elbow', WARNING)]
    assert all('turns: degrees?' in text for _, _, text in told_of)


@pytest.mark.parametrize(('size', 'level', 'end'), [
    (1.0, REFUSED, 'while the joint moves'), (0.0, WARNING, 'in the whole log')])
def test_a_constant_effort_is_refused_only_where_the_joint_moves(size, level, end):
    log = with_elbow(moving(), 'tau', 0.0)
    (joint, found, text), = told(effort_findings, with_elbow(log, 'q', size * log.q[:, 1]), ARM)
    assert (joint, found) == ('elbow', level)
    assert text.endswith(end)


@pytest.mark.parametrize(('effort', 'level'), [(260.0, None), (280.0, WARNING), (-280.0, WARNING)])
def test_an_effort_beyond_three_times_the_limit_is_another_unit(effort, level):
    log = moving()
    tau = np.where(np.arange(len(log.t)) == 7, effort, log.tau[:, 1])
    found = told(effort_findings, with_elbow(log, 'tau', tau), ARM)
    assert [each[:2] for each in found] == ([('elbow', level)] if level else [])
    assert all('another unit?' in text for _, _, text in found)


@pytest.mark.parametrize(('period', 'constant', 'level', 'words'), [
    (0.02, 0.03, None, ''), (0.02, 0.01, WARNING, '50 Hz, too few for a filter of 0.01 s'),
    (0.1, 0.3, REFUSED, 'restart after 0.05 s without a sample')])
def test_rates_that_are_too_low_for_the_filters(period, constant, level, words):
    found = told(rate_findings, moving(period=period), FilterSettings(
        gap=0.05, time_constant=constant))
    assert [each[:2] for each in found] == ([(None, level)] if level else [])
    assert all(words in text for _, _, text in found)


def test_times_in_another_unit_are_suspected_where_the_rate_is_too_low():
    log = moving()
    found = told(rate_findings, log.replace(t=1e3 * log.t), FilterSettings())
    assert 'are its times in ms (' in found[0][2]
    assert 't / 1000 are seconds' in found[0][2]
    assert 'are its times' not in told(rate_findings, moving(period=0.1), FilterSettings())[0][2]
