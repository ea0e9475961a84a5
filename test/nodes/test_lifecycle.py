# SPDX-License-Identifier: Apache-2.0
"""Arm driver and controller under a lifecycle manager: the services `ros2 lifecycle` calls."""

from __future__ import annotations

import gc
import math
import subprocess
import sys
import threading
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State, Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.messages.cdr import decode_float64_array
from adaptive_blf_control.messages.joint_state import decode_joint_state
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    COMMANDS,
    JOINT_STATES,
    THETA_HAT,
    TRACKING_ERROR,
)
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from patience import PATIENCE

RATE = 200.0  # Hz: two processors and other people's work
ARM = {'rate': RATE, 'true_model': 'given', 'true_parameters': [3.473, 0.196, 0.242, 5.3, 1.1],
       'initial_position': [0.5, -1.0], 'command_timeout': 1.0}
LAW = {
    'k1': [1000.0, 800.0], 'k2': [60.0, 8.0], 'torque_limit': [200.0, 100.0],
    'torque_rate_limit': [2000.0], 'initial_estimate': [3.0, 0.2, 0.3, 5.0, 1.0],
    'safety__lower': [-1.17, -2.17], 'safety__upper': [1.2, 2.2],
    'performance__lower': [-0.17], 'performance__upper': [0.2], 'state_timeout': 2.0,
    'reference__joint1__amplitude': [1.0], 'reference__joint1__frequency': [0.5],
    'reference__joint2__amplitude': [2.0], 'reference__joint2__frequency': [0.5],
    'reference__joint2__phase': [math.pi / 2.0],
}
RISE = 2000.0  # N·m/s, as above


class Cell:
    """Driver and controller with the test's lifecycle manager beside them.

    Attributes:
        driver: The arm driver, None where it was left out.
        controller: The controller, likewise.
        sent: Raw messages by topic.
    """

    def __init__(self, graph: Any, wait_until: Any, *, autostart: bool = False,
                 nodes: tuple[str, ...] = ('arm_driver', 'controller'),
                 arm: dict[str, Any] | None = None, law: dict[str, Any] | None = None,
                 executor: str = 'direct') -> None:
        """Start the nodes; ``arm`` and ``law`` change their parameters."""
        self.wait_until = wait_until
        self._graph = graph
        self.peer = graph.peer()
        self.sent = {topic: self.peer.listen(kind, f'/{topic}') for topic, kind in (
            (COMMANDS, Float64MultiArray), (JOINT_STATES, JointState),
            (ADAPTATION_TERM, JointState), (TRACKING_ERROR, JointState))}
        common = {'autostart': autostart, 'executor': executor}
        made = {}
        if 'arm_driver' in nodes:
            made['arm_driver'] = graph.make(ArmDriver, **{**ARM, **common, **(arm or {})})
        if 'controller' in nodes:
            made['controller'] = graph.make(ControllerNode, **{**LAW, **common, **(law or {})})
        self.driver, self.controller = made.get('arm_driver'), made.get('controller')
        self.runners = {name: graph.run(node) for name, node in made.items()}

    def change(self, node: str, transition: str) -> bool:
        """Ask for a transition by name and return whether it was made."""
        request = ChangeState.Request(transition=Transition(label=transition))
        return self.peer.call(ChangeState, f'/{node}/change_state', request).success

    def state(self, node: str) -> str:
        """Ask a node for its state."""
        return self.peer.call(GetState, f'/{node}/get_state').current_state.label

    def transitions(self, node: str) -> set[str]:
        """Ask a node what it could be asked for."""
        answer = self.peer.call(GetAvailableTransitions, f'/{node}/get_available_transitions')
        return {described.transition.label for described in answer.available_transitions}

    def moves(self, *steps: str) -> None:
        """Make transitions like ``'controller activate'``, each of which has to succeed."""
        for step in steps:
            assert self.change(*step.split()), step

    def hears(self, topic: str, more: int = 20) -> list[bytes]:
        """Wait for that many more messages on a topic and return all of it."""
        heard = self.sent[topic]
        count = len(heard) + more
        self.wait_until(lambda: len(heard) >= count, what=f'{topic} to go on')
        return [data for data, _ in heard]

    def knows_the_arm(self) -> None:
        """Wait until the controller has heard a state."""
        self.wait_until(lambda: self.controller.heard_at is not None)

    def is_released(self) -> None:
        """Wait until the driver follows commands."""
        self.wait_until(lambda: self.driver.started, what='the brakes')

    @property
    def torques(self) -> np.ndarray:
        """Commands so far, shape (N, n)."""
        return np.array([decode_float64_array(data) for data, _ in self.sent[COMMANDS]])


@pytest.fixture
def cell(graph, wait_until):
    """Return ``cell(**settings)``."""
    return lambda **settings: Cell(graph, wait_until, **settings)


def test_a_manager_takes_both_nodes_up_and_down_again_and_hears_of_it(cell, wait_until) -> None:
    cell = cell()
    for node in ('arm_driver', 'controller'):
        events = cell.peer.listen(TransitionEvent, f'/{node}/transition_event')
        wait_until(lambda node=node: cell.peer.count_publishers(f'/{node}/transition_event'))
        wait_until(lambda node=node: (cell.controller if node == 'controller' else cell.driver
                                      ).count_subscribers(f'/{node}/transition_event'))
        assert cell.state(node) == 'unconfigured'
        assert cell.transitions(node) == {'configure', 'shutdown'}
        assert not cell.change(node, 'activate')  # not from here
        cell.moves(f'{node} configure')
        assert cell.state(node) == 'inactive'
        assert cell.transitions(node) == {'activate', 'cleanup', 'shutdown'}
        if node == 'controller':
            cell.knows_the_arm()
        cell.moves(f'{node} activate')
        assert cell.state(node) == 'active'
        assert cell.transitions(node) == {'deactivate', 'shutdown'}
        goals = [State.PRIMARY_STATE_INACTIVE, State.PRIMARY_STATE_ACTIVE]
        wait_until(lambda events=events, goals=goals: [
            event.goal_state.id for event in (
                deserialize_message(data, TransitionEvent) for data, _ in events)
            if event.goal_state.id in goals] == goals)
    cell.is_released()
    cell.moves('controller deactivate', 'controller cleanup', 'arm_driver deactivate',
               'arm_driver cleanup')
    for node in ('arm_driver', 'controller'):
        assert cell.state(node) == 'unconfigured'
    for topic in cell.sent:
        wait_until(lambda topic=topic: cell.peer.count_publishers(f'/{topic}') == 0, what=topic)


def test_autostart_makes_run_enough_and_can_still_be_deactivated(cell) -> None:
    cell = cell(autostart=True)
    cell.hears(COMMANDS)
    assert {cell.state('arm_driver'), cell.state('controller')} == {'active'}
    cell.moves('controller deactivate')
    states = len(cell.sent[JOINT_STATES])
    cell.hears(JOINT_STATES)
    assert states > 0
    assert cell.state('controller') == 'inactive'  # and does not come back by itself


@pytest.mark.parametrize('executor', ['direct', 'plain'])
def test_a_transition_that_there_is_not_from_here_is_answered_and_changes_nothing(
        cell, executor) -> None:
    cell = cell(executor=executor)
    for node, machine in (('arm_driver', cell.driver), ('controller', cell.controller)):
        for number in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE, 77):
            request = ChangeState.Request(transition=Transition(id=number))
            assert not cell.peer.call(ChangeState, f'/{node}/change_state', request).success
            assert f"transition {number}: there is none from 'unconfigured'" in machine.faults.last
        assert not cell.change(node, 'activate')
        assert cell.state(node) == 'unconfigured'
    cell.moves('arm_driver configure', 'arm_driver activate')
    assert not cell.change('arm_driver', 'activate')
    assert cell.state('arm_driver') == 'active'


@pytest.mark.parametrize('executor', ['direct', 'plain'])
def test_a_node_that_waits_to_be_configured_says_so_in_its_diagnostics(
        cell, wait_until, executor) -> None:
    cell = cell(executor=executor)
    heard = cell.peer.listen(DiagnosticArray, '/diagnostics')
    told: dict[str, DiagnosticStatus] = {}

    def both() -> bool:
        for data, _ in list(heard):
            status = deserialize_message(data, DiagnosticArray).status[0]
            told[status.name.partition(':')[0]] = status
        return set(told) == {'arm_driver', 'controller'}

    wait_until(both, what='diagnostics of both')
    for status in told.values():
        assert (status.level, status.message) == (DiagnosticStatus.WARN, 'unconfigured')
    assert not cell.driver.faults.drops
    assert cell.driver.faults.last == ''


def test_a_request_in_the_middle_of_a_transition_waits_for_its_end(cell, monkeypatch) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def slow(node: ControllerNode) -> None:
        begun.set()
        assert go_on.wait(PATIENCE)
        activate(node)

    activate = ControllerNode.activate
    monkeypatch.setattr(ControllerNode, 'activate', slow)
    cell = cell(autostart=True, law={'state_timeout': 60.0})  # activates itself, in its loop
    assert begun.wait(PATIENCE)
    request = ChangeState.Request(transition=Transition(label='deactivate'))
    client = cell.peer.create_client(ChangeState, '/controller/change_state')
    assert client.wait_for_service(PATIENCE)
    future = client.call_async(request)
    cell.hears(JOINT_STATES)  # time for it to be taken
    assert not future.done()
    go_on.set()
    cell.wait_until(future.done, what='the answer')
    assert future.result().success
    assert cell.state('controller') == 'inactive'


def test_a_ramp_is_no_steeper_than_the_rate_limit(cell, wait_until) -> None:
    cell = cell(law={'ramp_time': 0.01})
    cell.moves('arm_driver configure', 'arm_driver activate', 'controller configure')
    cell.knows_the_arm()
    cell.moves('controller activate')
    cell.hears(COMMANDS, 100)
    with cell.controller.between_samples:  # slower than the motion needs, so only now
        slow = np.abs(cell.controller.output.torque)
        cell.controller.settings = cell.controller.settings.replace(torque_rate_limit=slow)
    cell.moves('controller deactivate')
    wait_until(lambda: not cell.torques[-1].any(), what='zero torque')
    answers = len(cell.sent[ADAPTATION_TERM])
    ramp = cell.torques[answers - 1:]
    expected = (np.abs(ramp[0]) / slow).max() * 1e3  # steps of 1 ms
    assert expected > 20.0  # where ramp_time alone would make 10
    assert len(ramp) == pytest.approx(expected, abs=2.0)
    steepest = np.abs(np.diff(ramp, axis=0)).max(axis=0) / 1e-3
    assert (steepest < 1.1 * slow).all()


def test_what_cannot_be_used_is_refused_while_configuring_with_its_reason(cell) -> None:
    cell = cell(law={'performance__upper': [0.2, 0.9]}, arm={'true_parameters': [1.0, 2.0]})
    assert not cell.change('controller', 'configure')
    assert cell.state('controller') == 'unconfigured'
    for told in ("'joint2'", '2.9', '2.2'):  # 2 rad of reference + 0.9 > 2.2
        assert told in cell.controller.faults.last
    assert not cell.change('arm_driver', 'configure')
    assert cell.state('arm_driver') == 'unconfigured'
    assert 'true_parameters' in cell.driver.faults.last
    assert cell.peer.count_publishers(f'/{JOINT_STATES}') == 0


def test_activation_needs_a_state_inside_the_safety_set_and_the_topic_for_itself(
        graph, cell, wait_until) -> None:
    cell = cell(arm={'initial_position': [0.5, -2.3]})
    cell.moves('controller configure')
    assert not cell.change('controller', 'activate')
    assert f'/{JOINT_STATES}: no joint state within 2 s' in cell.controller.faults.last
    cell.moves('arm_driver configure', 'arm_driver activate')
    cell.knows_the_arm()
    assert not cell.change('controller', 'activate')
    fault = cell.controller.faults.last
    assert all(told in fault for told in ("'joint2'", '-2.3', '-2.17')), fault
    cell.driver.plant.q = np.array([0.5, -2.0])
    wait_until(lambda: cell.controller.motion.q[1] == -2.0)
    intruder = graph.add(Node('intruder', context=graph.context))
    other = intruder.create_publisher(Float64MultiArray, f'/{COMMANDS}', 1)
    wait_until(lambda: cell.controller.count_publishers(COMMANDS) == 1)
    assert not cell.change('controller', 'activate')
    assert f'/{COMMANDS}: /intruder sends commands already' in cell.controller.faults.last
    intruder.destroy_publisher(other)
    wait_until(lambda: cell.controller.count_publishers(COMMANDS) == 0)
    assert cell.state('controller') == 'inactive'
    assert not cell.sent[COMMANDS]
    cell.moves('controller activate')
    cell.hears(COMMANDS)


def _check_start(torques: np.ndarray, terms: list[bytes], errors: list[bytes]) -> None:
    """The motion begins on the arm's posture, and no torque leaps."""
    stamps = np.array([decode_joint_state(data).stamp_ns for data in terms]) * 1e-9
    count = min(len(torques), len(stamps))
    assert count >= 20
    np.testing.assert_array_equal(decode_joint_state(errors[0]).position, 0.0)
    assert (np.abs(torques[0]) <= RISE * 1e-3 * (1.0 + 1e-9)).all()
    leaps = np.abs(np.diff(torques[:count], axis=0)).max(axis=1)
    assert (leaps <= RISE * np.diff(stamps[:count]) * (1.0 + 1e-6)).all()


@pytest.mark.parametrize('posture', [[-1.1, 2.1], [1.15, -2.1], [0.0, 0.3]])
def test_a_motion_joins_any_posture_inside_the_safety_set_without_a_leap(cell, posture) -> None:
    cell = cell(arm={'initial_position': posture})
    cell.moves('arm_driver configure', 'arm_driver activate', 'controller configure')
    cell.knows_the_arm()
    cell.moves('controller activate')
    cell.hears(ADAPTATION_TERM, 60)
    _check_start(cell.torques, [data for data, _ in cell.sent[ADAPTATION_TERM]],
                 [data for data, _ in cell.sent[TRACKING_ERROR]])


def test_deactivation_brings_the_torque_down_to_zero_and_gives_the_topic_back(
        cell, wait_until) -> None:
    cell = cell(law={'ramp_time': 0.1})
    cell.moves('arm_driver configure', 'arm_driver activate', 'controller configure')
    cell.knows_the_arm()
    for _ in range(2):  # the second motion joins the posture anew
        before = {topic: len(heard) for topic, heard in cell.sent.items()}
        cell.moves('controller activate')
        cell.hears(ADAPTATION_TERM, 60)
        cell.moves('controller deactivate')
        wait_until(lambda: cell.torques.any(axis=1)[-1] == 0, what='zero torque')
        torques, answers, errors = (
            [data for data, _ in cell.sent[topic][before[topic]:]]
            for topic in (COMMANDS, ADAPTATION_TERM, TRACKING_ERROR))
        torques = np.array([decode_float64_array(data) for data in torques])
        _check_start(torques[:len(answers)], answers, errors)
        ramp = torques[len(answers) - 1:]
        assert len(ramp) == 101  # the last answer, 99 steps on the way, zero
        assert (np.diff(np.abs(ramp), axis=0) <= 0.0).all()
        np.testing.assert_allclose(ramp, np.outer(np.linspace(1.0, 0.0, 101), ramp[0]),
                                   rtol=1e-9, atol=1e-12)
        np.testing.assert_array_equal(ramp[-1], 0.0)
        assert cell.peer.count_publishers(f'/{COMMANDS}') == 0
        cell.hears(JOINT_STATES)
    assert cell.driver.faults.drops == {}  # it has followed the second motion from its beginning


def test_a_deactivated_driver_ramps_down_and_then_brakes(cell, wait_until) -> None:
    cell = cell(arm={'ramp_time': 0.3})
    cell.moves('arm_driver configure', 'arm_driver activate', 'controller configure')
    cell.knows_the_arm()
    cell.moves('controller activate')
    cell.is_released()
    cell.hears(JOINT_STATES, 60)
    before = len(cell.sent[JOINT_STATES])
    cell.moves('arm_driver deactivate')
    wait_until(lambda: not cell.driver.started, what='the brakes')
    cell.hears(JOINT_STATES)
    states = [decode_joint_state(data) for data, _ in cell.sent[JOINT_STATES][before:]]
    braked = next(k for k, state in enumerate(states) if np.isnan(state.effort).all())
    for state in states[braked + 1:]:
        np.testing.assert_array_equal(state.velocity, 0.0)
        assert np.isnan(state.effort).all()
        np.testing.assert_array_equal(state.position, states[-1].position)
    # The first state of the ramp may still hold a part of an interval before it.
    sizes = np.abs([state.effort for state in states[:braked]])
    ramp = sizes[np.argmax(np.abs(np.diff(sizes, axis=0)).max(axis=1) > 0.0) + 2:]
    assert len(ramp) >= 10
    assert cell.driver.faults.drops['command while inactive'] > 0
    assert (ramp[-1] <= 0.2 * np.abs(sizes[0]) + 1e-9).all()


def test_cleaned_up_nodes_are_configured_again_while_their_loops_run(cell) -> None:
    cell = cell(autostart=True)
    for _ in range(3):
        cell.hears(COMMANDS)
        cell.moves('controller deactivate', 'controller cleanup', 'arm_driver deactivate',
                   'arm_driver cleanup')
        cell.moves('arm_driver configure', 'arm_driver activate', 'controller configure')
        cell.knows_the_arm()
        cell.wait_until(lambda: cell.change('controller', 'activate'), what='a joint state')
    cell.hears(COMMANDS)
    for node in (cell.driver, cell.controller):
        assert len(node.topics) == (1 if node is cell.driver else 2)
        cell.wait_until(lambda node=node: node.topics.leaving == 0)
    assert {runner.error for runner in cell.runners.values()} == {None}
    assert {runner.code for runner in cell.runners.values()} == {None}


@pytest.mark.parametrize('autostart', [False, True])
def test_shutdown_ends_the_nodes_and_a_moving_arm_gets_zero_torque(cell, autostart) -> None:
    cell = cell(autostart=autostart)
    if autostart:
        cell.hears(COMMANDS)
    for node in ('controller', 'arm_driver'):
        cell.moves(f'{node} shutdown')
        assert cell.runners[node].join() == 0
    if autostart:  # delivered is not yet handled: the peer takes one message at a time
        cell.wait_until(lambda: not cell.torques[-1].any(), 'zero torque as the last one')


@pytest.mark.parametrize('kind', [ArmDriver, ControllerNode])
def test_a_node_that_was_destroyed_is_seen_and_asked_no_more(
        graph, graph_of, wait_until, kind) -> None:
    peer = graph_of(graph.context.get_domain_id()).peer()
    wait_until(lambda: peer.get_node_names() == ['peer'])
    gc.disable()  # which would hide what keeps it
    try:
        node = graph.make(kind)
        name = node.get_name()
        wait_until(lambda: name in peer.get_node_names(), what='the node')
        graph.run(node).end()
        node.destroy_node()
        wait_until(lambda: peer.get_node_names() == ['peer'], what='the end of the node')
    finally:
        gc.enable()


def test_shutdown_ends_the_process_with_status_0(processes, graph_of, wait_until) -> None:
    process = processes.start('arm_driver', '--ros-args', '-p', 'arm:=two_link', '-p',
                              'joints:=[joint1, joint2]')
    client = graph_of(processes.domain).peer().create_client(ChangeState,
                                                             '/arm_driver/change_state')
    wait_until(client.service_is_ready)
    client.call_async(ChangeState.Request(transition=Transition(label='shutdown')))
    assert process.wait() == 0, process.text
    assert 'Traceback' not in process.text


WHAT_IS_COMPILED = '''
import sys

import rclpy
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.nodes.controller import ControllerNode


def compiled():
    """Return how often each compiled function of ours has been compiled."""
    return {f'{name}.{key}': len(value.signatures)
            for name, module in list(sys.modules.items())
            if name.startswith('adaptive_blf_control') for key, value in vars(module).items()
            if hasattr(value, 'nopython_signatures') and not isinstance(value, type)}


rclpy.init()
node = ControllerNode(parameter_overrides=[
    Parameter('arm', value='two_link'), Parameter('joints', value=['joint1', 'joint2']),
    Parameter('safety.lower', value=[-3.0]), Parameter('safety.upper', value=[3.0]),
    Parameter('wait_for_identifier', value=False)])
driver = rclpy.create_node('driver')
driver.create_subscription(Float64MultiArray, 'effort_controller/commands', lambda _: None, 10)
before = compiled()
state = JointState(name=['joint1', 'joint2'], position=[0.1, 0.2], velocity=[0.3, 0.4])
while node.statistics.samples < 3:
    state.header.stamp.sec += 1 if state.header.stamp.sec == 0 else 0
    state.header.stamp.nanosec += 1000000
    with node.between_samples:
        node.on_joint_states(serialize_message(state), {})
after = compiled()
assert before and any(before.values()), before
assert after == before, {k: (before.get(k), n) for k, n in after.items() if n != before.get(k)}
'''


def test_everything_is_compiled_before_the_first_state_is_answered() -> None:
    if not COMPILED:
        pytest.skip('laws run as plain numpy')
    run = subprocess.run([sys.executable, '-c', WHAT_IS_COMPILED], capture_output=True, text=True,
                         timeout=PATIENCE)
    assert run.returncode == 0, run.stdout + run.stderr


def test_the_plain_executor_runs_a_closed_loop_and_its_lifecycle(graph, cell, wait_until) -> None:
    identifier = graph.make(IdentifierNode, executor='plain',
                            initial_estimate=LAW['initial_estimate'])
    # So slow a motion and so weak a torque stay inside their sets where the machine stalls.
    cell = cell(executor='plain', arm={'initial_position': [0.0, 0.0], 'command_timeout': 0.1},
                law={'k1': [200.0, 200.0], 'k2': [40.0, 6.0], 'torque_limit': [40.0, 15.0],
                     'reference__joint1__amplitude': [0.1], 'reference__joint2__amplitude': [0.1],
                     'reference__joint2__phase': [0.0]})
    estimates = cell.peer.listen(JointState, f'/{THETA_HAT}')
    learning = graph.run(identifier)
    cell.moves('arm_driver configure', 'arm_driver activate', 'controller configure')
    cell.knows_the_arm()
    cell.moves('controller activate')
    cell.hears(COMMANDS)
    cell.moves('controller deactivate', 'controller cleanup', 'controller configure')
    wait_until(lambda: cell.change('controller', 'activate'), what='a joint state')
    errors, before = cell.sent[TRACKING_ERROR], len(cell.sent[TRACKING_ERROR])
    wait_until(lambda: len(errors) > before + 2 and _stamp(errors[-1]) - _stamp(errors[before])
               >= 10**9, what='one second')
    sizes = np.abs([decode_joint_state(data).position for data, _ in errors])
    assert (sizes < 0.17).all()
    assert min(len(errors), len(estimates)) >= 20
    assert cell.controller.monitors.violations == 0
    for node in ('controller', 'arm_driver'):
        cell.moves(f'{node} shutdown')
        assert cell.runners[node].join() == 0
    wait_until(lambda: not cell.torques[-1].any(), 'zero torque as the last one')
    assert learning.end() == 0


def _stamp(message: tuple[bytes, dict[str, int]]) -> int:
    return decode_joint_state(message[0]).stamp_ns
