# SPDX-License-Identifier: Apache-2.0
"""Two independent computations of the torque of a motion agree: MuJoCo's and our regressors'."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_model import load_pinocchio
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.mujoco.plant import MujocoPlant
from adaptive_blf_control.simulation.settings import PlantSettings

ARMS = {
    'panda': ('panda_description/urdf/panda.urdf', [f'panda_joint{i}' for i in range(1, 8)]),
    'ur10': ('ur_description/urdf/ur10_robot.urdf', None),
    'ur5': ('ur_description/urdf/ur5_robot.urdf', None),
    'j2s6s200': ('kinova_description/robots/kinova.urdf', None),  # with continuous joints
    'xarm7': ('xarm_description/urdf/xarm7.urdf', None),
    'z1': ('z1_description/urdf/z1.urdf', [f'joint{i}' for i in range(1, 7)]),
}


@pytest.mark.parametrize('name', ARMS)
def test_mujoco_and_our_regressors_give_the_same_torque(name, states):
    urdf, joints = ARMS[name]
    # Two of them have dry friction: MuJoCo's is f sign(q̇).
    arm = UrdfArm(f'package://{urdf}', joints, friction_coulomb=True, coulomb_velocity=1e-6)
    plant = MujocoPlant(PlantSettings(), arm)
    for q, qd, qdd in states(arm.n):
        np.testing.assert_allclose(plant.inverse_dynamics(q, qd, qdd),
                                   arm.Y(q, qd, qdd) @ arm.nominal, rtol=0.0, atol=1e-10)


def test_joints_in_another_order_are_those_of_the_user(states):
    joints = list(reversed(ARMS['panda'][1]))
    arm = UrdfArm('package://panda_description/urdf/panda.urdf', joints)
    plant = MujocoPlant(PlantSettings(initial_position=np.arange(7.0)), arm)
    assert plant.q.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    q, qd, qdd = states(7)[0]
    np.testing.assert_allclose(plant.inverse_dynamics(q, qd, qdd),
                               arm.Y(q, qd, qdd) @ arm.nominal, atol=1e-10)


def test_friction_and_rotors_add_what_they_are_defined_to(panda, panda_settings, states):
    friction = {'viscous': np.arange(1.0, 8.0), 'coulomb': [0.5], 'offset': [0.1],
                'square_root': [0.3], 'rotor_inertia': [0.2]}
    plain = MujocoPlant(panda_settings.replace(true_friction={'viscous': [1e-300]}), panda)
    full = MujocoPlant(panda_settings.replace(true_friction=friction), panda)
    for q, qd, qdd in states(7):
        dry = (0.5 + 0.3 * np.sqrt(np.abs(qd))) * np.sign(qd)
        expected = np.arange(1.0, 8.0) * qd + dry + 0.1 + 0.2 * qdd
        np.testing.assert_allclose(full.inverse_dynamics(q, qd, qdd)
                                   - plain.inverse_dynamics(q, qd, qdd), expected, atol=1e-10)


def test_a_payload_at_the_tip_is_that_of_the_simulated_arm(panda, panda_settings, states):
    plant = MujocoPlant(panda_settings.replace(payload=2.5), panda)
    theta = panda.nominal + 2.5 * panda.payload_direction
    for q, qd, qdd in states(7):
        np.testing.assert_allclose(plant.inverse_dynamics(q, qd, qdd),
                                   panda.Y(q, qd, qdd) @ theta, atol=1e-10)


def test_a_payload_on_a_link_has_its_mass_centre_and_inertia(panda, panda_settings, states):
    names = ['', '.x', '.y', '.z', '.ixx', '.iyy', '.izz', '.ixy', '.iyz']
    values = [1.5, 0.05, -0.02, 0.1, 0.02, 0.03, 0.025, 0.004, -0.003]
    plant = MujocoPlant(panda_settings.replace(schedule={
        'time': [0.0] * 9, 'parameter': [f'payload.panda_link4{name}' for name in names],
        'value': values}), panda)
    pin = load_pinocchio()
    inertia = np.array([[0.02, 0.004, 0.0], [0.004, 0.03, -0.003], [0.0, -0.003, 0.025]])
    load = pin.Inertia(1.5, np.array([0.05, -0.02, 0.1]), inertia)
    carried = np.zeros((7, 10))
    carried[3] = load.toDynamicParameters()  # the frame of the link is that of its joint
    theta = panda.nominal.copy()
    theta[:panda.base_count] += panda.base_from_inertial(carried)
    for q, qd, qdd in states(7):
        np.testing.assert_allclose(plant.inverse_dynamics(q, qd, qdd),
                                   panda.Y(q, qd, qdd) @ theta, atol=1e-10)


def test_an_inertia_that_no_body_has_is_refused(panda, panda_settings):
    schedule = {'time': [1.0, 1.0], 'value': [1.0, 0.1],
                'parameter': ['payload.panda_hand', 'payload.panda_hand.ixy']}
    with pytest.raises(ParameterError, match='payload on panda_hand with no negative moment'):
        MujocoPlant(panda_settings.replace(schedule=schedule), panda)


def test_a_tilted_base_turns_gravity(panda, panda_settings):
    tilt = np.radians(30.0)
    plant = MujocoPlant(panda_settings.replace(mounting=[tilt, 0.0, 0.0]), panda)
    # The base rolls by 30° about x, so that gravity comes from its +y: R(tilt)ᵀ g.
    arm = UrdfArm('package://panda_description/urdf/panda.urdf', list(panda.joints),
                  gravity=[0.0, -9.81 * np.sin(tilt), -9.81 * np.cos(tilt)])
    q, still = np.full(7, 0.4), np.zeros(7)
    np.testing.assert_allclose(plant.inverse_dynamics(q, still, still),
                               arm.Y(q, still, still) @ arm.nominal, atol=1e-10)
