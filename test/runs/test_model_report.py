# SPDX-License-Identifier: Apache-2.0
"""Figures of the intervals of a test span that may not fit the memory."""

import numpy as np
import pytest

from adaptive_blf_control.bags.row_store import BLOCK_ROWS
from adaptive_blf_control.runs import model_report
from adaptive_blf_control.runs.identification import identify
from adaptive_blf_control.runs.log_pass import Prediction

SWING = """<robot name="r"><link name="base"/><link name="a"><inertial>
  <origin xyz="0.2 0 0"/><mass value="2.5"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/></inertial></link>
  <joint name="swing" type="revolute"><parent link="base"/><child link="a"/>
  <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="90" velocity="9"/></joint></robot>"""


def prediction(rows):
    random = np.random.default_rng(0)
    measured, predicted = random.normal(size=(2, rows, 3))
    half = random.uniform(0.5, 3.0, (rows, 3)) * [1.0, 2.0, 3.0]
    return Prediction(np.arange(float(rows)), measured, predicted, half, measured, measured)


@pytest.mark.parametrize('rows', [1, BLOCK_ROWS - 1, 2 * BLOCK_ROWS + 7])
def test_part_inside_and_median_half_width_are_those_of_all_rows(rows):
    given = prediction(rows)
    inside, width = model_report._intervals(given)
    error = np.abs(given.measured - given.predicted)
    np.testing.assert_allclose(inside, (error <= given.half_width).mean(axis=0))
    np.testing.assert_array_equal(width, np.median(given.half_width, axis=0))


def test_of_many_rows_the_median_is_that_of_rows_evenly_spaced(monkeypatch):
    monkeypatch.setattr(model_report, 'OF_MEDIAN', 1000)
    rows = 2 * BLOCK_ROWS + 7
    given = prediction(rows)
    inside, width = model_report._intervals(given)
    np.testing.assert_array_equal(width, np.median(given.half_width[::9], axis=0))
    assert inside[2] > 0.95


def test_intervals_of_a_log_are_wide_where_the_joint_rests():
    pytest.importorskip('pinocchio')
    t = 0.002 * np.arange(10_000)
    moves = t < 17.0
    q = np.where(moves, 0.4 * np.sin(1.3 * t) + 0.2 * np.sin(4.1 * t), 0.3)
    qd, qdd = (np.where(moves, each, 0.0) for each in (
        0.52 * np.cos(1.3 * t) + 0.82 * np.cos(4.1 * t),
        -0.676 * np.sin(1.3 * t) - 3.362 * np.sin(4.1 * t)))
    tau = 5.0 * np.cos(q) + 0.3 * qdd + 0.5 * qd + 2.0 * np.tanh(qd / 0.02)
    log = {'t': t, 'q': q[:, None], 'qd': qd[:, None], 'tau': tau[:, None]}
    result = identify(log, SWING, train=(0.5, 15.0), test=(15.0, 20.0))
    place = list(result.identifier.arm.parameters).index('fc_swing')
    friction = result.uncertainty.coulomb[0, place]
    assert friction == pytest.approx(2.0, rel=0.3)
    half = result.prediction.half_width[:, 0]
    assert 0.9 * friction < half[-1] < friction
    assert np.median(half[result.prediction.t < 16.5]) < 0.5 * friction
