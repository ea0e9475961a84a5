# SPDX-License-Identifier: Apache-2.0
"""A stranger's plant, sensor, laws and constraint, named in parameters, through real nodes."""

from __future__ import annotations

from pathlib import Path

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.control.laws.protocol import own_estimate
from adaptive_blf_control.errors import SetViolation
from adaptive_blf_control.messages.joint_state import decode_joint_state
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    BARRIER,
    COMMANDS,
    JOINT_STATES,
    THETA_HAT,
    TRACKING_ERROR,
)
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode

ROOMS = Path(__file__).resolve().parents[1]
SWING = {f'reference__{joint}__{name}': [value] for joint in ('joint1', 'joint2')
         for name, value in (('amplitude', 0.2), ('frequency', 1.0), ('phase', 0.0))}


def test_the_nodes_drive_a_foreign_plant_and_learn_with_foreign_parts(graph, wait_until,
                                                                      monkeypatch):
    monkeypatch.syspath_prepend(str(ROOMS / 'simulation'))
    for room in ('control', 'identification'):
        monkeypatch.syspath_prepend(str(ROOMS / room))
    driver = graph.make(ArmDriver, rate=200.0, plant='foreign_plant:Pendulums')
    controller = graph.make(ControllerNode, law='foreign_law:Spring', performance__lower=[-0.6],
                            performance__upper=[0.6], state_timeout=60.0, **SWING)
    identifier = graph.make(IdentifierNode, update_law='foreign_update_law:LeastSquares',
                            filter__state_filter='foreign_parts:Smoothing',
                            history__selection='foreign_parts:LatestPairs',
                            change__monitor='foreign_parts:Alarm')
    peer = graph.peer()
    errors, terms = (peer.listen(JointState, f'/{topic}')
                     for topic in (TRACKING_ERROR, ADAPTATION_TERM))
    states, estimates = (peer.listen(JointState, f'/{topic}')
                         for topic in (JOINT_STATES, THETA_HAT))
    for node in (driver, controller, identifier):
        graph.run(node)

    def moved() -> bool:
        return bool(states) and np.abs(decode_joint_state(states[-1][0]).position).max() > 0.1

    wait_until(moved, what='a motion of the foreign plant')
    wait_until(lambda: estimates and np.any(decode_joint_state(estimates[-1][0]).position),
               what='an estimate of the foreign law')
    wait_until(lambda: identifier.identifier.changes, what='the alarm of the foreign monitor')
    assert type(driver.plant).__name__ == 'Pendulums'
    assert type(identifier.identifier.stack).__name__ == 'LatestPairs'
    assert identifier.status()[2]['changes of the arm'] == 1
    assert np.isfinite([decode_joint_state(data).position for data, _ in errors]).all()
    assert not np.any([decode_joint_state(data).position for data, _ in terms])


def test_a_foreign_sensor_measures_the_arm_of_the_driver(graph, wait_until, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOMS / 'simulation'))
    driver = graph.make(ArmDriver, rate=200.0, initial_position=[0.123, 2.0],
                        sensors__model='foreign_sensor:Coarse')
    controller = graph.make(ControllerNode, performance__lower=[-0.6], performance__upper=[0.6],
                            state_timeout=60.0, **SWING)
    states = graph.peer().listen(JointState, f'/{JOINT_STATES}')
    for node in (driver, controller):
        graph.run(node)

    def moved() -> bool:
        return len(np.unique([decode_joint_state(data).position[0] for data, _ in states])) > 5

    wait_until(moved, what='a motion that is seen')
    steps = np.array([decode_joint_state(data).position for data, _ in states]) / 0.01
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert steps[0, 0] == pytest.approx(12.0)


@pytest.fixture
def limited(graph, monkeypatch):
    """Return ``limited(**parameters)``: a controller with a stranger's limit of the velocity."""
    monkeypatch.syspath_prepend(str(ROOMS / 'control'))
    return lambda **parameters: graph.make(
        ControllerNode, constraints=['foreign_constraints:VelocityLimit'], state_timeout=60.0,
        monitor_decimation=1, **parameters)


def _state(ms: int, qd) -> bytes:
    message = JointState(name=['joint1', 'joint2'], position=[0.0, 0.0], velocity=qd)
    message.header.stamp.sec, message.header.stamp.nanosec = 100, ms * 1_000_000
    return serialize_message(message)


def test_a_foreign_constraint_is_on_the_topic_and_in_the_diagnostics(graph, wait_until, limited):
    node, peer = limited(), graph.peer()
    margins, _ = peer.listen(JointState, f'/{BARRIER}'), peer.listen(Float64MultiArray,
                                                                     f'/{COMMANDS}')
    wait_until(lambda: node.count_subscribers(BARRIER))

    def begun() -> bool:
        node.on_joint_states(_state(0, [0.5, -1.0]), {})
        return node.output is not None

    wait_until(begun, what='the first answer')
    wait_until(lambda: margins, what='the margins')
    heard = decode_joint_state(margins[0][0])
    shown = dict(zip(heard.names, heard.position))
    assert shown['joint1.velocity_margin [rad/s]'] == 1.5
    assert shown['joint2.velocity_margin [rad/s]'] == 1.0
    assert node.status()[2]['joint2 velocity margin [rad/s]'] == '1'
    node.on_joint_states(_state(1, [0.5, -2.5]), {})
    level, text, values = node.status()
    assert level == DiagnosticStatus.ERROR
    assert text == ("joint 'joint2' has left its velocity set: -2.5 rad/s is not within "
                    '-2 .. 2 rad/s (margin -0.5 rad/s)')
    assert values['recovery'] == 'slow the reference down'
    assert node.monitors.violations == 1


def test_a_start_outside_a_foreign_constraint_is_refused(graph, wait_until, limited):
    node = limited()
    graph.peer().listen(Float64MultiArray, f'/{COMMANDS}')
    wait_until(lambda: node.count_subscribers(COMMANDS))
    with pytest.raises(SetViolation, match='start velocity outside the velocity set: 2.5 rad/s'):
        node.on_joint_states(_state(0, [2.5, 0.0]), {})
    assert node.output is None


@pytest.mark.parametrize('law', ['pd', 'slotine_li'])
def test_a_law_that_needs_no_estimate_drives_an_arm_without_an_identifier(graph, wait_until, law):
    driver = graph.make(ArmDriver, rate=200.0)
    controller = graph.make(ControllerNode, law=law, performance__lower=[-0.6],
                            performance__upper=[0.6], state_timeout=60.0, **SWING)
    peer = graph.peer()
    terms, states = (peer.listen(JointState, f'/{topic}')
                     for topic in (ADAPTATION_TERM, JOINT_STATES))
    assert controller.count_subscribers(THETA_HAT) == 0
    for node in (driver, controller):
        graph.run(node)
    wait_until(lambda: states and np.abs(decode_joint_state(states[-1][0]).position).max() > 0.1,
               what='a motion')
    wait_until(lambda: controller.status()[1] == 'running', what='a status without a warning')
    assert terms
    assert not np.any([decode_joint_state(data).position for data, _ in terms])
    adapted = own_estimate(controller.motion.controller.law)
    assert (adapted is not None) is (law == 'slotine_li')
    assert adapted is None or adapted.any()
