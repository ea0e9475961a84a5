# SPDX-License-Identifier: Apache-2.0
"""Facts about the asymmetric barrier Lyapunov function (10), (11), (23), (24)."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.control.barrier import (
    active_bound,
    barrier,
    barrier_gradient,
    INTERIOR,
    interior,
)

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

bounds = st.floats(0.01, 3.0)
parts = st.floats(-0.99, 0.99)


ONE = np.ones(1)  # J, the weight of the paper


def one(value: float) -> np.ndarray:
    return np.array([value])


@hypothesis.given(parts, bounds)
def test_barrier_equals_equation_23_inside_the_set(part, b):
    e = part * b
    assert barrier(one(e), one(b), ONE) == pytest.approx(0.5 * e * e / (b * b - e * e), rel=1e-12)


def test_barrier_sums_over_the_joints():
    e, b = np.array([0.1, -0.05, 0.0]), np.array([0.2, 0.17, 0.1])
    weight = np.array([1.0, 0.02, 5.0])
    assert barrier(e, b, weight) == pytest.approx(sum(
        weight[i] * barrier(e[i:i + 1], b[i:i + 1], ONE) for i in range(3)))


@hypothesis.given(parts, bounds, st.floats(1e-4, 1e3))
def test_a_weight_scales_the_barrier_and_its_gradient(part, b, weight):
    for function in (barrier, barrier_gradient):
        assert np.squeeze(function(one(part * b), one(b), one(weight))) == pytest.approx(
            weight * float(np.squeeze(function(one(part * b), one(b), ONE))), rel=1e-12)


@hypothesis.given(parts, bounds)
def test_gradient_is_the_derivative_of_the_barrier(part, b):
    e, step = part * b, 1e-5 * b * (1.0 - abs(part))
    above, below = (barrier(one(x), one(b), ONE) for x in (e + step, e - step))
    slope = (above - below) / (2 * step)
    assert barrier_gradient(one(e), one(b), ONE)[0] == pytest.approx(slope, rel=1e-5, abs=1e-6 / b)


@hypothesis.given(bounds)
def test_barrier_and_gradient_grow_without_bound_towards_the_edge(b):
    distances = np.logspace(0, -7, 40)
    exact = [e * e / (b * b - e * e) / 2 for e in b * (1.0 - distances)]
    values = [barrier(one(b * (1.0 - d)), one(b), ONE) for d in distances]
    inside = distances > 1.0 - INTERIOR
    np.testing.assert_allclose(np.array(values)[inside], np.array(exact)[inside], rtol=1e-9)
    assert np.all(np.diff(np.array(values)[inside]) > 0.0)
    assert values[-1] == max(values) > 200.0
    assert abs(barrier_gradient(one(0.9995 * b), one(b), ONE)[0]) > 2e5 / b


@hypothesis.given(st.floats(allow_nan=False), bounds)
def test_barrier_is_finite_and_pushes_inward_everywhere(e, b):
    value, gradient = barrier(one(e), one(b), ONE), barrier_gradient(one(e), one(b), ONE)[0]
    assert np.isfinite(value)
    assert value >= 0.0
    assert np.isfinite(gradient)
    assert gradient * np.sign(e) >= 0.0
    if abs(e) >= b:
        assert gradient * np.sign(e) >= 2e5 / b


@hypothesis.given(parts, bounds)
def test_errors_inside_the_set_are_not_changed(part, b):
    assert interior(one(part * b), one(b))[0] == part * b


def test_active_bound_is_that_of_the_side_where_the_error_is():
    lower, upper = np.full(4, -0.17), np.full(4, 0.2)
    error = np.array([0.1, -0.1, 0.0, -0.0])  # (11): zero belongs to the lower side
    np.testing.assert_array_equal(active_bound(error, lower, upper), [0.2, 0.17, 0.17, 0.17])


@hypothesis.given(parts, bounds)
def test_symmetric_barrier_is_the_case_of_equal_bounds(part, b):
    e = one(part * b)
    plus, minus = (active_bound(x, one(-b), one(b)) for x in (e, -e))
    assert barrier(e, plus, ONE) == barrier(-e, minus, ONE)
    assert barrier_gradient(e, plus, ONE) == -barrier_gradient(-e, minus, ONE)


def test_barrier_is_once_differentiable_across_zero():
    lower, upper = one(-0.1), one(0.3)
    below, above = one(-1e-9), one(1e-9)
    for function in (barrier, barrier_gradient):
        left = function(below, active_bound(below, lower, upper), ONE)
        right = function(above, active_bound(above, lower, upper), ONE)
        assert float(np.squeeze(left)) == pytest.approx(float(np.squeeze(right)), abs=1e-6)
