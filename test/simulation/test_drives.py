# SPDX-License-Identifier: Apache-2.0
"""Facts about the drives in real time: mean torque, brakes, watchdog and ramp; times are given."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.simulation.drives import Drives
from adaptive_blf_control.simulation.plant import SimulatedArm
from adaptive_blf_control.simulation.settings import PlantSettings, WatchdogSettings

ARM = TwoLinkArm()
DYNAMICS = ARM.dynamics(ARM.nominal)
START = PlantSettings(initial_position=[0.1, 2.0], initial_velocity=[0.5, -0.3])
PERIOD = 10_000_000  # ns
A, B = np.array([10.0, -4.0]), np.array([-30.0, 8.0])


def ns(ms: float) -> int:
    return round(ms * 1e6)


def driven(**watchdog) -> Drives:
    """Return drives whose clock runs from 0 on and whose first state has been taken."""
    drives = Drives(SimulatedArm(START, ARM), WatchdogSettings(**watchdog), 0.05)
    drives.begin(0)
    drives.sample(0, PERIOD, True)
    return drives


def advanced(q, qd, *pieces):
    for torque, ms in pieces:
        q, qd = DYNAMICS.advance(q, qd, torque, ms * 1e-3, 1)
    return q, qd


def test_until_the_first_command_the_brakes_hold_and_nothing_is_measured():
    drives = driven()
    effort = drives.sample(ns(10.0), PERIOD, True)
    assert np.isnan(effort.torque).all()
    assert effort.interval == 0.0
    assert (drives.released, drives.timed_out) == (False, False)
    np.testing.assert_array_equal(drives.plant.q, START.initial_position)


def test_a_command_acts_from_the_moment_it_arrives_and_effort_is_the_mean():
    drives = driven()
    assert drives.command(A, ns(4.0), PERIOD)
    effort = drives.sample(ns(10.0), PERIOD, False)
    np.testing.assert_allclose(effort.torque, A, rtol=1e-12)
    assert effort.interval == pytest.approx(6e-3)
    expected = advanced(START.initial_position, START.initial_velocity, (A, 6.0))
    np.testing.assert_allclose([drives.plant.q, drives.plant.qd], expected, rtol=0.0, atol=1e-14)
    assert not drives.command(B, ns(13.0), PERIOD)
    effort = drives.sample(ns(20.0), PERIOD, False)
    np.testing.assert_allclose(effort.torque, 0.3 * A + 0.7 * B, rtol=1e-12)
    np.testing.assert_allclose([drives.plant.q, drives.plant.qd],
                               advanced(*expected, (A, 3.0), (B, 7.0)), rtol=0.0, atol=1e-14)


def test_after_a_stall_the_arm_has_moved_in_steps_of_a_period():
    drives = driven()
    drives.command(A, 0, PERIOD)
    drives.sample(ns(2000.0), PERIOD, False)
    fine = advanced(START.initial_position, START.initial_velocity, *[(A, 1.0)] * 2000)
    np.testing.assert_allclose([drives.plant.q, drives.plant.qd], fine, rtol=1e-3)


def test_without_commands_the_torque_is_zero_until_the_next_one():
    drives = driven()
    drives.command(A, 0, PERIOD)
    drives.sample(ns(10.0), PERIOD, False)
    effort = drives.sample(ns(20.0), PERIOD, True)
    np.testing.assert_array_equal(effort.torque, 0.0)
    assert drives.timed_out
    drives.command(B, ns(25.0), PERIOD)
    assert not drives.timed_out
    np.testing.assert_allclose(drives.sample(ns(30.0), PERIOD, False).torque, 0.5 * B,
                               rtol=1e-12)


def test_damping_is_a_torque_against_the_motion_of_the_sample_before():
    drives = driven(timeout_action='damping', damping=[4.0, 0.5])
    drives.command(A, 0, PERIOD)
    drives.sample(ns(10.0), PERIOD, False)
    qd = drives.plant.qd.copy()
    effort = drives.sample(ns(20.0), PERIOD, True)
    np.testing.assert_allclose(effort.torque, [-4.0, -0.5] * qd, rtol=1e-12)
    drives.watchdog = WatchdogSettings()  # taken at once
    np.testing.assert_array_equal(drives.sample(ns(30.0), PERIOD, True).torque, 0.0)


def test_damping_brakes_through_a_stall_and_drives_nothing_the_other_way():
    drives = driven(timeout_action='damping', damping=[5.0])
    drives.command(np.array([150.0, -90.0]), 0, PERIOD)
    drives.sample(ns(200.0), PERIOD, False)
    q, qd = drives.plant.q.copy(), drives.plant.qd.copy()
    assert np.abs(qd).min() > 1.0
    drives.sample(ns(3200.0), PERIOD, True)
    assert np.abs(drives.plant.qd).max() < 1e-2 * np.abs(qd).max()
    assert np.abs(drives.plant.q - q).max() < 10.0  # rad; 3 s of the first torque: hundreds


def test_a_ramp_leads_to_zero_in_its_time_and_then_the_brakes_hold():
    drives = driven()
    drives.command(A, 0, PERIOD)
    drives.sample(ns(10.0), PERIOD, False)
    drives.ramp_down(ns(10.0))
    efforts = [drives.sample(ns(ms), PERIOD, True).torque for ms in (20.0, 30.0, 40.0, 50.0)]
    np.testing.assert_allclose(efforts, np.outer([0.8, 0.6, 0.4, 0.2], A), rtol=1e-12)
    assert drives.released
    np.testing.assert_allclose(drives.sample(ns(60.0), PERIOD, True).torque, 0.0, atol=1e-12)
    assert not drives.released
    held = drives.plant.q.copy()
    assert np.isnan(drives.sample(ns(70.0), PERIOD, True).torque).all()
    np.testing.assert_array_equal(drives.plant.q, held)
    np.testing.assert_array_equal(drives.plant.qd, 0.0)
    assert drives.command(B, ns(75.0), PERIOD)
    np.testing.assert_allclose(drives.sample(ns(80.0), PERIOD, False).torque, B, rtol=1e-12)


def test_a_ramp_that_is_given_up_leaves_the_command_in_force():
    drives = driven()
    drives.command(A, 0, PERIOD)
    drives.ramp_down(ns(10.0))
    drives.stay()
    np.testing.assert_allclose(drives.sample(ns(20.0), PERIOD, False).torque, A, rtol=1e-12)


def test_a_ramp_of_no_time_brakes_at_once():
    drives = driven()
    drives.ramp_time = 0.0
    drives.command(A, 0, PERIOD)
    drives.sample(ns(10.0), PERIOD, False)
    drives.ramp_down(ns(10.0))
    np.testing.assert_array_equal(drives.sample(ns(20.0), PERIOD, False).torque, 0.0)
    assert not drives.released


def test_a_step_without_a_clock_holds_the_torque_for_its_interval():
    drives = driven()
    drives.step(A, 1e-3)
    assert drives.released
    np.testing.assert_array_equal(
        [drives.plant.q, drives.plant.qd],
        advanced(START.initial_position, START.initial_velocity, (A, 1.0)))
