# SPDX-License-Identifier: Apache-2.0
"""Facts about the simulated arm: the torque is held, clipped, and moves the true dynamics."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.plant import Epoch, SimulatedArm

ARM = TwoLinkArm()
THETA = ARM.nominal
TRUE = Epoch(0.0, ARM.dynamics(THETA), dict(zip(ARM.parameters, THETA.tolist())))


def plant(limit: float = 100.0, substeps: int = 1) -> SimulatedArm:
    return SimulatedArm([TRUE], np.array([0.1, 1.0]), np.array([0.5, -0.2]), np.full(2, limit),
                        substeps)


def energy(arm: SimulatedArm) -> float:
    return float(0.5 * arm.qd @ ARM.Y1(arm.q, arm.qd) @ THETA)


def test_a_plant_moves_as_the_dynamics_say_under_the_held_torque():
    arm, tau = plant(substeps=3), np.array([4.0, -1.0])
    expected = ARM.dynamics(THETA).advance(arm.q, arm.qd, tau, 0.002, 3)
    arm.apply(tau)
    arm.advance(0.002)
    np.testing.assert_array_equal([arm.q, arm.qd], expected)


def test_the_torque_is_held_until_the_next_one():
    arm = plant()
    assert not arm.torque.any()
    arm.apply(np.array([4.0, -1.0]))
    for _ in range(3):
        arm.advance(0.001)
        np.testing.assert_array_equal(arm.torque, [4.0, -1.0])


def test_drives_saturate_and_report_what_they_apply():
    arm = plant(limit=3.0)
    arm.apply(np.array([4.0, -9.0]))
    np.testing.assert_array_equal(arm.torque, [3.0, -3.0])
    arm.apply(np.array([float('nan'), -float('inf')]))
    np.testing.assert_array_equal(arm.torque, [0.0, -3.0])


def test_change_of_energy_is_work_of_torque_minus_friction():
    arm, tau, work, dt = plant(), np.array([4.0, 1.0]), 0.0, 1e-4
    before = energy(arm)
    arm.apply(tau)
    for _ in range(2000):
        qd = arm.qd
        arm.advance(dt)
        mean = 0.5 * (qd + arm.qd)
        work += dt * mean @ (tau - THETA[3:] * mean)
    assert energy(arm) - before == pytest.approx(work, abs=1e-6)


def test_without_torque_friction_brings_the_arm_to_rest():
    arm, last = plant(), np.inf
    for _ in range(5000):
        arm.advance(0.001)
        assert energy(arm) <= last
        last = energy(arm)
    assert np.abs(arm.qd).max() < 1e-3


def test_a_trial_leaves_the_plant_where_it_is():
    arm = plant()
    before = arm.q.copy(), arm.qd.copy(), arm.torque.copy()
    arm.trial(np.array([4.0, 1.0]), 0.01)
    np.testing.assert_array_equal([arm.q, arm.qd, arm.torque], before)


def test_states_handed_out_are_never_changed():
    arm = plant()
    q, copy = arm.q, arm.q.copy()
    arm.advance(0.01)
    np.testing.assert_array_equal(q, copy)
    assert not np.array_equal(arm.q, copy)


def test_a_plant_keeps_its_own_start():
    q = np.array([0.1, 1.0])
    arm = SimulatedArm([TRUE], q, np.zeros(2), np.ones(2))
    q[:] = 9.0
    np.testing.assert_array_equal(arm.q, [0.1, 1.0])


def test_true_parameters_are_told_by_name():
    arm = plant()
    (t, theta), = arm.truth(('p3', 'fc_joint1', 'p1'))  # 0 for an effect that is not there
    assert t == 0.0
    np.testing.assert_array_equal(theta, [0.242, 0.0, 3.473])


@pytest.mark.parametrize('bad', [float('nan'), float('inf')])
@pytest.mark.parametrize('name', ['initial_position', 'initial_velocity'])
def test_a_start_is_finite(name, bad):
    start = {'initial_position': np.zeros(2), 'initial_velocity': np.zeros(2),
             name: np.array([0.0, bad])}
    with pytest.raises(ParameterError, match=rf'arm_driver\.{name}'):
        SimulatedArm([TRUE], *start.values(), np.ones(2))
