# SPDX-License-Identifier: Apache-2.0
"""Facts about the built-in arm behind actuators: when commands act, what a force does."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.actuated_arm import ActuatedArm, arm_alone, is_actuated
from adaptive_blf_control.simulation.plant import SimulatedArm
from adaptive_blf_control.simulation.settings import PlantSettings


@pytest.fixture
def arm(pair_urdf):
    """Return two links of 0.4 m that lie along x and turn about y; the tip is the second joint."""
    return UrdfArm(pair_urdf, ['shoulder', 'elbow'], viscous=0.0)


@pytest.fixture
def made(arm):
    """Return ``made(*changes, **settings)``: the arm with a schedule of (t, name, value)."""
    def make(*changes, **settings):
        if changes:
            times, names, values = map(list, zip(*changes))
            settings['schedule'] = {'time': times, 'parameter': names, 'value': values}
        return ActuatedArm(PlantSettings(**settings), arm)
    return make


def gravity_of(arm, q=(0.0, 0.0)):
    still = np.zeros(2)
    return arm.Y(np.array(q), still, still) @ arm.nominal


@pytest.mark.parametrize('dead_time', [0, 1, 3])
def test_without_anything_it_is_the_simulated_arm_bit_by_bit(arm, made, dead_time):
    settings = {'initial_velocity': [1.0, -0.5], 'dead_time': dead_time}
    plain, actuated = SimulatedArm(PlantSettings(**settings), arm), made(**settings)
    for k in range(50):
        torque = np.array([0.1 * k, -0.2])
        for plant in (plain, actuated):
            plant.measure(torque, 0.0)
            plant.apply(torque)
            plant.advance(0.001)
    assert np.array_equal(plain.q, actuated.q)
    assert np.array_equal(plain.qd, actuated.qd)


def test_a_command_acts_after_the_delay_to_the_microsecond(made):
    plant = made(actuator={'delay': 0.00137})
    plant.apply(np.array([3.0, 0.0]))
    plant.advance(0.001)
    assert not plant.torque.any()
    plant.advance(0.001)
    assert plant.torque.tolist() == [3.0, 0.0]
    np.testing.assert_allclose(plant.measure(np.zeros(2), 0.002).torque,
                               [3.0 * 0.63 / 2.0, 0.0], rtol=1e-9)
    assert plant.t == pytest.approx(0.002)


def test_a_gain_error_moves_the_arm_and_is_not_measured(arm, made):
    holding = gravity_of(arm)
    plant = made(actuator={'gain_error': [0.25]})
    plant.apply(holding / 1.25)
    plant.advance(0.2)
    np.testing.assert_allclose(plant.q, 0.0, atol=1e-9)
    np.testing.assert_allclose(plant.measure(np.zeros(2), 0.2).torque, holding / 1.25)


def test_a_force_on_a_link_is_balanced_by_its_jacobian(arm, made):
    """10 N upwards at the lower link's origin, 0.8 m from the base: 4 N·m at the shoulder."""
    plant = made((0.0, 'force.lower.z', 10.0), (0.0, 'torque.lower.y', 2.0),
                 (0.3, 'force.lower.z', 0.0))
    plant.apply(gravity_of(arm) + [10.0 * 0.4 - 2.0, -2.0])  # about +y, up is negative
    plant.advance(0.29)
    np.testing.assert_allclose(plant.q, 0.0, atol=1e-9)
    plant.advance(0.1)
    assert np.abs(plant.q).max() > 1e-3


def test_the_true_arm_has_its_changes_beside_the_forces(arm, made):
    plant = made((0.1, 'force.lower.z', 1.0), (0.2, 'fv_elbow', 3.0))
    (_, before), (change, after) = plant.truth(arm.parameters)
    assert change == 0.2
    assert after[arm.parameters.index('fv_elbow')] == 3.0
    assert before[arm.parameters.index('fv_elbow')] == 0.0


def test_the_brakes_drop_what_is_under_way(made):
    plant = made(initial_velocity=[1.0, 1.0], actuator={'delay': 0.01})
    plant.apply(np.ones(2))
    plant.brake()
    plant.advance(0.02)
    assert not plant.torque.any()


def test_another_limit_and_another_schedule_are_taken(made):
    plant = made((0.0, 'force.lower.z', 10.0), actuator={'delay': 0.001})
    plant.advance(0.01)
    plant.apply(np.full(2, 0.2))
    plant.retune(PlantSettings(torque_limit=[0.5], actuator={'delay': 0.001}))
    plant.advance(0.002)
    assert plant.torque.tolist() == [0.2, 0.2]  # what was commanded is not forgotten
    plant.apply(np.ones(2))
    plant.advance(0.002)
    assert plant.torque.tolist() == [0.5, 0.5]
    assert plant.t == pytest.approx(0.014)


def test_it_is_built_where_something_asks_for_it():
    assert not is_actuated(PlantSettings())
    assert is_actuated(PlantSettings(actuator={'jitter': 0.001}))
    pushed = PlantSettings(schedule={'time': [1.0], 'parameter': ['torque.lower.x'],
                                     'value': [1.0]})
    assert is_actuated(pushed)
    assert not is_actuated(arm_alone(pushed))


@pytest.mark.parametrize(('change', 'message'), [
    ((1.0, 'force.hand.z', 1.0), "'force.hand.z'.*with a link of upper, lower"),
    ((1.0, 'force.lower', 1.0), r'force.LINK.x\|y\|z'),
    ((1.0, 'contact', 1.0), 'one of .*fv_elbow')])
def test_a_push_that_cannot_be_is_refused_by_name(made, change, message):
    with pytest.raises(ParameterError, match=message):
        made(change)


def test_an_arm_without_links_cannot_be_pushed():
    with pytest.raises(ParameterError, match='an arm from a URDF: this one has none'):
        ActuatedArm(PlantSettings(schedule={
            'time': [0.0], 'parameter': ['force.hand.z'], 'value': [1.0]}), TwoLinkArm())
