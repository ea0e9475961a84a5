# SPDX-License-Identifier: Apache-2.0
"""Facts about viability: whatever is asked of a joint within the bounds, it stays inside."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.limits.viability import acceleration_bounds, is_viable

H = 1e-3


@pytest.mark.parametrize('policy', ['hardest towards the limit', 'random', 'alternating'])
@pytest.mark.parametrize('period', [1e-3, 1e-2])
def test_a_joint_that_starts_viable_never_leaves_whatever_is_asked(policy, period):
    random = np.random.default_rng(0)
    n, steps = 200, 5000
    lower, upper = -random.uniform(0.1, 2.0, n), random.uniform(0.1, 2.0, n)
    speed, braking = random.uniform(0.5, 3.0, n), random.uniform(2.0, 15.0, n)
    q, qd = random.uniform(lower, upper), np.zeros(n)
    furthest = np.inf
    for k in range(steps):
        low, high = acceleration_bounds(q, qd, lower, upper, speed, braking, period)
        assert (low <= high + 1e-9).all()
        side = {'hardest towards the limit': np.ones(n),
                'random': random.uniform(-0.2, 1.0, n),
                'alternating': np.full(n, 1.0 if k // 700 % 2 else -1.0)}[policy]
        a = np.where(side > 0, side * high, -side * low)
        a = np.minimum(np.maximum(a, low), high)
        turning = np.where(a != 0.0, np.clip(-qd / np.where(a == 0.0, 1.0, a), 0.0, period), 0.0)
        for t in (turning, period):  # the extreme between the samples, and the next sample
            position = q + qd * t + 0.5 * a * t * t
            furthest = min(furthest, (upper - position).min(), (position - lower).min())
        q, qd = q + qd * period + 0.5 * a * period ** 2, qd + a * period
        assert (np.abs(qd) <= speed + 1e-9).all()
    assert furthest > -1e-12


def test_braking_is_never_asked_to_be_harder_than_stated():
    random = np.random.default_rng(1)
    braking = 5.0
    for _ in range(2000):
        distance, speed = random.uniform(0.0, 1.0), random.uniform(0.0, 4.0)
        if not is_viable(distance, speed, braking, H):
            continue
        _, high = acceleration_bounds(np.array([0.0]), np.array([speed]), np.array([-9.0]),
                                      np.array([distance]), np.array([9.0]), np.array([braking]),
                                      H)
        assert high[0] >= -braking - 1e-6 or speed < braking * H


def test_a_joint_that_could_not_be_stopped_is_not_viable():
    assert is_viable(0.1, 0.99, 5.0, 1e-9)
    assert not is_viable(0.1, 1.01, 5.0, 1e-9)
    assert not is_viable(-0.01, -1.0, 5.0, 1e-9)


def test_far_from_its_limits_a_joint_may_do_what_its_speed_allows():
    low, high = acceleration_bounds(np.zeros(1), np.array([0.5]), np.array([-9.0]),
                                    np.array([9.0]), np.ones(1), np.full(1, 5.0), H)
    np.testing.assert_allclose([low[0], high[0]], [-1.5 / H, 0.5 / H])
