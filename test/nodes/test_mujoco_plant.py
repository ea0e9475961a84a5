# SPDX-License-Identifier: Apache-2.0
"""An arm in MuJoCo behind the real driver: in real time, and in lockstep equal to `simulate`."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from adaptive_blf_control.messages.joint_state import decode_joint_state
from adaptive_blf_control.messages.topics import JOINT_STATES, THETA_HAT, TRACKING_ERROR
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.runs.simulation import simulate

pytest.importorskip('mujoco', reason='MuJoCo is not installed: the extra mujoco')

JOINTS = ['shoulder', 'elbow']
SWING = {f'reference.{joint}.{name}': [value] for joint in JOINTS
         for name, value in (('amplitude', 0.3), ('frequency', 1.5), ('phase', 0.0))}
DRIVER = {'plant': 'mujoco', 'actuator.delay': 0.002, 'torque_limit': [100.0],
          'true_friction.viscous': [2.0],
          'schedule.time': [0.5], 'schedule.parameter': ['payload.lower'],
          'schedule.value': [0.5]}
CONTROLLER = {'k1': [1000.0], 'k2': [20.0, 5.0], 'performance.lower': [-0.6],
              'performance.upper': [0.6], 'torque_limit': [100.0], **SWING}


@pytest.fixture
def arm(pair_urdf, tmp_path):
    """Return the parameters of an arm whose URDF is a file."""
    path = tmp_path / 'pair.urdf'
    path.write_text(pair_urdf, encoding='utf-8')
    return {'arm': 'urdf', 'urdf': str(path), 'joints': JOINTS}


@pytest.fixture
def nodes(graph, arm):
    """Return ``nodes(**changes)``: driver, controller and identifier of an arm in MuJoCo."""
    def make(**changes):
        def given(values):
            return {name.replace('.', '__'): value for name, value in {**arm, **values}.items()}
        driver = graph.make(ArmDriver, **given({**DRIVER, 'duration': 1.0, **changes}))
        clock = {'use_sim_time': changes.get('use_sim_time', False)}
        controller = graph.make(ControllerNode, **given(
            {**CONTROLLER, 'state_timeout': 60.0, **clock}))
        return driver, controller, graph.make(IdentifierNode, **given(clock))
    return make


def _heard(messages) -> np.ndarray:
    return np.array([decode_joint_state(data).position for data, _ in messages])


def test_the_nodes_drive_it_in_real_time(graph, nodes, wait_until):
    driver, controller, identifier = nodes(rate=100.0)  # which a busy machine keeps, too
    peer = graph.peer()
    errors = peer.listen(JointState, f'/{TRACKING_ERROR}')
    estimates = peer.listen(JointState, f'/{THETA_HAT}')
    for node in (identifier, controller):
        graph.run(node)
    assert graph.run(driver).join() == 0  # its duration is over
    wait_until(lambda: errors and estimates and np.any(_heard(estimates)[-1]),
               what='errors, and an estimate that has moved')
    assert np.isfinite(_heard(errors)).all()
    assert driver.plant.t > 0.9
    assert driver.plant.arm_model.model.body('load on lower').mass[0] == 0.5


def test_in_lockstep_it_is_the_arm_of_simulate_bit_by_bit(graph, arm, nodes):
    driver, controller, identifier = nodes(use_sim_time=True)
    states = graph.peer().listen(JointState, f'/{JOINT_STATES}')
    for node in (identifier, controller):
        graph.run(node)
    assert graph.run(driver).join() == 0
    run = simulate({'/**': {'ros__parameters': arm},
                    '/**/arm_driver': {'ros__parameters': DRIVER},
                    '/**/controller': {'ros__parameters': CONTROLLER}}, 1.0)
    heard = _heard(states)
    assert heard.shape == run.q.shape
    assert np.array_equal(heard, run.q)
