# SPDX-License-Identifier: Apache-2.0
"""Attacks on a controller that moves an arm: stop is heard, torque is continuous."""

from __future__ import annotations

from array import array
import threading
import time
import tracemalloc
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from adaptive_blf_control.control.answered import Answered
from adaptive_blf_control.control.motion import Motion
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec
from adaptive_blf_control.messages.command import read_command
from adaptive_blf_control.messages.topics import COMMANDS, JOINT_STATES, JOINT_TRAJECTORY
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.runtime.message_age import MessageAge
from patience import PATIENCE

RATE = 200.0  # N·m/s
TASK = {'k2': [60.0, 8.0], 'torque_limit': [200.0, 100.0], 'torque_rate_limit': [RATE],
        'initial_estimate': [3.0, 0.2, 0.3, 5.0, 1.0], 'state_timeout': 0.4, 'ramp_time': 0.01,
        'safety__lower': [-2.0, -2.0], 'safety__upper': [2.0, 2.0]}
EPOCH = 1_700_000_000 * 10**9
LATE = 5e-3  # s by which the system may deliver one command later than the next


class _Driver:
    """Publishes joint states of an arm that is held away from its reference; hears torques."""

    def __init__(self, graph: Any, wait_until: Any, **parameters: Any) -> None:
        self.node = graph.make(ControllerNode, **{**TASK, **parameters})
        self.peer = graph.peer()
        self.commands = self.peer.listen(Float64MultiArray, COMMANDS, 5000)
        self.states = self.peer.create_publisher(JointState, JOINT_STATES, 10)
        self.stamp, self.side = EPOCH, 1.0
        graph.run(self.node)
        wait_until(self.push, 'the torque')

    def send(self, ms: float = 5.0) -> None:
        self.stamp += round(ms * 1e6)
        position, velocity = self.side * np.array([[0.15, 0.1], [0.5, 0.5]])
        message = JointState(name=['joint1', 'joint2'], position=position.tolist(),
                             velocity=velocity.tolist())
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.stamp, 10**9)
        self.states.publish(message)
        time.sleep(2e-3)  # the pace of the states, not a wait for something

    def push(self) -> bool:
        """Send a state; whether the torque is large."""
        self.send()
        return bool(np.abs(self.node.motion.torque).max() > 15.0)

    def check_rate(self) -> None:
        """Check each step of the torque that was heard against the time between them."""
        heard = list(self.commands)
        torques = [read_command(data).torque for data, _ in heard]
        times = [info['source_timestamp'] * 1e-9 for _, info in heard]
        for a, b, t0, t1 in zip(torques, torques[1:], times, times[1:]):
            if b.any():  # zero is what a watchdog may say at once
                assert np.abs(b - a).max() <= RATE * (t1 - t0 + LATE), (a, b, t1 - t0)


@pytest.fixture
def driver(graph, wait_until):
    """Return ``driver(**parameters)``."""
    return lambda **parameters: _Driver(graph, wait_until, **parameters)


@pytest.mark.parametrize('jump_ms', [300.0, 3.6e6])
def test_over_a_clock_that_jumps_ahead_the_torque_changes_no_faster(
        driver, wait_until, jump_ms) -> None:
    driver = driver()
    pushed, last = driver.node.motion.torque.copy(), driver.stamp
    driver.side = -1.0  # where the law asks for the opposite torque
    driver.send(jump_ms)
    wait_until(lambda: driver.push() and driver.node.motion.gate.last_ns > last + jump_ms * 1e6)
    wait_until(lambda: driver.push() and driver.node.motion.torque @ pushed < 0.0)
    driver.check_rate()


def test_after_a_first_torque_that_took_long_the_next_one_changes_no_faster(
        driver, monkeypatch) -> None:
    answer, pauses = Motion.answer, [0.05]

    def answered(motion: Motion, *given: Any) -> Answered:
        if pauses:
            time.sleep(pauses.pop())
        return answer(motion, *given)

    monkeypatch.setattr(Motion, 'answer', answered)
    driver().check_rate()


def test_a_state_that_has_waited_is_not_answered_nor_is_an_older_one(driver, wait_until) -> None:
    driver = driver()
    node, sent = driver.node, threading.Event()
    with node.between_samples:  # as if the process were stopped
        for _ in range(20):
            driver.send()
        last = driver.stamp
        time.sleep(1.5 * TASK['state_timeout'])
        sent.set()
    wait_until(lambda: 'joint state too old' in node.faults.drops)
    wait_until(lambda: node.motion.lost == 'joint states lost')
    answered = [read_command(data).stamp_ns or 0 for data, _ in list(driver.commands)]
    assert max(answered) <= last - 19 * 5 * 10**6  # one may have been taken before the pause
    wait_until(driver.push, 'the motion again')
    driver.check_rate()


def test_a_state_that_its_driver_held_up_is_not_answered_though_it_was_sent_just_now(
        driver, wait_until) -> None:
    driver = driver()
    node, last_at = driver.node, time.monotonic()
    wait_until(lambda: time.monotonic() > last_at + 1.5 * TASK['state_timeout'])
    assert node.motion.lost == 'joint states lost'
    driver.send()  # 5 ms later than the last one, by its stamp
    late = driver.stamp
    wait_until(lambda: 'joint state too old' in node.faults.drops)
    wait_until(driver.push, 'the motion again')
    assert late not in [read_command(data).stamp_ns for data, _ in list(driver.commands)]


def test_a_state_that_becomes_too_old_while_its_answer_is_computed_is_not_answered(
        driver, wait_until, monkeypatch) -> None:
    driver = driver()
    node, part = driver.node, 0.7 * TASK['state_timeout']
    answer = node.motion.answer

    def slow(*given: object) -> object:
        time.sleep(part)
        return answer(*given)

    with node.between_samples:
        driver.send()
        monkeypatch.setattr(node.motion, 'answer', slow)
        time.sleep(part)
    wait_until(lambda: node.motion.lost == 'joint states lost')
    assert driver.stamp not in [read_command(data).stamp_ns for data, _ in list(driver.commands)]
    monkeypatch.setattr(node.motion, 'answer', answer)
    wait_until(driver.push, 'the motion again')


@pytest.mark.parametrize(('of', 'step'), [(MessageAge, 'of'), (Float64MultiArrayCodec, 'encode')],
                         ids=['while its age is looked at', 'while the command is written'])
def test_a_process_that_is_stopped_anywhere_on_the_way_does_not_answer_an_old_state(
        driver, wait_until, monkeypatch, of, step) -> None:
    driver = driver()
    node, do = driver.node, getattr(of, step)

    def stopped_after(*given: object) -> object:
        done = do(*given)
        time.sleep(1.2 * TASK['state_timeout'])
        return done

    with node.between_samples:
        driver.send()
        monkeypatch.setattr(of, step, stopped_after)
    wait_until(lambda: node.motion.lost == 'joint states lost')
    monkeypatch.setattr(of, step, do)
    late = driver.stamp
    wait_until(driver.push, 'the motion again')
    assert late not in [read_command(data).stamp_ns for data, _ in list(driver.commands)]


def test_a_state_that_becomes_too_old_while_a_motion_begins_is_not_answered(
        driver, wait_until, monkeypatch) -> None:
    driver = driver()
    node, begin = driver.node, driver.node.motion.begin
    wait_until(lambda: node.motion.lost == 'joint states lost')

    def slow(*given: object) -> object:
        time.sleep(1.2 * TASK['state_timeout'])
        return begin(*given)

    with monkeypatch.context() as within:
        within.setattr(node.motion, 'begin', slow)
        driver.send()
        wait_until(lambda: 'joint state too old' in node.faults.drops)
    assert node.motion.lost == 'joint states lost'  # so that the next state begins it again
    late = driver.stamp
    wait_until(driver.push, 'the motion again')
    assert late not in [read_command(data).stamp_ns for data, _ in list(driver.commands)]
    driver.check_rate()  # what was not sent is not where the torque goes on from


def test_deactivation_is_heard_while_a_long_trajectory_is_checked(driver, wait_until) -> None:
    driver = driver()
    points = driver.peer.create_publisher(JointTrajectory, JOINT_TRAJECTORY, 10)
    wait_until(lambda: points.get_subscription_count() == 1)
    message = JointTrajectory(joint_names=['joint1', 'joint2'])
    for k in range(10_000):
        point = JointTrajectoryPoint(positions=[0.1 * np.sin(0.01 * k), 0.0])
        point.time_from_start.sec, point.time_from_start.nanosec = 1 + k, 0
        message.points.append(point)
    points.publish(message)
    client = driver.peer.create_client(ChangeState, '/controller/change_state')
    assert client.wait_for_service(60.0)
    wait_until(lambda: driver.push() and driver.node.inputs.trajectories.busy,
               'the check has begun')
    before = len(driver.commands)
    answer = client.call_async(ChangeState.Request(
        transition=Transition(id=Transition.TRANSITION_DEACTIVATE)))

    def stopped() -> bool:
        driver.send()
        return answer.done() and answer.result().success

    wait_until(stopped)
    assert len(driver.commands) < before + 1000  # 25 s and 3335 commands, before
    wait_until(lambda: not read_command(driver.commands[-1][0]).torque.any())
    driver.check_rate()


def test_what_is_too_long_is_refused_by_its_length(driver) -> None:
    driver = driver()
    (result,) = driver.node.set_parameters([Parameter('k2', value=[1.0] * 100_000)])
    assert not result.successful
    assert len(result.reason) < 1000
    assert 'at most 1000' in result.reason


def test_a_list_that_is_too_long_is_refused_without_a_copy_of_it(driver) -> None:
    node = driver().node
    gains = Parameter('k2', Parameter.Type.DOUBLE_ARRAY, array('d', [1.0]) * 10**6)
    tracemalloc.start()
    try:
        (result,) = node.set_parameters([gains])
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert 'a list of 1000000 elements' in result.reason
    assert peak < 4e6  # bytes; a list of its numbers has 32 MB


def test_lists_of_a_million_are_refused_by_service_while_the_motion_goes_on(
        driver, wait_until) -> None:
    driver = driver(state_timeout=30.0)
    client = driver.peer.create_client(SetParameters, '/controller/set_parameters')
    assert client.wait_for_service(PATIENCE)
    gains = [Parameter('k2', value=[1.0] * 10**6)]
    sinusoids = [Parameter(f'reference.joint1.{name}', value=[1.0] * 10**5)
                 for name in ('amplitude', 'frequency', 'phase')]
    answers = [client.call_async(SetParameters.Request(
        parameters=[each.to_parameter_msg() for each in asked])) for asked in (gains, sinusoids)]
    answered = driver.node.statistics.samples

    def both() -> bool:
        driver.send()
        return all(answer.done() for answer in answers)

    wait_until(both, 'both refusals')
    for result in (each for answer in answers for each in answer.result().results):
        assert not result.successful
        assert 'at most 1000' in result.reason
        assert len(result.reason) < 1000
    wait_until(lambda: driver.push() and driver.node.statistics.samples > answered + 20)
    assert not driver.node.motion.lost
    driver.check_rate()


def test_each_of_three_clients_is_answered_however_often_it_asks(driver, wait_until) -> None:
    driver = driver(state_timeout=30.0)
    clients = [driver.peer.create_client(GetState, '/controller/get_state') for _ in range(3)]
    assert all(client.wait_for_service(PATIENCE) for client in clients)
    for _ in range(50):
        answers = [client.call_async(GetState.Request()) for client in clients]

        def all_answered(answers: list = answers) -> bool:
            driver.send()
            return all(answer.done() for answer in answers)

        wait_until(all_answered)
        assert {answer.result().current_state.label for answer in answers} == {'active'}
    assert not driver.node.motion.lost


def test_no_path_can_be_set_while_a_node_runs() -> None:
    from adaptive_blf_control.configuration.node_settings import TABLES
    paths = [row for table in TABLES.values() for row in table
             if row.name.endswith(('_file', 'bag', 'urdf', 'plant'))]
    assert len(paths) >= 5
    assert all(row.read_only for row in paths)
