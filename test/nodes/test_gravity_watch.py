# SPDX-License-Identifier: Apache-2.0
"""A controller says that gravity as told does not fit, and stops where it is told to."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.messages.topics import COMMANDS
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.simulation.rotation import rotation

PANDA = 'package://panda_description/urdf/panda.urdf'
JOINTS = [f'panda_joint{i}' for i in range(1, 8)]
POSTURE = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.9, 0.5])


def _weight(degrees: float) -> list[float]:
    """Return what holds the arm at rest on a base that is tilted."""
    gravity = rotation(np.radians([degrees, 0.0, 0.0])).T @ [0.0, 0.0, -9.81]
    arm, rest = load_arm(PANDA, JOINTS, gravity=gravity), np.zeros(7)
    return [float(each) for each in arm.X(POSTURE, rest, rest, rest) @ arm.nominal]


@pytest.fixture
def held(graph, wait_until):
    """Return a function that lets a controller see an arm at rest for 0.3 s."""
    pytest.importorskip('pinocchio')

    def hold(degrees: float, on_violation: str) -> ControllerNode:
        node = graph.make(
            ControllerNode, arm='urdf', urdf=PANDA, joints=JOINTS, initial_estimate='nominal',
            k1=[10.0], k2=[0.1], torque_limit=[80.0], on_violation=on_violation, ramp_time=0.0,
            safety__lower=[-3.0], safety__upper=[3.0], performance__lower=[-0.2],
            performance__upper=[0.2], barrier_weight=[0.01], **{
                f'reference__{joint}__offset': float(at) for joint, at in zip(JOINTS, POSTURE)})
        graph.peer().listen(Float64MultiArray, COMMANDS)
        wait_until(node.commands.someone_drives, what='the match')
        effort = _weight(degrees)

        def sees(ms: int) -> None:
            message = JointState(name=JOINTS, position=POSTURE.tolist(), velocity=[0.0] * 7,
                                 effort=effort)
            message.header.stamp.sec, message.header.stamp.nanosec = 1000, ms * 10**6
            node.on_joint_states(serialize_message(message), {})

        def begun() -> bool:
            sees(1)
            return node.output is not None

        wait_until(begun, what='the first answer')
        for ms in range(2, 300):
            sees(ms)
        return node

    return hold


def test_a_tilted_base_is_an_error_with_its_angle_and_the_motion_goes_on(held) -> None:
    node = held(30.0, 'continue')
    level, text, _ = node.status()
    assert level == DiagnosticStatus.ERROR
    assert 'gravity as told does not fit' in text
    assert 'tilted by about ' in text
    assert text in node.faults.last
    assert node.active


def test_with_on_violation_stop_the_controller_stops_by_itself(held) -> None:
    node = held(30.0, 'stop')
    assert (node.active, node.commands.claimed, node.wants_activation) == (False, False, False)
    assert node.statistics.samples < 200
    assert 'gravity as told does not fit' in node.faults.last


def test_of_an_upright_base_nothing_is_said(held) -> None:
    node = held(0.0, 'stop')
    assert node.active
    assert node.gravity.found == ''
    assert 'gravity' not in node.status()[1]
