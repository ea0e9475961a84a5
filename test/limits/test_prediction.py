# SPDX-License-Identifier: Apache-2.0
"""Facts about the delay of the loop: the filter decides for the state that its torque meets."""

from __future__ import annotations

import numpy as np
import pytest

import adaptive_blf_control as blf
from adaptive_blf_control.control.safety_filter import FilterSample
from adaptive_blf_control.limits.prediction import Prediction

H = 1e-3
TORQUE = np.array([60.0, 15.0])
ARM = blf.TwoLinkArm()


def filter_with(delay):
    return blf.Controller(
        ARM, safety_filter='limits', torque_limit=TORQUE, loop={'delay': delay},
        limits={'velocity': [1.5, 2.0], 'prior': {'mass_error': 0.02, 'unexplained': 1e-6}},
        safety={'lower': -1.0, 'upper': 1.0}, performance={'lower': -0.1, 'upper': 0.1},
    ).safety_filter


@pytest.mark.parametrize('delay', [0.0005, 0.001, 0.0035])
def test_the_model_is_followed_under_the_torques_that_still_act(delay):
    random, truth = np.random.default_rng(0), ARM.dynamics(ARM.nominal)
    parts, ahead = filter_with(0.0)._parts, Prediction(2, delay)  # the model that it is made with
    given = [random.uniform(-1.0, 1.0, 2) * TORQUE for _ in range(8)]
    for k, torque in enumerate(given):
        ahead.commanded(k * H, torque)
    q, qd = np.array([0.3, -0.2]), np.array([0.5, -0.8])
    found = ahead.state(parts, 8 * H, q, qd)
    fine = 200
    for i in range(fine):  # what acts at 8 h + s was commanded at 8 h + s - d or before
        place = (8 * H + (i + 0.5) / fine * delay - delay) / H
        q, qd = truth.advance(q, qd, given[min(int(place), 7)], delay / fine)
    np.testing.assert_allclose(found[0], q, atol=8.0 * delay ** 2)
    np.testing.assert_allclose(found[1], qd, atol=0.05 * delay * 60.0)


def test_before_the_first_command_the_joints_go_on_as_they_are():
    ahead = Prediction(2, 0.002)
    q, qd = ahead.state(filter_with(0.0)._parts, 0.0, np.array([0.3, 0.1]), np.array([1.0, 0.0]))
    np.testing.assert_allclose(q, [0.302, 0.1])
    np.testing.assert_allclose(qd, [1.0, 0.0])


def test_without_delay_the_state_is_the_measured_one():
    q, qd = np.zeros(2), np.ones(2)
    found = Prediction(2, 0.0).state(None, 0.0, q, qd)
    assert found[0] is q
    assert found[1] is qd


def fastest(stated, late=3):
    """Return the largest velocity, in units of its limit, where torques act 3 samples late."""
    filter_, truth = filter_with(stated), ARM.dynamics(ARM.nominal)
    q, qd, waiting, most = np.zeros(2), np.zeros(2), [np.zeros(2)] * late, 0.0
    for k in range(800):
        asked = TORQUE * (1.0 if k // 200 % 2 == 0 else -1.0)
        waiting.append(filter_.filtered(FilterSample(k * H, q, qd, asked, -TORQUE, TORQUE)))
        q, qd = truth.advance(q, qd, waiting.pop(0), H)
        most = max(most, (np.abs(qd) / filter_.limits.speed).max())
    return most


def test_a_velocity_limit_is_kept_through_a_delay_that_is_stated():
    assert fastest(0.003) < 1.02
    assert fastest(0.0) > 1.1
