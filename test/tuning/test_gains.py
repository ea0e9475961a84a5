# SPDX-License-Identifier: Apache-2.0
"""Facts about gains from inertia, friction and delay."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.control.barrier import barrier_gradient, INTERIOR
from adaptive_blf_control.control.law import stabilising_function
from adaptive_blf_control.control.reference import Posture
from adaptive_blf_control.tuning.gains import (
    adaptation_stiffness,
    FRICTION,
    GAIN_MARGIN,
    law_gains,
    REACH,
    total_rate,
)
from adaptive_blf_control.tuning.inertia import (
    damping_rate,
    mass_matrices,
    reference_states,
    seen_inertia,
)
from adaptive_blf_control.tuning.loop_delay import loop_delay, phase_margin

ARM = TwoLinkArm()
STATES = reference_states(Posture([0.0, 0.4]), 1)
MASSES = mass_matrices(ARM, ARM.nominal, STATES.q)
INERTIA = seen_inertia(MASSES)
DELAY = loop_delay(1000.0, 0.004, 0.003)
BOUND = np.array([0.2, 0.1])
NONE = np.zeros(2)


def late_loop(gains: np.ndarray, friction: np.ndarray, known: np.ndarray) -> float:
    """Return how large e2 gets and stays: M ė2 = −F e2 + F̂ e2(t − D) − K2 e2(t − D)."""
    step, mass = 2e-4, MASSES[0]
    late = [np.zeros(2)] * round(DELAY.total / step)
    advance = np.linalg.inv(mass + step * np.diag(friction))
    e2, largest = np.array([1.0, -1.0]), 0.0
    for k in range(30000):
        late.append((known - gains) * e2)
        e2 = advance @ (mass @ e2 + step * late.pop(0))
        if k > 20000:
            largest = max(largest, float(np.abs(e2).max()))
        if not np.abs(e2).max() < 1e6:
            return np.inf
    return largest


def test_gain_and_phase_margins_are_those_that_are_asked_for() -> None:
    gains = law_gains(INERTIA, NONE, BOUND, DELAY)
    outer = gains.k1 * BOUND ** 4
    total = damping_rate(MASSES, gains.k2) + outer
    np.testing.assert_allclose(total, DELAY.largest_rate / GAIN_MARGIN)
    assert phase_margin(total, np.zeros(2), DELAY) == pytest.approx(np.full(2, np.pi / 3.0))


def test_the_barrier_and_the_adaptation_leave_45_degrees_of_phase() -> None:
    gains, total = law_gains(INERTIA, NONE, BOUND, DELAY), total_rate(DELAY)
    rate = np.array(total / 1.1)
    stiffness = 0.1 * rate * rate + total ** 2 / 16.0 + total ** 2 / 8.0
    assert np.degrees(phase_margin(np.array(total), stiffness, DELAY)) == pytest.approx(45, abs=2)
    barrier = damping_rate(MASSES, gains.barrier_weight / BOUND ** 2)
    assert barrier == pytest.approx(total * rate / 16.0)


def test_a_loop_with_these_gains_settles_and_one_with_three_times_the_damping_does_not() -> None:
    gains = law_gains(INERTIA, NONE, BOUND, DELAY).k2
    assert late_loop(gains, NONE, NONE) < 1e-6
    assert late_loop(1.2 * 1.1 * GAIN_MARGIN * gains, NONE, NONE) == np.inf


@pytest.mark.parametrize('friction', [0.1, 10.0, 1000.0])
@pytest.mark.parametrize('true_part', [0.5, 1.0, 2.0])
def test_half_the_friction_comes_on_top_and_is_stable_from_half_of_it_on(
        friction: float, true_part: float) -> None:
    nominal = np.array([friction, 0.5 * friction])
    gains = law_gains(INERTIA, nominal, BOUND, DELAY).k2
    np.testing.assert_allclose(gains - law_gains(INERTIA, NONE, BOUND, DELAY).k2,
                               FRICTION * nominal)
    true = true_part * nominal
    assert late_loop(gains, true, true) < 0.5


def test_the_damping_that_friction_allows_is_unstable_without_it() -> None:
    gains = law_gains(INERTIA, np.array([1000.0, 500.0]), BOUND, DELAY).k2
    assert late_loop(gains, NONE, NONE) == np.inf


def test_the_stiffness_of_the_adaptation_is_that_of_a_frozen_loop() -> None:
    gamma = np.array([0.3, 0.2, 0.1, 2.0, 5.0])
    states = reference_states(Posture([0.0, 0.4]), 1)._replace(
        qd=np.array([[0.5, -1.0]]), qdd=np.array([[2.0, 1.0]]))
    x = ARM.X(states.q[0], states.qd[0], states.qd[0], states.qdd[0])
    expected = np.diag(np.linalg.inv(MASSES[0]) @ x @ np.diag(gamma) @ x.T)
    np.testing.assert_allclose(adaptation_stiffness(ARM, MASSES, states, gamma), expected)


def released(reach: float, part: float) -> float:
    """Return the largest |e1| over its bound from 2 s on, of a joint released at rest at ``part``.

    ë = −k2 e2 − g − ∫e2 Λ²/8, all late by the delay, g no larger than at ``reach`` of the bound.
    """
    step, bound, rate = 5e-4, 0.15, total_rate(DELAY)
    gains = law_gains(seen_inertia(np.eye(1)[None]), np.zeros(1), np.array([bound]), DELAY)
    k1, k2, weight = (float(each[0]) for each in gains)
    late = [0.0] * round(DELAY.total / step)
    e1, speed, learned, largest = part * bound, 0.0, 0.0, 0.0
    for k in range(8000):
        alpha, alpha_dot = stabilising_function(e1, speed, 0.0, 0.0, bound, k1)
        e2 = speed - alpha
        learned += step * e2 * rate ** 2 / 8.0
        near = max(-reach * bound, min(e1, reach * bound))
        late.append(alpha_dot - k2 * e2 - barrier_gradient(near, bound, weight) - learned)
        speed += step * late.pop(0)
        e1 += step * speed
        if k > 4000:
            largest = max(largest, abs(e1) / bound)
        if not abs(e1) < 1e3 * bound:
            return np.inf
    return largest


@pytest.mark.parametrize('part', [0.5, 0.9, 0.99, 1.5])
def test_a_joint_that_was_held_at_its_bound_comes_to_rest_behind_a_delay(part: float) -> None:
    assert released(REACH, part) < 0.05


def test_with_the_barrier_of_the_paper_it_does_not() -> None:
    assert released(INTERIOR, 0.5) < 0.05
    assert released(INTERIOR, 0.99) > 1.0
