# SPDX-License-Identifier: Apache-2.0
"""Facts about round trips: which state a command answers, and what is counted."""

from __future__ import annotations

import pytest

from adaptive_blf_control.runtime.round_trip import RoundTrips

MS = 1_000_000  # ns


def test_a_command_answers_the_newest_state_that_was_there_before_it():
    trips = RoundTrips()
    trips.sent(1, 10 * MS)
    trips.sent(2, 11 * MS)
    trips.answered(None, 11 * MS + 10_000, 12 * MS)  # too soon after the second one to answer it
    assert trips.histogram.largest_ns == 2 * MS
    trips.answered(None, 12 * MS, 14 * MS)
    assert trips.histogram.largest_ns == 3 * MS


def test_a_command_that_says_its_state_is_counted_for_that_one_alone():
    trips = RoundTrips()
    for stamp in (1, 2, 3):
        trips.sent(stamp, (10 + stamp) * MS)
    trips.answered(2, 14 * MS, 14 * MS)
    assert trips.histogram.largest_ns == 2 * MS
    trips.answered(1, 30 * MS, 30 * MS)  # late, and of a state before: nobody waits for it
    trips.answered(9, 30 * MS, 30 * MS)  # of no state that was sent
    assert trips.histogram.within(50 * MS) == 1


@pytest.mark.parametrize('published_ns', [0, 5 * MS])
def test_a_command_that_answers_nothing_is_not_counted(published_ns):
    trips = RoundTrips()
    trips.sent(1, 10 * MS)
    trips.answered(None, published_ns, 12 * MS)
    assert trips.histogram.largest_ns == 0


def test_answers_in_time_are_a_part_of_the_periods_that_passed():
    trips = RoundTrips()
    for k in range(1, 9):
        trips.sent(k, 10 * k * MS)
        trips.answered(k, (10 * k + 1) * MS, (10 * k + 2) * MS)
    figures = trips.figures(10 * MS, 100 * MS)
    assert float(figures['answered within their period so far [%]']) == pytest.approx(80.0)
    assert figures['round trip p50, p99, p99.9, largest so far [ms]'].endswith(', 2.000')
