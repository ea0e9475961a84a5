# SPDX-License-Identifier: Apache-2.0
"""Facts about the braking that is derived: within what is left, and no sum of stops is shorter."""

from __future__ import annotations

from hypothesis import given, settings, strategies as st
import numpy as np

from adaptive_blf_control.limits.braking import CLOSE, shortest_stops


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 60), n=st.integers(1, 7))
@settings(max_examples=100, deadline=None)
def test_no_other_braking_within_the_budget_stops_on_shorter_ways(seed, rows, n):
    random = np.random.default_rng(seed)
    cost = random.uniform(0.01, 1.0, (rows, n)) * 10.0 ** random.uniform(-3.0, 2.0, n)
    budget, speed = random.uniform(0.1, 10.0, rows), random.uniform(0.5, 3.0, n)
    braking = shortest_stops(cost, budget, speed)
    assert (braking > 0.0).all()
    assert (cost @ braking <= budget).all()
    least = ((speed ** 2 / braking) ** 2).sum()
    for _ in range(50):
        others = braking * random.uniform(0.5, 1.5, n)
        others *= (budget / (cost @ others)).min()
        assert ((speed ** 2 / others) ** 2).sum() >= (1.0 - CLOSE) * least


def test_a_joint_that_costs_little_gets_much_and_holds_nobody_back():
    cost = np.array([[1.0, 1e-4], [0.0, 1e-3]])
    first, second = shortest_stops(cost, np.ones(2), np.ones(2))
    np.testing.assert_allclose(first, 1.0, rtol=0.02)
    assert 10.0 < second < 200.0  # of 1000 that it could have alone
