# SPDX-License-Identifier: Apache-2.0
"""Whole scenarios on the arm in MuJoCo, beside the same on the built-in one."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.configuration.parameter_file import apply_changes, load_yaml
from adaptive_blf_control.runs.bag_run import run_of_bag
from adaptive_blf_control.runs.simulation import simulate
from adaptive_blf_control.simulation.mujoco.plant import MujocoPlant
from adaptive_blf_control.simulation.plant import SimulatedArm
from adaptive_blf_control.simulation.settings import PlantSettings
from adaptive_blf_control.tools.simulate import main

JOINTS = ['shoulder', 'elbow']
SWING = {'amplitude': [0.3, 0.2], 'frequency': [1.5, 4.0], 'phase': [0.0, 0.0]}


@pytest.fixture
def scenario(pair_urdf):
    """Return a scenario of two links from a URDF."""
    return apply_changes({}, {
        'joints': JOINTS, 'arm': 'urdf', 'urdf': pair_urdf,
        'arm_driver': {'torque_limit': [60.0], 'true_friction': {'viscous': [2.0]}},
        'controller': {'k1': [1000.0], 'k2': [20.0, 5.0],
                       'safety': {'lower': [-2.0], 'upper': [2.0]},
                       'performance': {'lower': [-0.3], 'upper': [0.3]},
                       'reference': dict.fromkeys(JOINTS, SWING)}})


@pytest.mark.parametrize('dead_time', [0, 2])
def test_two_plants_that_share_no_dynamics_move_alike(scenario, dead_time):
    scenario = apply_changes(scenario, {'arm_driver.dead_time': dead_time})
    ours = simulate(scenario, 2.0, arm_driver={'substeps': 4})  # as MuJoCo: 0.25 ms
    theirs = simulate(scenario, 2.0, arm_driver={'plant': 'mujoco',
                                                 'mujoco': {'integrator': 'rk4'}})
    assert ours.kept
    np.testing.assert_allclose(theirs.q, ours.q, atol=1e-9)
    np.testing.assert_allclose(theirs.theta_hat, ours.theta_hat, atol=1e-6)


def test_two_plants_agree_on_dry_friction_while_the_joints_move(pair_urdf):
    """Ours is tanh(q̇/v_s) in place of MuJoCo's sign(q̇): the same until a joint stops."""
    friction = {'coulomb': np.array([0.5, 0.2]), 'square_root': np.array([0.3, 0.1])}
    arm = UrdfArm(pair_urdf, JOINTS, friction_coulomb=True, friction_square_root=True,
                  coulomb_velocity=0.002, viscous=0.0, **friction)
    settings = PlantSettings(initial_velocity=[1.0, -1.5], substeps=4, true_friction=friction,
                             mujoco={'integrator': 'rk4'})
    ours, theirs = SimulatedArm(settings, arm), MujocoPlant(settings, arm)
    frictionless = SimulatedArm(settings, UrdfArm(pair_urdf, JOINTS, viscous=0.0))
    for k in range(100):
        for plant in (ours, theirs, frictionless):
            plant.apply(np.array([-16.0 + 2.0 * np.sin(0.03 * k), -4.0]))
            plant.advance(0.001)
        assert np.abs(ours.qd).min() > 0.05
    np.testing.assert_allclose(theirs.q, ours.q, atol=5e-5)  # √|q̇| is held over a step
    assert np.abs(frictionless.q - ours.q).max() > 3e-3


def test_two_plants_agree_on_what_disturbs_them(scenario):
    """Late and wrong actuators, a force, a payload for a while, a tilted base, rotors."""
    disturbed = apply_changes(scenario, {'arm_driver': {
        'actuator': {'delay': 0.0023, 'jitter': 0.001, 'gain_error': [0.05],
                     'torque_bias': [0.1]},
        'mounting': [0.4, 0.3, 0.0],
        'true_friction': {'viscous': [2.0], 'rotor_inertia': [0.1, 0.05], 'offset': [0.2, -0.1]},
        'schedule': {'time': [0.3, 0.5, 0.8, 1.1],
                     'parameter': ['force.lower.z', 'payload', 'payload', 'force.lower.z'],
                     'value': [6.0, 0.5, 0.0, 0.0]}},
        'controller': {'performance': {'lower': [-1.0], 'upper': [1.0]}, 'k1': [10.0]}})
    ours = simulate(disturbed, 1.5, arm_driver={'substeps': 4})
    theirs = simulate(disturbed, 1.5, arm_driver={'plant': 'mujoco',
                                                  'mujoco': {'integrator': 'rk4'}})
    assert np.ptp(ours.q, axis=0).min() > 0.1
    np.testing.assert_allclose(theirs.q, ours.q, atol=1e-6)
    np.testing.assert_allclose(theirs.torque, ours.torque, atol=1e-3)


def test_learning_is_judged_by_the_torque_that_mujoco_needs(scenario):
    run = simulate(scenario, 4.0, arm_driver={'plant': 'mujoco'},
                   identifier={'kh': 1000.0, 'filter': {'time_constant': 0.02}})
    assert max(run.figures['predicted_torque_error']) < 0.01
    assert run.figures['guarantee'] is not None
    assert 'predicted torque     off by' in repr(run)
    assert run.figures['unexpressed_torque'] is None


def test_what_no_parameter_expresses_is_said_in_the_summary(scenario):
    run = simulate(scenario, 0.2, arm_driver={
        'plant': 'mujoco', 'true_friction': {'rotor_inertia': [0.0, 0.2], 'coulomb': [1.0]}})
    assert run.figures['guarantee'] is None
    shoulder, elbow = run.figures['unexpressed_torque']
    assert 0.0 < shoulder < elbow < 1.0
    assert f'{100.0 * elbow:.2g} % of the torque of random motions' in repr(run)
    assert 'is not about this plant: no theta expresses all of its torque' in repr(run)


def test_a_contact_is_reported_and_the_sets_may_be_left_while_it_lasts(scenario):
    run = simulate(scenario, 1.5, arm_driver={
        'plant': 'mujoco', 'schedule': {'time': [0.5, 0.8], 'parameter': ['contact', 'contact'],
                                        'value': [1.0, 0.0]}})
    (begin, _), *_ = run.figures['contacts_s']
    end = run.figures['contacts_s'][-1][1]
    assert 0.5 < begin < end < 0.81
    assert f'contact              from {begin:.3f} s to' in repr(run)
    free = simulate(scenario, 0.2)
    assert free.figures['contacts_s'] == []


def test_a_bag_of_it_has_its_truth(scenario, tmp_path):
    path = tmp_path / 'scenario.yaml'
    path.write_text(yaml.safe_dump(apply_changes(scenario, {'arm_driver': {
        'plant': 'mujoco', 'schedule': {'time': [0.1], 'parameter': ['payload'],
                                        'value': [1.0]}}})))
    assert main([str(path), '--duration', '0.2', '--bag', str(tmp_path / 'bag')]) == 0
    truth = run_of_bag(read_bag(tmp_path / 'bag')).truth
    assert [t for t, _ in truth] == [0.0, 0.1]
    assert not np.allclose(truth[0][1], truth[1][1])


def test_bad_input_ends_simulate_with_the_reason(repository, capsys):
    panda = str(repository / 'config' / 'panda.yaml')
    assert main([panda, '--set', 'arm_driver.plant=mujoco',
                 '--set', 'arm_driver.schedule.parameter=[payload.gripper]']) == 2
    assert "'payload.gripper': expected payload" in capsys.readouterr().err


def test_the_shipped_scenario_names_what_its_model_has(repository):
    data = load_yaml(repository / 'config' / 'panda_mujoco.yaml')
    run = simulate(data, 0.05)
    assert run.kept
    assert type(run.loop.plant).__name__ == 'MujocoPlant'
