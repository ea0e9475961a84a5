# SPDX-License-Identifier: Apache-2.0
"""Durations are counted exactly to a bin, whatever they are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adaptive_blf_control.runtime.loop_statistics import Histogram, LoopStatistics

MS = 1_000_000  # ns


def test_quantiles_are_those_of_the_durations_to_the_width_of_a_bin() -> None:
    durations = np.random.default_rng(1).lognormal(math.log(0.4 * MS), 1.2, 20_000).astype(int)
    assert durations.max() > 10 * MS
    histogram = Histogram()
    for duration in durations:
        histogram.add(int(duration))
    parts = (0.0, 0.01, 0.5, 0.9, 0.99, 0.999)
    expected = np.quantile(durations, parts, method='inverted_cdf') * 1e-6
    found = np.array(histogram.quantiles(parts))
    width = np.where(expected < 2.0, 0.002, 0.05)
    assert (found >= expected).all()
    assert (found <= expected + width * 1.001).all()
    assert histogram.largest_ns == durations.max()


@pytest.mark.parametrize(('duration', 'edge'), [
    (-5, 0.002), (0, 0.002), (1_999, 0.002), (2_000, 0.004), (2 * MS - 1, 2.0), (2 * MS, 2.05),
    (50 * MS - 1, 50.0), (50 * MS, 50.0), (10**12, 50.0)])
def test_a_duration_counts_in_the_bin_that_ends_above_it(duration: int, edge: float) -> None:
    histogram = Histogram()
    histogram.add(duration)
    np.testing.assert_allclose(histogram.quantiles((0.0, 0.5, 1.0)), edge, rtol=1e-12)
    assert histogram.largest_ns == max(duration, 0)


def test_durations_within_a_limit_are_those_of_the_bins_below_it() -> None:
    histogram = Histogram()
    for duration in (1, MS - 1, MS, 4 * MS - 1, 4 * MS, 90 * MS):
        histogram.add(duration)
    limits = (0, MS, 4 * MS, 80 * MS, 100 * MS)
    assert [histogram.within(limit) for limit in limits] == [0, 2, 4, 5, 6]
    histogram.forget()
    histogram.add(MS // 2)
    assert histogram.within(MS) == 1


def test_a_motion_that_begins_settles_anew() -> None:
    statistics = LoopStatistics()
    statistics.callback.add(30 * MS)
    for k in range(4000):
        if k == 2500:
            statistics.restart()
        statistics.sample((k + 1) * MS)
        statistics.callback.add(MS if k < 2500 else 2 * MS)
    assert statistics.span_ns == 1499 * MS
    assert statistics.callback.within(MS + 2000) == 0
    for k in range(4000, 5000):
        statistics.sample((k + 1) * MS)
    assert statistics.span_ns == 499 * MS
    assert statistics.callback.within(100 * MS) == 0


def test_what_was_forgotten_is_in_no_quantile_and_recent_begins_where_the_last_ended() -> None:
    histogram = Histogram()
    assert all(math.isnan(value) for value in histogram.quantiles((0.5, 0.99)))
    histogram.add(40 * MS)
    assert histogram.quantiles((1.0,), recent=True) == pytest.approx((40.05,))
    histogram.forget()
    histogram.add(MS // 2)
    assert histogram.quantiles((1.0,)) == pytest.approx((0.502,))
    assert histogram.quantiles((1.0,), recent=True) == pytest.approx((0.502,))
    assert math.isnan(histogram.quantiles((1.0,), recent=True)[0])
    assert histogram.largest_ns == MS // 2


def test_a_gap_in_the_stamps_counts_what_is_missing_and_a_break_does_not() -> None:
    statistics = LoopStatistics()
    for k in (0, 1, 2, 3, 7, 8):
        statistics.sample(k * MS + 1, k * MS + 1)
    assert statistics.missed == 3
    statistics.break_off()
    statistics.sample(100 * MS, 100 * MS)
    assert statistics.missed == 3
    assert statistics.samples == 7
