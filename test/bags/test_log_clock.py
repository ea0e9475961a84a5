# SPDX-License-Identifier: Apache-2.0
"""Clocks with wild stamps and clocks that are set back."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from adaptive_blf_control.bags.log_clock import log_clock
from adaptive_blf_control.bags.row_store import BLOCK_ROWS
from adaptive_blf_control.time_units import epoch_unit

PERIOD = 10_000_000  # ns
STAMPS = 10**18 + PERIOD * np.arange(100)
HOUR = 3600 * 10**9


def clock(stamps, usable=None):
    usable = np.ones(len(stamps), dtype=bool) if usable is None else usable
    return log_clock(np.asarray(stamps), usable, 1e9)


def check(result, dropped, periods=None):
    """Compare with the rows that are left out, and the times in periods."""
    assert np.flatnonzero(~result.keep).tolist() == dropped
    expected = np.flatnonzero(result.keep) if periods is None else np.array(periods)
    np.testing.assert_allclose(result.t, 0.01 * (expected - expected[0]), atol=1e-12)
    assert (np.diff(result.t) > 0.0).all()


def test_a_sound_clock_is_left_alone():
    result = clock(STAMPS)
    check(result, [])
    assert (result.breaks, result.notes) == ((), ())


@pytest.mark.parametrize('offset', [HOUR, -HOUR, 5 * 10**9])
@pytest.mark.parametrize('rows', [[0], [40], [99], [0, 1], [40, 41, 42], [97, 98, 99], [10, 70]])
def test_single_wild_stamps_are_left_out_and_counted(offset, rows):
    stamps = STAMPS.copy()
    stamps[rows] += offset
    result = clock(stamps)
    if abs(offset) < HOUR and (0 in rows or 99 in rows):
        return  # a pause of some seconds at the ends is a pause
    check(result, rows)
    assert result.breaks == ()
    if offset > 0:
        assert f'{len(rows)} stamps far from their neighbours' in result.notes[0]
        assert f'row {rows[0] + 1}' in result.notes[0]


@pytest.mark.parametrize('back', [HOUR, 2 * 10**9])
def test_after_a_reset_the_log_goes_on_one_period_later(back):
    stamps = STAMPS.copy()
    stamps[40:] -= back
    stamps[70:] -= back
    result = clock(stamps)
    check(result, [], np.arange(100))
    assert result.breaks == (40, 70)
    assert len(result.notes) == 2
    assert 'row 41' in result.notes[0]


def test_a_small_step_back_costs_the_rows_up_to_the_time_before():
    stamps = STAMPS.copy()
    stamps[40:] -= 3 * PERIOD
    result = clock(stamps)
    check(result, [40, 41, 42], [*range(40), *range(40, 97)])
    assert result.breaks == ()


def test_after_many_rows_that_a_small_step_back_costs_the_filters_restart():
    """The arm has moved on in 0.2 s: what follows is not the next row of what was before."""
    stamps = STAMPS.copy()
    stamps[40:] -= 20 * PERIOD
    result = clock(stamps)
    check(result, [*range(40, 60)], [*range(40), *range(40, 80)])
    assert result.breaks == (40,)
    assert result.notes == ('the clock goes back by 0.19 s in row 41: the 20 rows up to the time '
                            'before are left out, and the filters restart',)


def test_a_message_out_of_order_a_repeated_one_and_an_unusable_one_are_left_out():
    stamps = STAMPS.copy()
    stamps[[20, 21]] = stamps[[21, 20]]
    stamps[50] = stamps[49]
    usable = np.ones(100, dtype=bool)
    usable[60] = False
    result = clock(stamps, usable)
    assert np.flatnonzero(~result.keep).tolist() == [21, 50, 60]


def test_a_pause_stays_a_pause():
    stamps = STAMPS.copy()
    stamps[50:] += HOUR
    result = clock(stamps)
    assert result.keep.all()
    assert result.t[-1] == pytest.approx(3600.99)


@pytest.mark.parametrize(('first', 'unit'), [
    (1.7e9, 's'), (1.7e12, 'ms'), (1.7e15, 'us'), (1.7e18, 'ns'), (0.0, None), (12.5, None),
    (1e6, None)])
def test_times_since_1970_tell_their_unit(first, unit):
    assert epoch_unit(first) == unit


@pytest.mark.parametrize('clock', [
    10**18 + np.arange(20_000) * 2_000_000,
    1.7e9 + np.arange(20_000) * 0.002,
])
def test_the_times_of_a_sound_clock_are_those_that_one_repeated_stamp_leaves(clock):
    per_second = 1e9 if clock.dtype.kind == 'i' else 1.0
    repeated = np.insert(clock, 9_000, clock[9_000])
    found = log_clock(clock, np.ones(clock.size, bool), per_second)
    other = log_clock(repeated, np.ones(repeated.size, bool), per_second)
    assert found.keep.all()
    assert (found.breaks, found.notes) == ((), ())
    assert not other.keep.all()
    np.testing.assert_array_equal(found.t, other.t)


def test_rows_before_the_latest_time_are_left_out_across_the_blocks_of_a_long_log():
    rows = 3 * BLOCK_ROWS
    clock = np.arange(rows) * 0.01
    clock[BLOCK_ROWS - 20:BLOCK_ROWS] += 0.5  # ahead, as far as the next 50 rows of the next block
    found = log_clock(clock, np.ones(rows, bool), 1.0)
    assert np.flatnonzero(~found.keep).tolist() == list(range(BLOCK_ROWS, BLOCK_ROWS + 50))
    assert found.breaks == (BLOCK_ROWS,)
    assert f'in row {BLOCK_ROWS + 1}: the 50 rows' in found.notes[0]


def test_a_clock_that_is_mended_takes_little_more_than_its_times():
    rows = 400_000
    clock = np.arange(rows) * 0.002
    clock[rows // 2:] -= 300.0
    clock[rows // 4] += 1e5
    usable = np.ones(rows, bool)
    tracemalloc.start()
    try:
        found = log_clock(clock, usable, 1.0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert (len(found.notes), found.breaks) == (2, (rows // 2 - 1,))
    assert peak < 20 * rows


def test_a_clock_that_is_set_back_between_two_blocks_of_rows_is_no_sound_one():
    clock = 0.002 * np.arange(2 * BLOCK_ROWS)
    clock[BLOCK_ROWS:] -= 5.0
    found = log_clock(clock, np.ones(clock.size, bool), 1.0)
    assert found.breaks == (BLOCK_ROWS,)
    assert 'the clock goes back by' in found.notes[0]
    assert (np.diff(found.t) > 0.0).all()
