# SPDX-License-Identifier: Apache-2.0
"""Facts about the figures and the table of a run."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from adaptive_blf_control.control.constraints import Constraints
from adaptive_blf_control.control.set_constraints import PerformanceConstraint, SafetyConstraint
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.runs.summary import convergence_time, Run, summarise, table

TRUE = np.array([3.0, 4.0])  # of norm 5: settled under 0.05


@pytest.fixture
def run() -> Run:
    t = np.linspace(0.0, 8.0, 9)
    e1 = np.zeros((9, 2))
    e1[1], e1[7] = [0.1, -0.15], [0.02, 0.0]
    q = e1 + [0.5, -0.5]
    theta = TRUE + np.outer([3.0, 1.0, 0.04, 0.06, 0.03, 0.02, 0.01, 0.01, 0.01], [1.0, 0.0])
    joints = ('joint1', 'joint2')
    safety = JointInterval(np.full(2, -1.0), np.full(2, 1.0))
    performance = JointInterval(np.full(2, -0.17), np.full(2, 0.2))
    return Run(joints, ('p1', 'p2'), t, q, np.zeros((9, 2)), e1, t, theta, 2, 0.125, safety,
               performance, Constraints([SafetyConstraint(joints, safety),
                                         PerformanceConstraint(joints)], joints),
               ((0.0, TRUE),))


def test_figures_are_those_of_the_arrays(run):
    figures = summarise(run)
    assert figures['set_violations'] == 0
    assert figures['max_abs_error'] == [0.1, 0.15]
    assert figures['rms_error'] == pytest.approx([np.sqrt(0.0104 / 9), 0.05])
    assert figures['rms_error_last_quarter'] == pytest.approx([0.02 / np.sqrt(3), 0.0])
    assert figures['min_margin'] == pytest.approx([0.1, 0.02])
    assert figures['theta_hat'] == pytest.approx({'p1': 3.01, 'p2': 4.0})
    assert figures['theta_error_norm'] == pytest.approx(0.01)
    assert figures['theta_true_norm'] == 5.0
    assert figures['theta_settling_time_s'] == 4.0
    assert (figures['history_rank'], figures['history_sigma_min']) == (2, 0.125)
    assert (figures['duration_s'], figures['samples']) == (8.0, 9)


def test_figures_can_be_written_as_json(run):
    assert json.loads(json.dumps(summarise(run)))['joints'] == ['joint1', 'joint2']


@pytest.mark.parametrize(('field', 'value'), [('e1', 0.2), ('e1', -0.17), ('e1', float('nan')),
                                              ('q', 1.0), ('q', -1.5)])
def test_a_sample_on_or_beyond_a_bound_is_a_violation(run, field, value):
    array = getattr(run, field).copy()
    array[3:5, 1] = value
    figures = summarise(dataclasses.replace(run, **{field: array}))
    assert figures['set_violations'] == 2
    assert 'LEFT in 2 of 9 samples' in table(figures, run)


def test_without_true_parameters_nothing_is_said_about_their_error(run):
    unknown = dataclasses.replace(run, truth=None)
    figures = summarise(unknown)
    assert figures['theta_error_norm'] is None
    assert figures['theta_settling_time_s'] is None
    assert 'parameter error' not in table(figures, unknown)


@pytest.mark.parametrize(('error', 'expected'), [
    ([5.0, 3.0, 0.5, 0.4], 2.0),
    ([5.0, 0.5, 3.0, 0.4], 3.0),
    ([0.5, 0.5, 0.5, 0.5], 0.0),
    ([0.5, 0.5, 0.5, 1.0], None),
    ([5.0, 0.5, 0.5, 5.0], None),
    ([0.5, float('nan'), 0.5, 0.5], 2.0),
])
def test_settled_is_the_first_time_after_which_the_error_stays_small(error, expected):
    assert convergence_time(np.arange(4.0), np.array(error), 1.0) == expected


def test_table_is_what_a_person_reads(run):
    text = table(summarise(run), run)
    lines = text.splitlines()
    assert lines[0].startswith('safety and performance sets: KEPT  (8.0 s, 9 samples)')
    joint1 = next(line for line in lines if line.startswith('joint1'))
    for part in ('0.10000', '-0.17 .. +0.2', '0.1000'):
        assert part in joint1
    assert 'parameter error      0.01 of 5 in norm; within 1% after 4.00 s' in text
    assert 'history stack        rank 2 of 2, σ_min 0.125' in text
    assert max(map(len, lines)) <= 100


def test_columns_stand_below_their_names_however_long_a_joint_is_called(run):
    long = dataclasses.replace(run, joints=('joint1', 'shoulder_lift_joint_of_arm'))
    lines = table(summarise(long), long).splitlines()
    head = next(line for line in lines if line.startswith('joint '))
    rows = [line for line in lines if line.startswith(('joint1', 'shoulder_lift'))][:2]
    end = head.index('least margin') + len('least margin')
    assert [len(row) for row in rows] == [end, end]


def test_a_run_that_ended_before_it_should_have_says_so_first(run):
    figures = summarise(run)
    assert table(figures, run, 20.0).startswith('ENDED after 8.0 of 20 s')
    assert table(figures, run, 8.0) == table(figures, run)


def test_table_says_when_the_estimate_has_not_settled(run):
    far = dataclasses.replace(run, theta_hat=run.theta_hat + 1.0)
    assert summarise(far)['theta_settling_time_s'] is None
    assert 'not within 1% yet' in table(summarise(far), far)
