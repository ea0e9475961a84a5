# SPDX-License-Identifier: Apache-2.0
"""Facts about what filters let through and what they distort."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.identification.state_filter import LowPass
from adaptive_blf_control.simulation.sensors import Encoder
from adaptive_blf_control.simulation.settings import SensorSettings
from adaptive_blf_control.tuning.robot import Robot
from adaptive_blf_control.tuning.sensing import filters_for, measured_velocity_noise

ROBOT = Robot(encoder_counts=2000, torque_noise=0.05)
PERIOD = 1.0 / ROBOT.rate


def test_the_velocity_noise_is_that_of_the_simulated_sensors() -> None:
    settings = SensorSettings(model='encoder', encoder_counts=2000, gear_ratio=1.0)
    sensors = Encoder(settings, TwoLinkArm(['only', 'other']))
    speed = 1.2345  # rad/s: the error within a count is spread evenly
    t = np.arange(20000) * PERIOD
    measured = [sensors.measure(np.full(2, speed * time), np.full(2, speed), np.zeros(2),
                                PERIOD).qd[0] for time in t]
    assert np.std(measured[1000:]) == pytest.approx(measured_velocity_noise(ROBOT), rel=0.3)


def test_noise_behind_the_state_filter_is_what_is_computed() -> None:
    """White errors of a count, through the filter that the identifier uses."""
    found = filters_for(ROBOT, 1.0, 1.0, 20.0)
    kept = LowPass(1, found.state_order, found.state_time_constant)
    random = np.random.default_rng(0)
    velocities, torques = [], []
    for position, torque in zip(random.uniform(-0.5, 0.5, 40000) * ROBOT.resolution,
                                random.normal(0.0, ROBOT.torque_noise, 40000)):
        _, qd, tau = kept.update(PERIOD, np.array([position]), np.zeros(1), np.array([torque]))
        velocities.append(qd[0])
        torques.append(tau[0])
    through = np.hypot(np.std(velocities[2000:]) / found.time_constant, np.std(torques[2000:]))
    assert found.noise == pytest.approx(through, rel=0.4)


def test_noisier_sensors_get_slower_filters_and_faster_motions_quicker_ones() -> None:
    usual = filters_for(ROBOT, 0.5, 1.0, 20.0).state_time_constant
    quieter = Robot(encoder_counts=200000, torque_noise=0.001)
    assert filters_for(quieter, 0.5, 1.0, 20.0).state_time_constant < usual
    assert filters_for(ROBOT, 3.0, 1.0, 20.0).state_time_constant < usual


def test_exact_sensors_get_no_state_filter() -> None:
    assert filters_for(Robot(), 0.5, 1.0, 20.0).state_order == 0


def test_dry_friction_gets_quicker_filters_than_a_smooth_motion() -> None:
    """The sum of a distortion c T and of the noise is least where the noise says so."""
    usual = filters_for(ROBOT, 0.5, 1.0, 20.0)
    rough = filters_for(ROBOT, 0.5, 1.0, 20.0, lambda constant: 5.0 * constant)
    assert rough.state_time_constant < usual.state_time_constant
    assert rough.motion_error == pytest.approx(5.0 * rough.state_time_constant, rel=0.03)
    assert filters_for(ROBOT, 0.5, 1.0, 20.0, lambda constant: 0.0) == usual


def test_no_sensors_are_so_noisy_that_a_filter_hides_a_change() -> None:
    """Four stages of 21 ms, 84 ms in all: a touch is to be seen soon after."""
    assert filters_for(Robot(encoder_counts=500), 1e-3, 1.0, 1.0).state_time_constant == 0.021
