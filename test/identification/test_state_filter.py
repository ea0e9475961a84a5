# SPDX-License-Identifier: Apache-2.0
"""Facts about the state-variable filter: exact steps, one lag for q, q̇ and τ."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.state_filter import LowPass

DT, T = 1e-3, 0.03
UNUSED = np.full(2, np.nan)  # a measured velocity


def fine_cascade(x: np.ndarray, u0: np.ndarray, u1: np.ndarray, dt: float,
                 steps: int = 200) -> np.ndarray:
    """Integrate T ẋ_k = x_{k−1} − x_k with RK4 over dt, the input linear in time."""
    h = dt / steps

    def rate(stages: np.ndarray, part: float) -> np.ndarray:
        inputs = np.vstack([u0 + part * (u1 - u0), stages[:-1]])
        return (inputs - stages) / T

    for k in range(steps):
        begin, middle, end = k / steps, (k + 0.5) / steps, (k + 1) / steps
        a = rate(x, begin)
        b = rate(x + 0.5 * h * a, middle)
        c = rate(x + 0.5 * h * b, middle)
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(x + h * c, end))
    return x


@pytest.mark.parametrize('order', [2, 4, 6])
@pytest.mark.parametrize('dt', [1e-3, 0.02, 0.1])
def test_the_filter_equals_a_fine_integration_of_its_equation(order, dt):
    random = np.random.default_rng(2)
    q, tau = random.normal(size=(10, 2)), random.normal(size=(10, 2))
    state_filter = LowPass(2, order, T)
    state_filter.update(0.0, q[0], UNUSED, tau[0])
    x, y = np.tile(q[0], (order, 1)), np.tile(tau[0], (order, 1))
    for k in range(1, 10):
        got = state_filter.update(dt, q[k], UNUSED, tau[k])
        x = fine_cascade(x, q[k - 1], q[k], dt)  # a position moves linearly
        y = fine_cascade(y, tau[k], tau[k], dt)  # a torque is held
        expected = x[-1], (x[-2] - x[-1]) / T, y[-1]
        for value, wanted in zip(got, expected):
            np.testing.assert_allclose(value, wanted, rtol=1e-6, atol=1e-9)


def test_velocity_is_the_derivative_of_the_filtered_position():
    state_filter, last = LowPass(1, 4, T), None
    for k in range(2000):
        t = k * DT
        q, qd, _ = state_filter.update(DT, np.array([np.sin(3.0 * t)]), UNUSED, np.zeros(1))
        if last is not None:
            assert (q[0] - last[0]) / DT == pytest.approx(0.5 * (qd[0] + last[1]), abs=1e-4)
        last = q[0], qd[0]


def test_a_ramp_lags_by_order_times_time_constant_and_keeps_its_slope():
    state_filter = LowPass(1, 4, T)
    for k in range(3000):
        q, qd, _ = state_filter.update(DT, np.array([0.7 * k * DT]), UNUSED, np.zeros(1))
    assert q[0] == pytest.approx(0.7 * (2999 * DT - 4 * T), abs=1e-9)
    assert qd[0] == pytest.approx(0.7, abs=1e-9)


def test_it_starts_where_the_arm_is_and_again_after_a_reset():
    state_filter = LowPass(1, 4, T)
    for position in (0.4, -1.0):
        q, qd, tau = state_filter.update(DT, np.array([position]), UNUSED, np.array([2.0]))
        assert (q[0], qd[0], tau[0]) == (position, 0.0, 2.0)
        state_filter.update(DT, np.array([5.0]), UNUSED, np.array([5.0]))
        state_filter.reset()


def test_order_zero_passes_the_measured_state_on():
    state = np.array([1.0]), np.array([2.0]), np.array([3.0])
    off = LowPass(1, 0, T)
    assert off.memory == 0.0
    assert all(got is given for got, given in zip(off.update(DT, *state), state))


@pytest.mark.parametrize(('order', 'constant', 'name'), [
    (1, 0.03, 'state_order'), (4, 0.0, 'state_time_constant'),
    (4, float('nan'), 'state_time_constant')])
def test_filters_that_cannot_be_used_are_refused_by_name(order, constant, name):
    with pytest.raises(ParameterError, match=rf'identifier\.filter\.{name}'):
        LowPass(1, order, constant)
