# SPDX-License-Identifier: Apache-2.0
"""Facts about the reference governor: it slows down, and what it lets pass can be followed."""

from __future__ import annotations

import numpy as np
import pytest

import adaptive_blf_control as blf
from adaptive_blf_control.control.reference import Posture, ReferencePoint, SumOfSinusoids
from adaptive_blf_control.limits.governor import Deflection
from adaptive_blf_control.limits.pace import Pace, slowed
from adaptive_blf_control.limits.prior import Prior, prior_of

ARM = blf.TwoLinkArm()
SET = prior_of(ARM, mass_error=0.1, friction=np.array([8.0, 2.0]))
SWING = SumOfSinusoids(np.zeros(2), np.array([[0.8], [0.5]]), np.array([[3.0], [4.0]]),
                       np.zeros((2, 1)))


def followed(pace, reference=SWING, nearness=0.0, steps=2000):
    for k in range(steps):
        pace.advance(k * 1e-3, reference, nearness)
        yield reference.at(pace.time), pace


@pytest.mark.parametrize(('speed', 'torque'), [(1.2, 500.0), (20.0, 30.0), (1.0, 25.0)])
def test_what_passes_keeps_velocity_and_torque_for_every_arm_of_the_set(speed, torque):
    pace = Pace(ARM, SET, np.full(2, speed), np.array([torque, torque / 4.0]))
    slowest, furthest = 1.0, 0.0
    corners = [SET.centre + SET.generators @ np.sign(z)
               for z in np.random.default_rng(0).normal(size=(8, SET.generators.shape[1]))]
    for k, (point, _) in enumerate(followed(pace)):
        velocity = pace.rate * point.velocity
        # Within the first part of a second it slows down from full speed.
        assert k < 500 or (np.abs(velocity) <= speed).all()
        acceleration = pace.rate ** 2 * point.acceleration + pace.change * point.velocity
        rows = ARM.X(point.position, velocity, velocity, acceleration)
        for theta in corners:
            assert k < 500 or (np.abs(rows @ theta) <= [torque, torque / 4.0]).all()
        slowest, furthest = min(slowest, pace.rate), pace.time
        assert abs(pace.change) <= 2.0 + 1e-9
    assert slowest < 0.9  # it was needed
    assert furthest > 0.3


def test_a_reference_that_asks_for_little_passes_bit_for_bit():
    pace = Pace(ARM, SET, np.full(2, 20.0), np.full(2, 500.0))
    for k in range(200):
        pace.advance(k * 1e-3, SWING, 0.0)
        assert pace.time == k * 1e-3
        assert (pace.rate, pace.change) == (1.0, 0.0)


def test_the_path_comes_to_rest_before_e1_reaches_its_bound():
    pace = Pace(ARM, SET, np.full(2, 20.0), np.full(2, 500.0))
    rates = [pace.rate for _, pace in followed(pace, nearness=0.85, steps=400)]
    assert rates[-1] < 1e-6
    assert all(after <= before for before, after in zip(rates, rates[1:]))


def test_a_posture_that_the_torque_cannot_hold_for_every_arm_is_never_reached():
    heavy = blf.ThreeLinkArm()
    pace = Pace(heavy, prior_of(heavy, mass_error=0.3), np.full(3, 5.0), np.full(3, 1e-6))
    moving = SumOfSinusoids(np.zeros(3), np.full((3, 1), 0.5), np.full((3, 1), 1.0),
                            np.full((3, 1), 0.5))
    assert [pace.rate for _, pace in followed(pace, moving, steps=1200)][-1] < 1e-3
    assert [pace.rate for _, pace in followed(Pace(ARM, SET, np.ones(2), np.ones(2)),
                                              Posture(np.zeros(2)), steps=5)][-1] == 1.0


class Pendulum:
    """A mass on a rod: M = θ, and θ sin y of weight, in its only row."""

    n = m = 1

    def X(self, q, qd, qdr, qddr):
        return np.array([qddr + np.sin(q)])


@pytest.mark.parametrize('left', [1.3, 1.2])
def test_a_posture_that_leaves_little_torque_is_passed_with_a_rate_that_changes_slowly(left):
    """With 2/s the change of the rate alone takes 1.6 N·m there, which is more than is left."""
    arm, known = Pendulum(), Prior(np.ones(1), np.full((1, 1), 0.01))
    limit = np.full(1, left / 0.85)
    pace = Pace(arm, known, np.full(1, 20.0), limit)
    turning = SumOfSinusoids(np.full(1, 0.5 * np.pi), np.full((1, 1), 1.5), np.full((1, 1), 0.53),
                             np.full((1, 1), -0.5 * np.pi))
    for k, (point, _) in enumerate(followed(pace, turning, steps=6000)):
        acceleration = pace.rate ** 2 * point.acceleration + pace.change * point.velocity
        assert k < 500 or (np.abs(arm.X(point.position, 0.0, 0.0, acceleration)) <= limit).all()
    assert pace.time > 4.0  # over the top and on


def test_the_path_slows_down_in_time_where_its_rate_may_change_less_later_on():
    """Past the top, where little torque is left to slow down with, the way turns sharply."""
    arm, known = Pendulum(), Prior(np.ones(1), np.full((1, 1), 0.01))
    pace = Pace(arm, known, np.full(1, 20.0), np.full(1, 1.35 / 0.85))
    swing = SumOfSinusoids(np.full(1, 0.5 * np.pi), np.full((1, 1), 0.5), np.full((1, 1), 2.0),
                           np.full((1, 1), -0.5 * np.pi))
    for k, (point, _) in enumerate(followed(pace, swing, steps=5000)):
        acceleration = pace.rate ** 2 * point.acceleration + pace.change * point.velocity
        torque = np.abs(arm.X(point.position, 0.0, 0.0, acceleration))
        assert k < 500 or (torque <= 1.35).all()
    assert pace.time > 2.0


def test_the_loop_slows_down_instead_of_leaving_a_set(repository):
    run = blf.simulate(repository / 'config' / 'two_link.yaml', 1.5, arm_driver={
        'initial_velocity': [0.0]}, controller={'safety_filter': 'limits', 'limits': {
            'velocity': [0.4], 'prior': {'mass_error': 0.1, 'friction': [8.0, 2.0]}}})
    filter_ = run.loop.controller.safety_filter
    assert run.kept
    assert np.abs(run.qd).max() < 0.4
    assert np.abs(run.e1).max() < 0.05
    assert filter_.counts[1:] == [0, 0, 0]
    assert 0.7 < filter_.governor.pace.time < 1.45


def test_a_reference_that_leaves_the_safety_set_is_followed_as_far_as_there_is_room():
    class Beyond:
        def at(self, t):
            return ReferencePoint(np.array([3.0 * np.sin(0.5 * t), 0.0]),
                                  np.array([1.5 * np.cos(0.5 * t), 0.0]),
                                  np.array([-0.75 * np.sin(0.5 * t), 0.0]))

        def range(self):
            return np.array([-3.0, 0.0]), np.array([3.0, 0.0])

    motion = blf.Controller(ARM, safety_filter='limits', torque_limit=[60.0, 15.0],
                            safety={'lower': -1.0, 'upper': 1.0},
                            performance={'lower': -0.1, 'upper': 0.1},
                            limits={'velocity': [2.0, 2.0],
                                    'prior': {'mass_error': 0.1, 'friction': [8.0, 2.0]}})
    motion.follow(Beyond())
    truth, q, qd = ARM.dynamics(ARM.nominal), np.zeros(2), np.zeros(2)
    for k in range(2000):
        output = motion.update(k * 1e-3, q, qd, ARM.nominal)
        assert output.reference.position[0] <= 0.9 + 1e-9
        assert (output.bounds.lower < output.e1).all()
        assert (output.e1 < output.bounds.upper).all()
        q, qd = truth.advance(q, qd, output.torque, 1e-3)
        assert q[0] <= 1.0
    assert q[0] > 0.85


def test_what_is_followed_has_the_acceleration_of_its_velocity():
    motion = blf.Controller(ARM, safety_filter='limits', torque_limit=500.0, limits={
        'velocity': [1.2], 'prior': {'mass_error': 0.1, 'friction': [8.0, 2.0]}},
        safety={'lower': -3.0, 'upper': 3.0}, performance={'lower': -0.5, 'upper': 0.5})
    governor, h = motion.safety_filter.governor, 1e-3
    q, before, slowed = np.zeros(2), None, 0
    for k in range(800):
        governed = governor.governed(k * h, q, SWING)
        point, pace = governed.point, governor.pace
        if before is not None:
            gained = (point.velocity - before.velocity) / h
            np.testing.assert_allclose(gained, point.acceleration, atol=0.1)
            slowed += pace.rate < 0.7
        before = point
    assert slowed > 20


def test_a_reference_beside_its_path_comes_to_rest_where_nothing_of_the_way_back_counts():
    motion = blf.Controller(ARM, safety_filter='limits', torque_limit=500.0, limits={
        'velocity': [1.2], 'prior': {'mass_error': 0.1, 'friction': [8.0, 2.0]}},
        safety={'lower': -3.0, 'upper': 3.0}, performance={'lower': -0.5, 'upper': 0.5})
    begin = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
    path = begin._replace(position=np.ones(2))
    deflection = Deflection(motion.safety_filter.governor._parts, 1e-3, begin)
    for _ in range(100):
        point = deflection.advance(1e-3, path, slowed(0.0))
    assert (point.velocity > 0.5).all()
    for _ in range(400):
        point = deflection.advance(1e-3, path, slowed(0.8))
    assert np.abs(point.velocity).max() < 0.01
    assert (point.position < 0.9).all()
