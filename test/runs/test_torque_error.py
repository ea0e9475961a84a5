# SPDX-License-Identifier: Apache-2.0
"""Facts about the error of the torque that an estimate predicts along the reference."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.inverse_dynamics import inverse_dynamics
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.control.reference import SumOfSinusoids
from adaptive_blf_control.runs.torque_error import (
    errors_of_trace,
    PredictedTorque,
    torque_error_of_trace,
    torque_line,
)

ARM = TwoLinkArm()
REFERENCE = SumOfSinusoids(np.array([0.1, 0.4]), np.array([[0.5], [0.3]]),
                           np.array([[1.0], [2.0]]), np.array([[0.0], [0.3]]))


def test_the_torque_is_that_of_the_inverse_dynamics_along_the_reference():
    dynamics, squares = ARM.dynamics(ARM.nominal), []
    for t in np.linspace(0.0, 10.0, 201):
        y, yd, ydd = REFERENCE.at(float(t))
        columns = [dynamics.acceleration(y, yd, unit) for unit in np.eye(2)]
        drift = dynamics.acceleration(y, yd, np.zeros(2))
        inverse = np.column_stack(columns) - drift[:, None]  # M⁻¹
        squares.append(np.linalg.solve(inverse, ydd - drift) ** 2)
    np.testing.assert_allclose(PredictedTorque(ARM, REFERENCE, 10.0).rms(ARM.nominal),
                               np.sqrt(np.mean(squares, axis=0)), rtol=1e-9)


def test_an_estimate_that_is_three_percent_large_errs_by_three_percent():
    measure = PredictedTorque(ARM, REFERENCE, 10.0)
    estimates = np.outer([1.0, 1.03, 0.5], ARM.nominal)
    np.testing.assert_allclose(measure.error(estimates, ARM.nominal),
                               [[0.0, 0.0], [0.03, 0.03], [0.5, 0.5]], atol=1e-12)


def test_a_joint_that_needs_no_torque_has_no_ratio():
    still = SumOfSinusoids(np.zeros(2), np.zeros((2, 1)), np.ones((2, 1)), np.zeros((2, 1)))
    assert np.isnan(PredictedTorque(ARM, still, 1.0).error(ARM.nominal, ARM.nominal)).all()
    assert torque_line([None, 0.0123]) == 'predicted torque     off by –, 1.2 % RMS'


def test_against_a_plant_what_no_parameter_expresses_counts_too():
    """A torque of 1 N·m on joint 1 that θ* does not have, where Y θ* has an RMS of s: 1/s."""
    measure = PredictedTorque(ARM, REFERENCE, 10.0)

    def torque(y, yd, ydd):
        return inverse_dynamics(ARM, ARM.nominal, y, yd, ydd)

    def pushed(y, yd, ydd):
        return torque(y, yd, ydd) + [1.0, 0.0]

    np.testing.assert_allclose(measure.error_against(ARM.nominal, torque), 0.0, atol=1e-12)
    np.testing.assert_allclose(measure.error_against(1.03 * ARM.nominal, torque), 0.03, atol=1e-9)
    scale = np.sqrt(np.mean([pushed(*motion)[0] ** 2 for motion in measure.motions]))
    np.testing.assert_allclose(measure.error_against(ARM.nominal, pushed), [1.0 / scale, 0.0],
                               atol=1e-12)


def test_what_no_parameters_express_is_nothing_of_a_model_and_most_of_a_constant_torque(
        ) -> None:
    measure = PredictedTorque(ARM, REFERENCE, 20.0)

    def torque(y, yd, ydd):
        return inverse_dynamics(ARM, 1.3 * ARM.nominal, y, yd, ydd)

    def pushed(y, yd, ydd):
        return torque(y, yd, ydd) + [1.0, 0.0]

    np.testing.assert_allclose(measure.least_against(torque)[0], 0.0, atol=1e-10)
    left, scale = measure.least_against(pushed)
    given, same = measure.rms_against(1.3 * ARM.nominal, pushed)
    np.testing.assert_array_equal(scale, same)
    assert 0.1 < np.linalg.norm(left) <= np.linalg.norm(given)


class Tells:
    """What of a plant `errors_of_trace` asks: its inverse dynamics, heavier from 0.05 s on."""

    def inverse_dynamics(self, q, qd, qdd, t=None):
        return inverse_dynamics(ARM, ARM.nominal * (2.0 if t > 0.05 else 1.0), q, qd, qdd)


def test_a_plant_that_tells_its_inverse_dynamics_is_asked_for_that_of_the_time(repository):
    loop = build_closed_loop(load_yaml(repository / 'config' / 'two_link.yaml'))
    trace = loop.run(0.1)
    trace.theta_hat[:] = ARM.nominal
    loop.plant = Tells()
    errors = errors_of_trace(loop, trace, np.array([0.02, 0.08]))
    np.testing.assert_allclose(errors, [[0.0, 0.0], [0.5, 0.5]], atol=1e-12)
    assert torque_error_of_trace(loop, trace) == pytest.approx([0.5, 0.5])


def test_each_estimate_is_held_against_the_true_arm_of_its_time(repository):
    data = load_yaml(repository / 'config' / 'two_link_payload_step.yaml')
    loop = build_closed_loop(data)
    trace = loop.run(0.1)
    object.__setattr__(trace, 't', np.linspace(0.0, 100.0, trace.t.size))
    truth = loop.plant.truth(loop.arm.parameters)
    trace.theta_hat[:] = truth[0][1]
    errors = errors_of_trace(loop, trace, np.array([0.0, 49.0, 51.0]))
    assert not errors[:2].any()
    assert errors[2].min() > 0.01
    assert torque_error_of_trace(loop, trace) == pytest.approx(errors[2].tolist())
