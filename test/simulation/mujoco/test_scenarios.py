# SPDX-License-Identifier: Apache-2.0
"""Whole scenarios on the arm in MuJoCo, beside the same on the built-in one."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.configuration.parameter_file import apply_changes, load_yaml
from adaptive_blf_control.runs.bag_run import run_of_bag
from adaptive_blf_control.runs.simulation import simulate
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


def test_two_plants_that_share_no_dynamics_move_alike(scenario):
    ours = simulate(scenario, 2.0, arm_driver={'substeps': 4})  # as MuJoCo: 0.25 ms
    theirs = simulate(scenario, 2.0, arm_driver={'plant': 'mujoco',
                                                 'mujoco': {'integrator': 'rk4'}})
    assert ours.kept
    np.testing.assert_allclose(theirs.q, ours.q, atol=1e-9)
    np.testing.assert_allclose(theirs.theta_hat, ours.theta_hat, atol=1e-6)


def test_two_plants_agree_on_what_disturbs_them(scenario):
    """Late and wrong actuators, a force, a payload that comes and goes, a tilted base."""
    disturbed = apply_changes(scenario, {'arm_driver': {
        'actuator': {'delay': 0.0023, 'jitter': 0.001, 'gain_error': [0.05],
                     'torque_bias': [0.1]},
        'mounting': [0.4, 0.3, 0.0],
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


def test_what_no_parameter_expresses_is_said_in_the_summary(scenario):
    run = simulate(scenario, 0.2, arm_driver={
        'plant': 'mujoco', 'true_friction': {'rotor_inertia': [0.0, 0.2], 'coulomb': [1.0]}})
    assert run.figures['guarantee'] is None
    assert 'is not about this plant: no theta expresses' in repr(run)


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
