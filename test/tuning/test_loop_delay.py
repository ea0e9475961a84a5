# SPDX-License-Identifier: Apache-2.0
"""Facts about how much damping and stiffness a sampled loop with a delay bears."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.tuning.loop_delay import loop_delay, phase_margin

PERIOD = 1e-3


def grows(rate: float, samples: int, stiffness: float = 0.0) -> bool:
    """Whether a unit inertia with a held torque, late by whole samples, runs away."""
    e, v, late = 1.0, 0.0, [0.0] * samples
    peaks = []
    for _ in range(20000):
        late.append(-rate * v - stiffness * e)
        u = late.pop(0)
        e, v = e + PERIOD * v + 0.5 * PERIOD * PERIOD * u, v + PERIOD * u
        peaks.append(abs(v) + abs(e) * math.sqrt(stiffness))
        if peaks[-1] > 1e6:
            return True
    return max(peaks[-2000:]) > max(peaks[:2000])


@pytest.mark.parametrize('samples', [0, 1, 2, 5, 20])
def test_the_limit_is_where_a_held_and_late_damping_runs_away(samples: int) -> None:
    limit = loop_delay(1.0 / PERIOD, samples * PERIOD).largest_rate
    for factor, expected in ((0.99, False), (1.01, True)):
        z, late = 1.0, [0.0] * samples
        for _ in range(20000):
            late.append(-factor * limit * z)
            z = min(z + PERIOD * late.pop(0), 1e9)
        assert (abs(z) > 1.0) == expected


def test_the_limit_is_that_of_sampling_without_a_delay_and_of_a_long_delay_otherwise() -> None:
    assert loop_delay(1000.0).largest_rate == pytest.approx(2000.0)
    slow = loop_delay(1e5, delay=0.1)
    assert slow.largest_rate == pytest.approx(0.5 * math.pi / slow.total, rel=1e-6)


def test_the_lag_of_the_velocity_counts_like_a_delay() -> None:
    assert (loop_delay(500.0, 0.004, 0.003).largest_rate
            == loop_delay(500.0, 0.007).largest_rate)


@pytest.mark.parametrize('rate', [10.0, 100.0, 240.0])
def test_a_loop_is_at_its_limit_with_the_delay_that_its_margin_allows(rate: float) -> None:
    delay = loop_delay(1000.0, 0.002, 0.001)
    later = loop_delay(1000.0, 0.002 + delay.delay_margin(rate), 0.001)
    assert later.largest_rate == pytest.approx(rate)


def test_an_unstable_loop_has_a_negative_margin() -> None:
    delay = loop_delay(1000.0, 0.002)
    assert delay.delay_margin(1.01 * delay.largest_rate) < 0.0
    assert delay.delay_margin(2000.0) == -math.inf
    assert delay.delay_margin(0.0) == math.inf


@pytest.mark.parametrize('samples', [2, 5, 10])
@pytest.mark.parametrize('part', [0.2, 0.5, 0.9])
def test_the_phase_margin_changes_its_sign_where_damping_with_stiffness_runs_away(
        samples: int, part: float) -> None:
    delay = loop_delay(1.0 / PERIOD, samples * PERIOD)
    rate = part * delay.largest_rate
    low, high = 0.0, 4.0 * rate * delay.largest_rate
    for _ in range(40):  # the stiffness without any phase left
        middle = 0.5 * (low + high)
        if phase_margin(np.array(rate), np.array(middle), delay) > 0.0:
            low = middle
        else:
            high = middle
    assert not grows(rate, samples, 0.9 * low)
    assert grows(rate, samples, 1.1 * low)


@pytest.mark.parametrize(('arguments', 'name'), [
    ((0.0,), 'loop.rate'), ((1000.0, -1e-3), 'loop.delay'), ((1000.0, 0.0, math.nan),
                                                             'loop.velocity_lag')])
def test_what_no_loop_has_is_refused_by_name(arguments, name) -> None:
    with pytest.raises(ParameterError, match=name):
        loop_delay(*arguments)
