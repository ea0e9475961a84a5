# SPDX-License-Identifier: Apache-2.0
"""Facts about the grid of the states."""

from __future__ import annotations

import pytest

from adaptive_blf_control.simulation.state_grid import StateGrid

BEGIN = 5_000_000_000


@pytest.fixture
def grid() -> StateGrid:
    grid = StateGrid(100.0)
    grid.begin(BEGIN)
    return grid


def at(ms: float) -> int:
    return BEGIN + round(ms * 1e6)


def test_a_state_is_due_once_a_period(grid):
    assert grid.period_ns == 10_000_000
    assert grid.take(at(0.0)) == at(0.0)
    assert grid.take(at(9.9)) is None
    assert grid.left(at(4.0)) == pytest.approx(6e-3)
    assert grid.take(at(10.4)) == at(10.0)
    assert grid.left(at(30.0)) == 0.0
    assert grid.missed == 0


def test_periods_that_pass_unseen_are_missed_and_the_newest_state_is_taken(grid):
    grid.take(at(0.0))
    assert grid.take(at(57.0)) == at(50.0)
    assert grid.missed == 4
    assert grid.take(at(59.0)) is None
    assert grid.take(at(60.0)) == at(60.0)


def test_another_rate_counts_from_the_last_state_on(grid):
    grid.take(at(0.0))
    assert not grid.retune(100.0)
    assert grid.retune(250.0)
    assert grid.take(at(3.9)) is None
    assert grid.take(at(4.0)) == at(4.0)
    assert grid.missed == 0


def test_without_a_grid_nothing_is_due():
    grid = StateGrid(100.0)
    assert not grid.laid
    assert grid.take(at(0.0)) is None
    assert grid.retune(50.0)
    grid.begin(BEGIN)
    assert grid.laid
    grid.end()
    assert grid.take(at(100.0)) is None
