# SPDX-License-Identifier: Apache-2.0
"""Facts about the braking that is derived: within what is left, and no sum of stops is shorter."""

from __future__ import annotations

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.limits import braking as module
from adaptive_blf_control.limits.braking import (
    Asked,
    checked_braking,
    CLOSE,
    Resting,
    shortest_stops,
)
from adaptive_blf_control.limits.prior import prior_of


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


@pytest.mark.parametrize('place', range(6))
def test_what_was_asked_last_is_not_derived_again_and_anything_else_is(monkeypatch, place):
    """It takes too long for a motion that has to begin, or for a live change of obstacles."""
    arm, derived = TwoLinkArm(), []
    monkeypatch.setattr(module, 'shortest_stops', lambda *given: derived.append(
        shortest_stops(*given)) or derived[-1])
    asked = [np.full(2, 0.1), np.full(2, 50.0), np.array([0.0, 0.0]), np.full(2, 2.0),
             np.full(2, -1.0), np.full(2, 1.0)]

    def answer() -> np.ndarray:
        return checked_braking(Resting(arm, prior_of(arm), *asked[:2]),
                               Asked(asked[2], 'short_stops', *asked[3:]))

    first = answer()
    first[:] = 0.0  # the caller's own
    assert (answer() > 0.0).all()
    assert len(derived) == 1
    asked[place] = asked[place] + [0.0, 0.1]
    second = answer()
    assert len(derived) == 2
    np.testing.assert_array_equal(answer(), second)
    assert len(derived) == 2


def test_with_equal_parts_every_joint_brakes_with_the_same_part_of_its_torque_limit():
    """Twice the torque limit of both doubles it; with short stops the lighter joint gets more."""
    arm = TwoLinkArm()

    def braking(rule: str, limit: float) -> np.ndarray:
        return checked_braking(
            Resting(arm, prior_of(arm), np.full(2, 1e-9), limit * np.array([40.0, 10.0])),
            Asked(np.zeros(2), rule, np.full(2, 2.0), np.full(2, -1.0), np.full(2, 1.0)))

    equal, stops = braking('equal', 1.0), braking('short_stops', 1.0)
    np.testing.assert_allclose(braking('equal', 2.0), 2.0 * equal)
    assert (1.0 / stops ** 2).sum() < (1.0 / equal ** 2).sum()
