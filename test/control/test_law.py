# SPDX-License-Identifier: Apache-2.0
"""Facts about the stabilising function (27) and the torque (34), (38)."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.control.barrier import barrier_gradient
from adaptive_blf_control.control.law import (
    errors,
    growing_errors,
    limited,
    limited_answer,
    per_joint_coupling,
    pseudoinverse_coupling,
    rate_limited,
    stabilising_function,
    torque,
    unwound_term,
)

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

speeds = st.floats(-5.0, 5.0)
WEIGHT = np.array([0.2, 1.0, 3.0])  # J


def vectors(count: int, seed: int = 1) -> np.ndarray:
    """Errors inside ±0.2, e2, and any two vectors more, shape (count, 4, 3)."""
    random = np.random.default_rng(seed)
    result = random.normal(size=(count, 4, 3))
    result[:, 0] = random.uniform(-0.19, 0.19, (count, 3))
    return result


def one(value: float) -> np.ndarray:
    return np.array([value])


@hypothesis.given(part=st.floats(-0.95, 0.95), b=st.floats(0.05, 1.0), k1=st.floats(0.1, 100.0),
                  e1_dot=speeds, yd_dot=speeds, yd_ddot=speeds)
def test_alpha_dot_is_the_derivative_of_alpha_along_a_trajectory(part, b, k1, e1_dot, yd_dot,
                                                                 yd_ddot):
    e1, step = part * b, 1e-6 * b

    def alpha_at(t: float) -> float:
        return stabilising_function(one(e1 + e1_dot * t), one(e1_dot), one(yd_dot + yd_ddot * t),
                                    one(yd_ddot), one(b), one(k1))[0][0]

    slope = (alpha_at(step) - alpha_at(-step)) / (2 * step)
    _, alpha_dot = stabilising_function(one(e1), one(e1_dot), one(yd_dot), one(yd_ddot), one(b),
                                        one(k1))
    assert alpha_dot[0] == pytest.approx(slope, rel=1e-6, abs=1e-6 * (1 + k1) / b)


def test_alpha_is_equation_27_joint_by_joint():
    e1, b, k1 = np.array([0.1, -0.05]), np.array([0.2, 0.17]), np.array([40.0, 30.0])
    yd_dot = np.array([0.5, -0.3])
    alpha, _ = stabilising_function(e1, np.zeros(2), yd_dot, np.zeros(2), b, k1)
    np.testing.assert_allclose(alpha, [0.5 - 40.0 * (0.04 - 0.01) ** 2 * 0.1,
                                       -0.3 + 30.0 * (0.0289 - 0.0025) ** 2 * 0.05], rtol=1e-12)


def test_on_the_reference_alpha_is_its_velocity_and_alpha_dot_its_acceleration():
    velocity, acceleration = np.array([0.4, -1.0]), np.array([2.0, 3.0])
    alpha, alpha_dot = stabilising_function(np.zeros(2), np.zeros(2), velocity, acceleration,
                                            np.full(2, 0.2), np.full(2, 40.0))
    np.testing.assert_array_equal(alpha, velocity)
    np.testing.assert_array_equal(alpha_dot, acceleration)


@pytest.mark.parametrize('coupling', [per_joint_coupling, pseudoinverse_coupling])
def test_either_coupling_takes_the_power_of_the_barrier(coupling):
    b = np.full(3, 0.2)
    for e1, e2, *_ in vectors(50):
        assert e2 @ coupling(e1, e2, b, WEIGHT) == pytest.approx(
            barrier_gradient(e1, b, WEIGHT) @ e2)


def test_pseudoinverse_coupling_is_the_moore_penrose_inverse_of_the_paper():
    b = np.full(3, 0.2)
    for e1, e2, *_ in vectors(50):
        power = barrier_gradient(e1, b, WEIGHT) @ e2
        np.testing.assert_allclose(pseudoinverse_coupling(e1, e2, b, WEIGHT),
                                   np.linalg.pinv(e2[np.newaxis])[:, 0] * power, rtol=1e-9)


def test_pseudoinverse_of_zero_is_zero():
    coupling = pseudoinverse_coupling(np.full(2, 0.1), np.zeros(2), np.full(2, 0.2),
                                      np.ones(2))
    np.testing.assert_array_equal(coupling, np.zeros(2))


@pytest.mark.parametrize(('smooth', 'coupling'),
                         [(True, per_joint_coupling), (False, pseudoinverse_coupling)])
def test_torque_is_equation_38(smooth, coupling):
    random, b, k2 = np.random.default_rng(2), np.full(3, 0.2), np.array([10.0, 20.0, 30.0])
    for e1, e2, *_ in vectors(20):
        x, theta = random.normal(size=(3, 7)), random.normal(size=7)
        np.testing.assert_allclose(torque(x, theta, k2, e1, e2, b, WEIGHT, smooth),
                                   x @ theta - np.diag(k2) @ e2 - coupling(e1, e2, b, WEIGHT),
                                   rtol=1e-12)


@hypothesis.given(st.floats(), st.floats(1e-3, 1e6))
def test_a_limited_torque_is_finite_and_within_its_limit(wanted, limit):
    got = limited(one(wanted), one(limit))[0]
    assert np.isfinite(got)
    assert abs(got) <= limit
    if abs(wanted) <= limit:
        assert got == wanted
    elif not np.isnan(wanted):
        assert got == np.copysign(limit, wanted)


def test_errors_are_those_of_equations_5_and_25():
    q, qd = np.array([0.3, -0.4]), np.array([1.0, 2.0])
    yd, yd_dot, yd_ddot = np.array([0.25, -0.3]), np.array([0.5, -0.5]), np.array([0.1, 0.2])
    lower, upper, k1 = np.array([-0.17, -0.15]), np.array([0.2, 0.3]), np.array([40.0, 30.0])
    e1, e2, alpha, alpha_dot, b = errors(q, qd, yd, yd_dot, yd_ddot, lower, upper, k1)
    np.testing.assert_array_equal(e1, q - yd)
    np.testing.assert_array_equal(b, [0.2, 0.15])
    expected = stabilising_function(e1, qd - yd_dot, yd_dot, yd_ddot, b, k1)
    np.testing.assert_array_equal([alpha, alpha_dot], expected)
    np.testing.assert_allclose(e2 + alpha - yd_dot, qd - yd_dot)


@hypothesis.given(part=st.floats(-0.95, 0.95), b=st.floats(0.05, 1.0), b_dot=st.floats(0.0, 5.0),
                  k1=st.floats(0.1, 100.0), e1_dot=speeds, yd_dot=speeds, yd_ddot=speeds)
def test_alpha_dot_is_the_derivative_of_alpha_along_a_growing_bound(part, b, b_dot, k1, e1_dot,
                                                                    yd_dot, yd_ddot):
    def at(t: float) -> tuple[np.ndarray, ...]:
        side = b + b_dot * t
        velocity = yd_dot + yd_ddot * t
        return growing_errors(one(part * b + e1_dot * t), one(velocity + e1_dot), one(0.0),
                              one(velocity), one(yd_ddot), one(-side), one(side), one(-b_dot),
                              one(b_dot), one(k1))

    step = 1e-6 * b
    slope = (at(step)[2][0] - at(-step)[2][0]) / (2 * step)
    hypothesis.assume(abs(part * b) > 10.0 * step)  # the bound changes sides at e1 = 0
    assert at(0.0)[3][0] == pytest.approx(slope, rel=1e-6, abs=1e-6 * (1 + k1) / b)


def test_errors_with_bounds_at_rest_are_those_of_constant_bounds():
    random, lower, upper = np.random.default_rng(7), np.full(3, -0.2), np.full(3, 0.3)
    for e1, *rest in vectors(20):
        yd, k1 = random.normal(size=3), np.full(3, 40.0)
        grown = growing_errors(yd + e1, rest[0], yd, rest[1], rest[2], lower, upper, np.zeros(3),
                               np.zeros(3), k1)
        plain = errors(yd + e1, rest[0], yd, rest[1], rest[2], lower, upper, k1)
        np.testing.assert_array_equal(grown, plain)


@hypothesis.given(wanted=st.floats(), limit=st.floats(1e-3, 1e6), part=st.floats(-1.0, 1.0),
                  rate=st.floats(1e-3, 1e12), dt=st.floats(-1.0, 1e6) | st.just(float('nan')))
def test_a_torque_keeps_its_limit_and_its_rate_whatever_is_wanted(wanted, limit, part, rate, dt):
    last = part * limit
    got = rate_limited(one(wanted), one(limit), one(last), one(rate), dt)[0]
    assert abs(got) <= limit
    reach = rate * max(0.0, dt)
    assert last - reach <= got <= last + reach
    if abs(wanted) <= limit and abs(wanted - last) < reach * (1 - 1e-12):
        assert got == wanted


@hypothesis.given(wanted=st.floats(), limit=st.floats(1e-3, 1e6), last=st.floats(-1e9, 1e9))
def test_a_limit_lowered_below_the_last_torque_wins_over_the_rate(wanted, limit, last):
    got = rate_limited(one(wanted), one(limit), one(last), one(1.0), 1e-3)[0]
    assert abs(got) <= limit


def test_a_torque_that_is_not_a_number_fades_at_its_rate():
    got = rate_limited(one(float('nan')), one(50.0), one(20.0), one(1000.0), 1e-3)
    assert got[0] == 19.0


def test_adaptation_that_would_wind_up_against_a_limit_is_held_joint_by_joint():
    """Along θ̂̇ = −Γ Xᵀe2 no joint at a limit moves its wanted torque further beyond it."""
    random = np.random.default_rng(8)
    held = kept = 0
    for _ in range(200):
        x, e2 = random.normal(size=(3, 7)), random.normal(size=3)
        gamma = np.diag(random.uniform(0.1, 3.0, 7))
        wanted = random.normal(scale=30.0, size=3)
        given = limited(wanted, np.full(3, 20.0))
        expected = np.zeros(7)
        for i in range(3):
            own = -x[i] @ gamma @ x[i] * e2[i]  # rate of the wanted torque by its own row
            if (wanted[i] > given[i] and own > 0.0) or (wanted[i] < given[i] and own < 0.0):
                held += 1
            else:
                kept += wanted[i] != given[i]
                expected += x[i] * e2[i]
        np.testing.assert_allclose(unwound_term(x, e2, wanted, given), expected, atol=1e-12)
    assert min(held, kept) > 50


def test_limited_answer_is_limits_term_and_bound_at_once():
    random, lower, upper = np.random.default_rng(9), np.full(3, -0.1), np.full(3, 0.2)
    for e1, e2, last, _ in vectors(20):
        x, wanted = random.normal(size=(3, 7)), random.normal(scale=40.0, size=3)
        limit, rate = np.full(3, 30.0), np.array([1e3, 1e4, 1e5])
        given, term, bound = limited_answer(wanted, x, e2, limit, last, rate, 1e-3, e1, lower,
                                            upper)
        np.testing.assert_array_equal(given, rate_limited(wanted, limit, last, rate, 1e-3))
        np.testing.assert_array_equal(term, unwound_term(x, e2, wanted, given))
        np.testing.assert_array_equal(bound, np.where(e1 > 0.0, upper, -lower))
