# SPDX-License-Identifier: Apache-2.0
"""Facts about the safety filter: transparent far away, sets kept whatever a law asks for."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.three_link import ThreeLinkArm
from adaptive_blf_control.limits.obstacles import distance, half_space
from adaptive_blf_control.limits.safety_filter import (
    ACTIVE,
    BRAKING,
    IDLE,
    limited_torque,
    Limits,
    Rows,
    SOFTENED,
    stopping_rows,
)
from adaptive_blf_control.limits.viability import acceleration_bounds

ARM = ThreeLinkArm()
N, H = ARM.n, 1e-3
NONE = Rows(np.empty((0, N)), np.empty(0))
LOWER, UPPER = np.full(N, -1.0), np.full(N, 1.2)
SPEED = np.full(N, 2.0)
LIMITS = Limits(np.array([60.0, 30.0, 8.0]), np.full(N, 4.0), 20.0)


def model(q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return M and h of the nominal arm."""
    mass = np.column_stack([ARM.Y1(q, axis) @ ARM.nominal for axis in np.eye(N)])
    zero = np.zeros(N)
    bias = -mass @ ARM.dynamics(ARM.nominal).acceleration(q, qd, zero)
    return mass, bias


def filtered(q, qd, torque, rows=NONE, limits=LIMITS, margin=0.0):
    low, high = acceleration_bounds(q, qd, LOWER, UPPER, SPEED, limits.braking, H)
    return limited_torque(torque, *model(q, qd), qd, low, high, np.full(N, margin), rows, limits)


def test_far_from_every_limit_the_torque_is_returned_bit_for_bit():
    random = np.random.default_rng(0)
    for _ in range(50):
        q, qd = random.uniform(-0.3, 0.3, (2, N))
        _, bias = model(q, qd)
        torque = bias + random.normal(size=N)
        result, state = filtered(q, qd, torque)
        assert state == IDLE
        assert result.tobytes() == torque.tobytes()


@pytest.mark.parametrize('asked', ['towards the limits', 'at random', 'back and forth'])
def test_an_arm_stays_inside_position_and_speed_limits_whatever_is_asked(asked):
    random, robot = np.random.default_rng(1), ARM.dynamics(ARM.nominal)
    q, qd, states = np.zeros(N), np.zeros(N), set()
    for k in range(2500):
        sign = {'towards the limits': np.ones(N), 'at random': random.choice([-1.0, 1.0], N),
                'back and forth': np.full(N, 1.0 if k // 600 % 2 else -1.0)}[asked]
        torque, state = filtered(q, qd, 100.0 * sign * LIMITS.torque, margin=0.2)
        states.add(state)
        assert (np.abs(torque) <= LIMITS.torque).all()
        q, qd = robot.advance(q, qd, torque, H)
        assert ((q > LOWER) & (q < UPPER)).all()
        # A torque is held over the sample, not an acceleration.
        assert (np.abs(qd) < SPEED * 1.005).all()
    assert states <= {IDLE, ACTIVE}


def tip_rows(q, qd, wall):
    """Return the row that keeps the tip of the arm before a wall, and its clearance."""
    normal, step = np.empty(3), 1e-6
    tip = ARM.link_points(q)[-1]
    jacobian = np.column_stack([(ARM.link_points(q + step * axis)[-1]
                                 - ARM.link_points(q - step * axis)[-1]) / (2.0 * step)
                                for axis in np.eye(N)])
    clearance = distance(wall, 0, np.append(tip, np.zeros(3 - tip.size)), normal)
    gradient = (normal[:tip.size] @ jacobian)[None]
    return stopping_rows(np.array([clearance]), gradient, gradient @ qd, qd, LIMITS), clearance


def test_the_tip_stops_before_a_wall_that_a_law_drives_it_into():
    robot = ARM.dynamics(ARM.nominal)
    reach = float(ARM.link_points(np.zeros(N))[-1][0])
    wall = half_space([0.8 * reach, 0.0, 0.0], [-1.0, 0.0, 0.0])
    q, qd = np.array([1.0, 0.9, 0.5]), np.zeros(N)
    least, states = np.inf, set()
    for _ in range(4000):
        rows, clearance = tip_rows(q, qd, wall)
        least = min(least, clearance)
        torque, state = filtered(q, qd, 60.0 * (0.0 - q) - 5.0 * qd, rows)
        states.add(state)
        q, qd = robot.advance(q, qd, torque, H)
    assert least > -2e-4
    assert least < 0.05  # it went there
    assert ACTIVE in states


def test_the_full_brake_satisfies_the_row_of_a_fixed_obstacle():
    random = np.random.default_rng(3)
    for _ in range(200):
        gradient, qd = random.normal(size=(1, N)), random.normal(size=N)
        rows = stopping_rows(np.array([5.0]), gradient, gradient @ qd, qd, LIMITS)
        brake = -LIMITS.braking * np.sign(qd)
        assert rows.matrix[0] @ brake >= rows.bound[0] - 1e-9


def test_rows_that_contradict_the_torque_limits_are_softened_and_the_limits_hold():
    q, qd = np.zeros(N), np.array([1.0, 0.0, 0.0])
    impossible = Rows(np.eye(N), np.full(N, 1e4))
    torque, state = filtered(q, qd, np.zeros(N), impossible)
    assert state == SOFTENED
    assert (np.abs(torque) <= LIMITS.torque).all()


def test_a_program_without_any_solution_damps_the_joints():
    q, qd = np.zeros(N), np.array([0.5, -0.5, 0.1])
    none = LIMITS._replace(torque=np.full(N, -1.0))  # no torque is within these
    torque, state = limited_torque(np.zeros(N), *model(q, qd), qd, np.full(N, -1.0),
                                   np.full(N, 1.0), np.zeros(N), NONE, none)
    assert state == BRAKING
    assert np.isfinite(torque).all()
