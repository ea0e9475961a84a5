# SPDX-License-Identifier: Apache-2.0
"""Facts about actuators: limits, delay in seconds, jitter, a gain that is wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adaptive_blf_control.simulation.actuators import Actuators
from adaptive_blf_control.simulation.settings import PlantSettings

LIMIT = [5.0, 1.0]


def actuators(dead_time: int = 0, **settings) -> Actuators:
    return Actuators(PlantSettings(actuator=settings, dead_time=dead_time,
                                   torque_limit=LIMIT).resolved(joints=2))


def test_without_delay_a_command_acts_at_once_within_the_limit():
    subject = actuators()
    subject.command(0.3, np.array([9.0, -9.0]))
    assert subject.torque.tolist() == [5.0, -1.0]
    assert subject.next_switch == math.inf


def test_commands_act_one_delay_later_in_their_order():
    subject = actuators(delay=0.004)
    for k in range(3):
        subject.command(k * 0.001, np.full(2, 0.1 * (k + 1)))
    assert subject.next_switch == 0.004
    assert not subject.torque.any()
    subject.advance_to(0.005)
    assert subject.torque.tolist() == [0.2, 0.2]
    assert subject.next_switch == 0.006


def test_any_number_of_commands_can_be_under_way_in_their_order():
    subject, acting = actuators(delay=0.5), []
    for k in range(100):
        subject.command(0.01 * k, np.full(2, 0.01 * k))
        subject.advance_to(0.01 * k)
        acting.append(subject.torque[0])
    np.testing.assert_allclose(acting, np.maximum(0.01 * (np.arange(100) - 50), 0.0), atol=0.011)
    subject.advance_to(2.0)
    assert subject.torque.tolist() == [0.99, 0.99]
    assert subject.next_switch == math.inf


def test_jitter_spreads_the_delay_and_keeps_the_order():
    subject, late = actuators(delay=0.001, jitter=0.002), []
    for k in range(200):
        subject.command(0.01 * k, np.array([0.01 * k, 0.0]))
        late.append(subject.next_switch - 0.01 * k)
        subject.advance_to(0.01 * k + 0.0035)
        assert subject.torque[0] == 0.01 * k or subject.torque[0] == 5.0
    assert 0.001 <= min(late) < 0.0015
    assert 0.0025 < max(late) <= 0.003
    crowded = actuators(jitter=1.0)
    for k in range(50):
        crowded.command(0.001 * k, np.array([0.1 * k, 0.0]))
    acting = []
    while crowded.next_switch < math.inf:
        crowded.advance_to(crowded.next_switch)
        acting.append(crowded.torque[0])
    assert acting == sorted(acting)
    assert acting[-1] == pytest.approx(4.9)


def test_a_gain_error_is_in_the_torque_that_acts_and_not_in_what_is_measured():
    subject = actuators(gain_error=[0.03, -0.1], torque_bias=[0.5, 0.0])
    subject.command(0.0, np.array([1.0, 1.0]))
    np.testing.assert_allclose(subject.torque, [1.03, 0.9])
    subject.act(0.001)
    np.testing.assert_allclose(subject.sample(0.0), [1.5, 1.0])


def test_the_measured_torque_is_the_mean_since_the_last_sample_or_that_of_now():
    for effort, expected in (('mean', 1.75), ('instant', 2.0)):
        subject = actuators(effort=effort)
        subject.command(0.0, np.ones(2))
        subject.act(0.001)
        subject.command(0.001, np.full(2, 2.0))
        subject.act(0.003)
        np.testing.assert_allclose(subject.sample(0.0), [expected, 1.0])
        subject.act(0.001)
        np.testing.assert_allclose(subject.sample(0.0), [2.0, 1.0])


def test_a_stop_drops_what_is_under_way():
    subject = actuators(delay=0.01)
    subject.command(0.0, np.ones(2))
    subject.advance_to(0.02)
    subject.command(0.02, np.ones(2))
    subject.stop()
    assert not subject.torque.any()
    assert subject.next_switch == math.inf


def test_a_dead_time_counts_samples_and_a_delay_comes_on_top():
    subject, acting = actuators(dead_time=2, delay=0.0005), []
    for k in range(6):
        subject.sample(0.001 * k)
        subject.command(0.001 * k + 1e-4, np.array([0.1 * (k + 1), 0.0]))
        subject.advance_to(0.001 * k + 0.0004)
        acting.append(round(subject.torque[0], 9))
        subject.advance_to(0.001 * k + 0.0006)
        acting.append(round(subject.torque[0], 9))
    # The command after sample 0 acts from half a millisecond after sample 2 on.
    assert acting == [0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.4]


def test_another_dead_time_keeps_what_was_commanded_last_under_way():
    subject = actuators()
    subject.command(0.0, np.array([2.0, 0.5]))
    subject.retune(PlantSettings(dead_time=2, torque_limit=[0.4]).resolved(joints=2))
    subject.command(0.0, np.array([3.0, 0.0]))
    assert subject.torque.tolist() == [2.0, 0.5]
    subject.sample(0.001)
    assert subject.torque.tolist() == [2.0, 0.5]
    subject.sample(0.002)
    assert subject.torque.tolist() == [0.4, 0.0]
