# SPDX-License-Identifier: Apache-2.0
"""What filtered pairs say of delay, gravity and unit of the effort, and where the limits are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from adaptive_blf_control.identification.delay_check import delay_findings
from adaptive_blf_control.identification.dynamic_checks import (
    gravity_findings,
    left_over,
    order_findings,
    Pairs,
    unit_findings,
)
from adaptive_blf_control.identification.finding import WARNING

N = 4
ROWS = 1500
NOISE = 0.02


class Columns(NamedTuple):
    """All that these checks ask of an arm: three columns for each joint, the last its friction."""

    joints: tuple[str, ...] = tuple(f'j{i}' for i in range(N))
    parameters: tuple[str, ...] = (*(f'{part}{i}' for part in 'ab' for i in range(N)),
                                   *(f'fc_j{i}' for i in range(N)))
    base_count: int = 2 * N
    m: int = 3 * N


ARM = Columns()
RANGES = np.ones(N)


def signals(t, joint, speed=1.0):
    """Return what two parameters and dry friction make in a joint, shape (..., 3)."""
    rates = speed * np.array([1.3 + 0.2 * joint, 4.1 - 0.3 * joint])
    return np.stack([np.sin(rates[0] * t), np.cos(rates[1] * t + joint),
                     np.tanh(np.sin(rates[0] * t + 1.0) / 0.05)], axis=-1)


def pairs(delays=0.0, *, friction=0.3, late_friction=0.0, period=0.002, speed=1.0, noise=NOISE):
    """Return pairs with efforts that are late, by one time or by one for each joint [s]."""
    t = 0.01 * np.arange(ROWS)
    lags = np.arange(-round(0.05 / period), round(0.15 / period) + 1)
    regressors, changes = np.zeros((2, ROWS, N, 3 * N))
    torques = np.empty((len(lags), ROWS, N))
    random = np.random.default_rng(4)
    parts = np.array([1.0, 0.8, 0.0])
    for joint, delay in enumerate(np.broadcast_to(delays, N)):
        columns = joint + N * np.arange(3)
        regressors[:, joint, columns] = signals(t, joint, speed)
        changes[:, joint, columns] = (signals(t + 0.01, joint, speed)
                                      - signals(t - 0.01, joint, speed))
        shifted = t + (period * lags - delay)[:, None]
        torques[:, :, joint] = signals(shifted, joint, speed) @ parts + np.broadcast_to(
            friction, N)[joint] * signals(shifted - late_friction, joint, speed)[..., 2]
        torques[:, :, joint] += random.normal(0.0, noise, (1, ROWS))
    return Pairs(regressors, torques, changes, lags, period)


def told(found):
    return [(each.joint, round(1e3 * each.value)) for each in found]


@pytest.mark.parametrize(('delay', 'words'), [
    (-0.018, 'the effort is 18 ms ahead of the motion'), (-0.012, None), (0.0, None),
    (0.003, None), (0.006, 'the effort is 6 ms behind the motion')])
def test_delays_that_sound_robots_have_are_not_told(delay, words):
    found = list(delay_findings(pairs(delay), ARM, RANGES))
    assert [(each.joint, each.level) for each in found] == ([(None, WARNING)] if words else [])
    assert all(each.text.startswith(words) for each in found)
    assert all(each.hint.startswith('effort_delay=') for each in found)


def test_a_delay_between_two_rows_is_interpolated():
    finding, = delay_findings(pairs(0.010, period=0.008), ARM, RANGES)
    assert finding.value == pytest.approx(0.010, abs=5e-4)


def test_a_delay_beyond_what_is_tried_is_none():
    assert told(delay_findings(pairs(0.3), ARM, RANGES)) == []


def test_friction_that_follows_a_reversal_late_is_no_delay():
    made = pairs(late_friction=0.02)
    assert told(delay_findings(made, ARM, RANGES)) == []
    deaf = made._replace(changes=0.0 * made.changes)  # to a delay of the friction's own
    assert told(delay_findings(deaf, ARM, RANGES)) != []


def test_a_delay_that_explains_next_to_nothing_is_not_told():
    assert told(delay_findings(pairs(0.02, speed=0.2, noise=0.2, friction=0.0), ARM,
                               RANGES)) == []


@pytest.mark.parametrize(('alone', 'found'), [(0.012, []), (0.02, [('j1', 20)])])
def test_one_joint_that_is_later_than_the_others_is_named(alone, found):
    assert told(delay_findings(pairs((0.0, alone, 0.0, 0.0)), ARM, RANGES)) == found


def test_the_joint_that_is_named_does_not_delay_the_others():
    assert told(delay_findings(pairs((0.01, 0.05, 0.01, 0.01)), ARM, RANGES)) == [
        ('j1', 50), (None, 10)]


def test_a_joint_alone_has_to_gain_much():
    """With noise as large as the delay makes the error."""
    assert told(delay_findings(pairs((0.0, 0.02, 0.0, 0.0), noise=0.3), ARM, RANGES)) == []


@pytest.mark.parametrize(('friction', 'found'), [(0.3, [('j1', 30)]), (3.0, [])])
def test_a_joint_that_has_little_but_friction_is_not_judged_alone(friction, found):
    assert told(delay_findings(pairs((0.0, 0.03, 0.0, 0.0), friction=(0.3, friction, 0.3, 0.3)),
                               ARM, RANGES)) == found


def test_joints_count_by_what_is_not_friction():
    made = pairs((0.0, 0.014, 0.0, 0.014), friction=(0.3, 4.0, 0.3, 4.0))
    assert told(delay_findings(made, ARM, RANGES)) == []


def test_a_joint_that_hardly_moves_says_nothing():
    made = pairs((0.0, 0.05, 0.0, 0.0))
    assert told(delay_findings(made, ARM, np.array([1.0, 0.04, 1.0, 1.0]))) == []
    assert told(delay_findings(made, ARM, np.array([1.0, 0.06, 1.0, 1.0]))) == [('j1', 50)]


@pytest.mark.parametrize(('poor', 'found'), [(2, [(None, 20)]), (3, [])])
def test_less_than_half_of_the_joints_are_not_enough(poor, found):
    """The model of a poor joint leaves more than half of its torque."""
    made = pairs(0.02)
    made.torques[:, :, :poor] += np.random.default_rng(1).normal(0.0, 2.0, (1, ROWS, poor))
    assert told(delay_findings(made, ARM, RANGES)) == found


def simple(torques, regressors=None):
    """Return pairs without lags, (K,) torques of one joint and (K, m) of its regressor."""
    rows = len(torques)
    made = np.zeros((rows, 1, 1)) if regressors is None else regressors[:, None]
    return Pairs(made, torques[None, :, None], made, np.zeros(1, dtype=int), 0.01)


ONE = Columns(('elbow',), ('a', 'b'), 2, 2)
T = 0.01 * np.arange(ROWS)
SWING, OTHER, THIRD = (np.sqrt(2.0) * np.sin(2.0 * np.pi * rate * T / T[-1])
                       for rate in (3.0, 5.0, 7.0))  # of size 1, alike in nothing


@pytest.mark.parametrize(('measured', 'words'), [
    (0.2 * SWING, 'the effort is 0.2 times'), (0.3 * SWING, None), (3.5 * SWING, None),
    (4.5 * SWING, 'the effort is 4.5 times'), (-1.0 * SWING, 'the effort has the sign opposite'),
    (0.2 * SWING + 0.4 * OTHER, None), (-0.2 * SWING + 0.4 * OTHER, None),
    (0.1 * SWING + 50.0, 'the effort is 0.1 times')])
def test_the_unit_of_an_effort_is_judged_where_it_resembles_what_the_masses_need(measured, words):
    found = list(unit_findings(simple(measured), ONE, 3.0 + SWING[:, None]))
    assert [each.joint for each in found] == (['elbow'] if words else [])
    assert all(each.text.startswith(words) for each in found)


@pytest.mark.parametrize(('size', 'count'), [(0.4, 0), (0.6, 1)])
def test_the_unit_is_not_judged_where_the_masses_need_next_to_nothing(size, count):
    assert len(list(unit_findings(simple(SWING), ONE, 0.1 * size * SWING[:, None]))) == 0
    assert len(list(unit_findings(simple(9.0 * SWING), ONE, size * SWING[:, None]))) == count


def several(torques):
    """Return pairs without lags and without a regressor, (K, n) torques."""
    made = np.zeros((*torques.shape, 1))
    return Pairs(made, torques[None], made, np.zeros(1, dtype=int), 0.01)


def exchanged(own, other, *, described=1.0, sign=1.0, joints=3):
    """Return what is said of joints that measure so much of their own load and of j1's or j0's."""
    loads = described * np.column_stack([SWING, OTHER, THIRD])[:, :joints]
    torques = own * loads + other * sign * loads[:, [1, 0, 2][:joints]]
    return list(order_findings(several(5.0 + torques), ARM, 3.0 + loads))


@pytest.mark.parametrize(('own', 'other', 'found'), [
    (0.0, 1.0, True), (0.0, 0.1, True), (0.5, 1.0, True), (0.8, 1.0, False), (1.0, 0.0, False),
    (1.0, 0.7, False)])
def test_efforts_in_each_others_column_are_told_with_both_names(own, other, found):
    findings = exchanged(own, other)
    assert [each.joint for each in findings] == ['j0'] * found
    for each in findings:
        assert each.text.startswith("the effort is like that of joint 'j1'")
        assert each.hint == 'columns 1 and 2 of the effort may be exchanged'


@pytest.mark.parametrize(('described', 'sign'), [(0.4, 1.0), (1.0, -1.0)])
def test_efforts_are_not_exchanged_where_the_masses_need_little_or_the_sign_differs(
        described, sign):
    assert len(exchanged(0.0, 1.0)) == 1
    assert exchanged(0.0, 1.0, described=described, sign=sign) == []


def test_loads_that_are_alike_are_not_taken_for_exchanged():
    """Each effort is as near to the load of the other joint as to its own."""
    loads = np.column_stack([SWING + 0.1 * OTHER, SWING + 0.1 * THIRD])
    assert list(order_findings(several(np.column_stack([SWING, SWING])), ARM, loads)) == []


@pytest.mark.parametrize(('weight', 'described', 'found'), [
    (0.0, 2.0, True), (0.1, 2.0, True), (0.25, 2.0, False), (2.0, 2.0, False),
    (0.0, 0.4, False), (0.0, 0.55, False)])
def test_gravity_is_missed_where_a_model_without_it_is_as_good(weight, described, found):
    """With an error of 0.5 N·m: a weight of 0.25 N·m of it makes that 12 % larger."""
    torque = 3.0 * SWING + weight * OTHER + 0.5 * THIRD
    both, light = np.column_stack([SWING, OTHER]), np.column_stack([SWING, 0.0 * OTHER])
    findings = list(gravity_findings(simple(torque, both), simple(torque, light), ONE,
                                     described * OTHER[:, None]))
    assert [each.joint for each in findings] == (['elbow'] if found else [])


def test_columns_that_say_the_same_explain_no_more_than_one_of_them():
    np.testing.assert_allclose(left_over(np.array([[1.0, 1.0], [0.0, 0.0]]), np.array(
        [[0.0, 1.0], [1.0, 0.0]])), [np.sqrt(0.5), 0.0], atol=1e-12)
    assert left_over(np.zeros((2, 3)), np.array([[3.0, 4.0]])) == pytest.approx(np.sqrt(12.5))
