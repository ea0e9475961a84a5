# SPDX-License-Identifier: Apache-2.0
"""Facts about the quadratic program: its optimality conditions, a foreign solver, no solution."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.limits.quadratic_program import INFEASIBLE, solve

N = 7


def program(random: np.random.Generator, rows: int, hessian_scale: float = 1.0):
    """Return H, x0, rows and bounds with a feasible point: a box and general rows."""
    factor = random.normal(size=(N, N))
    hessian = hessian_scale * (factor @ factor.T + 0.1 * np.eye(N))
    general = random.normal(size=(rows, N))
    rows_ = np.vstack([np.eye(N), -np.eye(N), general])
    inside = 0.5 * random.uniform(-1.0, 1.0, N)
    bounds = rows_ @ inside - random.uniform(0.0, 1.0, len(rows_))
    return hessian, 3.0 * random.normal(size=N), rows_, bounds


def solved(hessian, x0, rows, bounds, softness=None):
    multipliers = np.full(len(bounds), np.nan)
    softness = np.zeros(len(bounds)) if softness is None else softness
    x, steps = solve(np.linalg.inv(hessian), x0, rows, bounds, softness, multipliers)
    return x, steps, multipliers


@pytest.mark.parametrize('rows', [0, 7, 16, 40])
@pytest.mark.parametrize('scale', [1e-3, 1.0, 1e3])
def test_the_solution_meets_the_conditions_of_karush_kuhn_and_tucker(rows, scale):
    random = np.random.default_rng(rows)
    for _ in range(100):
        hessian, x0, c, b = program(random, rows, scale)
        softness = random.choice([0.0, 0.01 / scale], len(b))
        x, steps, u = solved(hessian, x0, c, b, softness)
        assert steps >= 0
        slack = c @ x + softness * u - b
        np.testing.assert_allclose(hessian @ (x - x0), c.T @ u, atol=1e-8 * scale)
        assert u.min() >= 0.0
        assert slack.min() > -1e-8
        np.testing.assert_allclose(u * slack, 0.0, atol=1e-7 * scale)


@pytest.mark.parametrize('rows', [0, 7, 16, 40])
def test_daqp_finds_the_same_solution(rows):
    daqp = pytest.importorskip('daqp')
    random = np.random.default_rng(100 + rows)
    for _ in range(200):
        hessian, x0, c, b = program(random, rows)
        upper, lower = np.full(len(b), 1e30), b
        expected, _, flag, _ = daqp.solve(hessian, -hessian @ x0, c, upper, lower,
                                          np.zeros(len(b), dtype=np.int32))
        assert flag == 1
        x, steps, _ = solved(hessian, x0, c, b)
        assert steps >= 0
        np.testing.assert_allclose(x, expected, atol=1e-8)


def test_daqp_agrees_where_there_is_no_solution():
    daqp = pytest.importorskip('daqp')
    random = np.random.default_rng(5)
    found = {True: 0, False: 0}
    for _ in range(300):
        hessian, x0, c, b = program(random, 12)
        b = b + random.uniform(0.0, 1.5)
        _, _, flag, _ = daqp.solve(hessian, -hessian @ x0, c, np.full(len(b), 1e30), b,
                                   np.zeros(len(b), dtype=np.int32))
        _, steps, _ = solved(hessian, x0, c, b)
        assert (steps == INFEASIBLE) == (flag == -1)
        found[steps == INFEASIBLE] += 1
    assert min(found.values()) > 30


def test_a_minimum_inside_all_rows_is_returned_bit_for_bit():
    random = np.random.default_rng(1)
    hessian, _, c, b = program(random, 16)
    x0 = np.linalg.lstsq(c, b + 1e-3, rcond=None)[0]
    b = np.minimum(b, c @ x0)
    x, steps, u = solved(hessian, x0, c, b)
    assert steps == 0
    np.testing.assert_array_equal(x, x0)
    np.testing.assert_array_equal(u, 0.0)


def test_soft_rows_that_contradict_each_other_are_violated_as_their_softness_says():
    rows, bounds = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, 1.0])  # x >= 1, x <= -1
    x, steps, u = solved(np.eye(2), np.zeros(2), rows, bounds, np.array([1e-4, 3e-4]))
    assert steps >= 0
    violated = bounds - rows @ x
    np.testing.assert_allclose(violated, np.array([1e-4, 3e-4]) * u, rtol=1e-9)
    assert violated[0] < violated[1]  # the stiffer row is violated less
    assert abs(x[1]) < 1e-12


def test_a_hard_row_holds_whatever_soft_rows_ask_for():
    random = np.random.default_rng(8)
    for _ in range(100):
        hessian, x0, c, b = program(random, 20)
        contradiction = np.vstack([c, -c[:14]])  # the box, turned inside out
        asked = np.concatenate([b, -b[:14] + 1.0])
        softness = np.concatenate([np.zeros(len(b)), np.full(14, 1e-6)])
        x, steps, _ = solved(hessian, x0, contradiction, asked, softness)
        assert steps >= 0
        assert (c @ x - b).min() > -1e-7


@pytest.mark.parametrize('copies', [2, 5])
def test_rows_that_say_the_same_do_no_harm(copies):
    random = np.random.default_rng(3)
    for _ in range(50):
        hessian, x0, c, b = program(random, 10)
        once, _, _ = solved(hessian, x0, c, b)
        x, steps, _ = solved(hessian, x0, np.vstack([c] * copies), np.concatenate([b] * copies))
        assert steps >= 0
        np.testing.assert_allclose(x, once, atol=1e-8)
