# SPDX-License-Identifier: Apache-2.0
"""Figures of the intervals of a test span that may not fit the memory."""

import numpy as np
import pytest

from adaptive_blf_control.bags.row_store import BLOCK_ROWS
from adaptive_blf_control.runs import model_report
from adaptive_blf_control.runs.log_pass import Prediction


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


def test_of_many_rows_the_median_is_that_of_every_so_manieth(monkeypatch):
    monkeypatch.setattr(model_report, '_OF_MEDIAN', 1000)
    rows = 2 * BLOCK_ROWS + 7
    given = prediction(rows)
    inside, width = model_report._intervals(given)
    np.testing.assert_array_equal(width, np.median(given.half_width[::9], axis=0))
    assert inside[2] > 0.95
