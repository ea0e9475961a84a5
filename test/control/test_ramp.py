# SPDX-License-Identifier: Apache-2.0
"""Facts about the way of the torque down to zero."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.control.ramp import ramp_down

TORQUE = np.array([8.0, -2.0])


@pytest.mark.parametrize(('ramp_time', 'rate', 'steps'), [
    (0.05, 1e6, 50),    # as long as asked for
    (0.05, 100.0, 80),  # 8 N·m at 100 N·m/s take 80 ms
    (0.0, 1.0, 5000),   # a stop is a stop: 5 s at most
])
def test_the_ramp_is_straight_and_takes_the_time_that_is_needed(ramp_time, rate, steps):
    torques = np.array(list(ramp_down(TORQUE, ramp_time, np.full(2, rate))))
    expected = np.outer(np.linspace(1.0, 0.0, steps + 1)[1:-1], TORQUE)
    np.testing.assert_allclose(torques, expected, atol=1e-12)


@pytest.mark.parametrize('ramp_time', [0.0, 1e-3])
def test_without_a_ramp_nothing_comes_before_the_zero(ramp_time):
    assert list(ramp_down(TORQUE, ramp_time, np.full(2, 1e9))) == []
