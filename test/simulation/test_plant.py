# SPDX-License-Identifier: Apache-2.0
"""Facts about the simulated arm: the torque is held, clipped, and moves the true dynamics."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.plant import SimulatedArm
from adaptive_blf_control.simulation.settings import PlantSettings

ARM = TwoLinkArm()
THETA = ARM.nominal
START = PlantSettings(initial_position=[0.1, 1.0], initial_velocity=[0.5, -0.2])


def plant(limit: float = 100.0, substeps: int = 1, **changes) -> SimulatedArm:
    return SimulatedArm(START.replace(torque_limit=limit, substeps=substeps, **changes), ARM)


def moved(arm: SimulatedArm, torque, theta=THETA, dt: float = 1e-3):
    return ARM.dynamics(theta).advance(arm.q, arm.qd, np.array(torque), dt, 1)


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
    arm = plant()
    arm.q[:] = 9.0  # as a caller's mistake
    np.testing.assert_array_equal(plant().q, [0.1, 1.0])


def test_true_parameters_are_told_by_name():
    arm = plant()
    (t, theta), = arm.truth(('p3', 'fc_joint1', 'p1'))  # 0 for an effect that is not there
    assert t == 0.0
    np.testing.assert_array_equal(theta, [0.242, 0.0, 3.473])


@pytest.mark.parametrize('bad', [float('nan'), float('inf')])
@pytest.mark.parametrize('name', ['initial_position', 'initial_velocity'])
def test_a_start_is_finite(name, bad):
    with pytest.raises(ParameterError, match=rf'arm_driver\.{name}'):
        START.replace(**{name: [0.0, bad]})


@pytest.mark.parametrize('dead_time', [0, 1, 2, 5])
def test_a_command_acts_as_many_whole_samples_late_as_the_dead_time(dead_time):
    arm, acted = plant(dead_time=dead_time), []
    for k in range(8):
        arm.measure(arm.torque, 1e-3 if k else 0.0)
        arm.apply(np.array([k + 1.0, 0.0]))
        expected = moved(arm, [max(k + 1.0 - dead_time, 0.0), 0.0])
        arm.advance(1e-3)
        np.testing.assert_array_equal([arm.q, arm.qd], expected)
        acted.append(arm.torque[0])
    assert acted == [max(k + 1.0 - dead_time, 0.0) for k in range(8)]


def test_a_change_acts_from_the_sample_at_its_time_on():
    arm = plant(**{'schedule.time': [0.003], 'schedule.parameter': ['fv_joint1'],
                   'schedule.value': [9.0]})
    changed = THETA + [0.0, 0.0, 0.0, 9.0 - THETA[3], 0.0]
    for k in range(6):
        expected = moved(arm, [0.0, 0.0], THETA if k < 3 else changed)
        arm.advance(1e-3)
        np.testing.assert_array_equal([arm.q, arm.qd], expected)


def test_a_retuned_plant_goes_on_from_where_it_is_with_what_has_changed():
    arm = plant()
    arm.apply(np.array([4.0, -1.0]))
    arm.advance(1e-3)
    state, epochs, sensor = (arm.q.copy(), arm.qd.copy(), arm.t), arm.epochs, arm.sensor
    arm.retune(arm.settings.replace(torque_limit=[3.0, 0.5]))
    np.testing.assert_array_equal(arm.torque, [3.0, -0.5])
    assert arm.epochs is epochs
    assert arm.sensor is sensor
    arm.retune(arm.settings.replace(torque_limit=100.0, true_model='given',
                                    true_parameters=2.0 * THETA))
    assert (arm.q.tolist(), arm.qd.tolist(), arm.t) == (*map(np.ndarray.tolist, state[:2]),
                                                        state[2])
    arm.apply(np.array([4.0, -1.0]))
    expected = moved(arm, [4.0, -1.0], 2.0 * THETA)
    arm.advance(1e-3)
    np.testing.assert_array_equal([arm.q, arm.qd], expected)


def test_a_change_that_lies_behind_is_in_force_after_retuning():
    arm = plant()
    for _ in range(5):
        arm.advance(1e-3)
    schedule = {'schedule.time': [0.002, 1.0], 'schedule.parameter': ['fv_joint1', 'fv_joint1'],
                'schedule.value': [9.0, 20.0]}
    arm.retune(arm.settings.replace(**schedule))
    expected = moved(arm, [0.0, 0.0], THETA + [0.0, 0.0, 0.0, 9.0 - THETA[3], 0.0])
    arm.advance(1e-3)
    np.testing.assert_array_equal([arm.q, arm.qd], expected)


def test_commands_under_way_stay_so_while_another_setting_changes():
    arm = plant(dead_time=3)
    for k in range(3):
        arm.measure(arm.torque, 1e-3)
        arm.apply(np.array([k + 1.0, 0.0]))
        arm.advance(1e-3)
    arm.retune(arm.settings.replace(substeps=2))
    arm.measure(arm.torque, 1e-3)
    assert arm.torque[0] == 1.0
    arm.retune(arm.settings.replace(dead_time=2))  # from now on what was commanded last
    arm.measure(arm.torque, 1e-3)
    assert arm.torque[0] == 3.0


@pytest.mark.parametrize(('changes', 'message'), [
    ({'payload': 1.0}, 'no tip'), ({'sensors.model': 'nowhere:Sensor'}, 'sensors.model'),
    ({'true_model': 'given', 'true_parameters': [1.0]}, '5 values'),
    ({'torque_limit': [1.0, 2.0, 3.0]}, 'torque_limit')])
def test_settings_that_cannot_be_used_change_nothing(changes, message):
    arm = plant(dead_time=2)
    before = arm.settings, arm.epochs, arm.sensor
    with pytest.raises(ParameterError, match=message):
        arm.retune(arm.settings.replace(dead_time=5, substeps=3, **changes))
    assert all(now is then for now, then in zip((arm.settings, arm.epochs, arm.sensor), before))
