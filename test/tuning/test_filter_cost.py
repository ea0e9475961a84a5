# SPDX-License-Identifier: Apache-2.0
"""Facts about what a state filter costs at the speed of a motion."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.control.reference import SumOfSinusoids
from adaptive_blf_control.identification.settings import FilterSettings
from adaptive_blf_control.tuning.filter_cost import filter_cost, filter_warnings

ARM = TwoLinkArm()
THETA = ARM.nominal * [1.0, 1.0, 1.0, 0.0, 0.0]  # no friction


def swing(speed: float = 1.0, size: float = 1.0) -> SumOfSinusoids:
    return SumOfSinusoids(np.zeros(2), size * np.array([[0.5], [0.4]]),
                          speed * np.array([[2.0], [3.0]]), np.array([[0.3], [1.0]]))


def test_the_cost_grows_with_the_square_of_time_and_speed() -> None:
    base = filter_cost(ARM, swing(), THETA, 4, 0.01)
    assert 0.0 < base < 0.01
    assert filter_cost(ARM, swing(), THETA, 4, 0.02) == pytest.approx(4.0 * base, rel=0.2)
    assert filter_cost(ARM, swing(2.0), THETA, 4, 0.01) > 3.0 * base


def test_a_linear_arm_costs_nothing() -> None:
    """Friction alone: a filter commutes with what is linear in the state."""
    friction = np.array([0.0, 0.0, 0.0, 5.3, 1.1])
    assert filter_cost(ARM, swing(), friction, 4, 0.05) < 1e-3
    assert filter_cost(ARM, swing(), ARM.nominal, 0, 0.05) == 0.0


def test_a_filter_that_is_too_slow_is_warned_of_with_the_one_that_would_do() -> None:
    slow = FilterSettings(state_order=4, state_time_constant=0.1)
    warning, = filter_warnings(ARM, swing(1.0, 3.0), THETA, slow)
    assert 'identifier.filter.state_time_constant: 4 times 0.1 s distort' in warning
    better = float(warning.partition('it; ')[2].partition(' s')[0])
    assert better < 0.1
    assert not list(filter_warnings(ARM, swing(1.0, 3.0), THETA, slow.replace(
        state_time_constant=0.8 * better)))
    assert not list(filter_warnings(ARM, swing(), THETA, FilterSettings()))
