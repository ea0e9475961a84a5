# SPDX-License-Identifier: Apache-2.0
"""Thin curves keep what an eye looks for: extremes, ends, spikes."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.runs.thinning import thin


def test_extremes_and_ends_survive_in_every_piece() -> None:
    y = np.random.default_rng(3).standard_normal(100_000)
    t = np.arange(y.size) * 1e-3
    kept_t, kept_y = thin(t, y, 2000)
    assert kept_t.size <= 2002
    assert (kept_t[0], kept_t[-1]) == (t[0], t[-1])
    assert (np.diff(kept_t) > 0.0).all()
    for begin in range(0, y.size, 1000):  # ten pieces each
        inside = (kept_t >= t[begin]) & (kept_t <= t[begin + 999])
        assert kept_y[inside].max() == y[begin:begin + 1000].max()
        assert kept_y[inside].min() == y[begin:begin + 1000].min()


def test_a_spike_of_one_sample_survives_on_either_side() -> None:
    t = np.arange(50_000.0)
    for spike in (9.0, -9.0):
        y = np.zeros(t.size)
        y[31_337] = spike
        kept_t, kept_y = thin(t, y)
        assert kept_y[kept_t == 31_337.0] == spike


def test_nan_does_not_hide_an_extreme() -> None:
    t = np.arange(10_000.0)
    y = np.sin(t)
    y[::2] = np.nan
    y[5_001] = 7.0
    assert np.nanmax(thin(t, y, 500)[1]) == 7.0


def test_a_short_curve_stays_as_it_is() -> None:
    t, y = np.arange(5.0), np.ones(5)
    kept = thin(t, y)
    assert kept[0] is t
    assert kept[1] is y
