# SPDX-License-Identifier: Apache-2.0
"""Two of what an arm may have one of: who is believed, who does not start, who is named."""

from __future__ import annotations

import itertools
import signal
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.configuration.parameter_file import node_values
from adaptive_blf_control.messages.topics import ADAPTATION_TERM, JOINT_STATES, THETA_HAT
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.nodes.recorder import Recorder
from adaptive_blf_control.runs.bag_run import bag_parameters
from adaptive_blf_control.runtime.data_node import PAUSE

PARAMETERS = TwoLinkArm().parameters
LABEL = '/identifier#0000abcd'
CALM = {'k1': [200.0, 200.0], 'k2': [40.0, 6.0], 'torque_limit': [40.0, 15.0],
        'initial_estimate': [3.0, 0.2, 0.3, 5.0, 1.0], 'state_timeout': 0.5}
EPOCH = 1_700_000_000 * 10**9


def _says(heard: list, node: str, *words: str) -> bool:
    statuses = (deserialize_message(data, DiagnosticArray).status[0] for data, _ in list(heard))
    return any(status.name.startswith(f'{node}:') and status.level == DiagnosticStatus.ERROR
               and all(word in status.message for word in words) for status in statuses)


class _States:
    """Joint states of one driver without a label."""

    def __init__(self, peer: Any, ahead_ms: float = 0.0) -> None:
        self._publisher = peer.create_publisher(JointState, JOINT_STATES, 10)
        self._stamps = itertools.count(EPOCH + round(ahead_ms * 1e6), 5 * 10**6)

    def send(self, q: float = 0.0) -> None:
        message = JointState(name=['joint1', 'joint2'], position=[q, 0.0], velocity=[0.0, 0.0],
                             effort=[0.0, 0.0])
        message.header.frame_id = 'base_link'
        stamp = divmod(next(self._stamps), 10**9)
        message.header.stamp.sec, message.header.stamp.nanosec = stamp
        self._publisher.publish(message)


def _vector(values: list[float], label: str = '') -> JointState:
    message = JointState(name=list(PARAMETERS), position=values)
    message.header.frame_id = label
    return message


def test_of_two_drivers_the_controller_believes_neither_and_names_both(graph, wait_until) -> None:
    controller = graph.make(ControllerNode, **CALM)
    one, other = graph.peer(), graph.peer()
    diagnostics = one.listen(DiagnosticArray, '/diagnostics')
    states = _States(one)
    listener = one.listen(Float64MultiArray, 'effort_controller/commands')
    graph.run(controller)

    def moves() -> bool:
        states.send(0.02)
        return len(listener) > 20

    wait_until(moves, 'the motion')
    rogue = _States(other, ahead_ms=40.0)

    def disputed() -> bool:
        states.send(0.02)
        rogue.send(0.5)
        return (controller.faults.drops.get('joint state of one of two publishers', 0) > 20
                and bool(controller.motion.lost))

    wait_until(disputed, 'zero torque')
    assert abs(controller.motion.q[0]) < 0.5  # not one of the second's
    wait_until(lambda: disputed() or _says(diagnostics, 'controller', 'several publishers of',
                                           JOINT_STATES, '/peer'))
    wait_until(lambda: _says(diagnostics, 'controller', 'several publishers of', '/peer'))

    def moves_again() -> bool:
        states.send(0.02)
        return not controller.motion.lost and controller.motion.torque.any()

    wait_until(moves_again, 'the motion, once the second is silent')


def test_a_second_identifier_is_refused_while_the_first_speaks_and_named(
        graph, wait_until) -> None:
    controller = graph.make(ControllerNode, **CALM)
    peer = graph.peer()
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    first, second = (peer.create_publisher(JointState, THETA_HAT, 10) for _ in range(2))
    wait_until(lambda: controller.count_publishers(THETA_HAT) == 2)
    graph.run(controller)
    good, bad = [3.1, 0.2, 0.3, 5.0, 1.0], [900.0] * 5

    def both() -> bool:
        first.publish(_vector(good, LABEL))
        second.publish(_vector(bad))
        return controller.faults.drops.get('estimate of a second publisher', 0) > 5

    wait_until(lambda: first.publish(_vector(good, LABEL)) or controller.theta.tolist() == good,
               'the first one')
    wait_until(both)
    assert controller.theta.tolist() == good
    wait_until(lambda: _says(diagnostics, 'controller', 'several publishers of', THETA_HAT,
                             '/peer'))


def test_a_second_controllers_terms_do_not_reach_the_estimate(graph, wait_until) -> None:
    identifier = graph.make(IdentifierNode)
    peer = graph.peer()
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    first, second = (peer.create_publisher(JointState, ADAPTATION_TERM, 10) for _ in range(2))
    wait_until(lambda: identifier.count_publishers(ADAPTATION_TERM) == 2)
    states = _States(peer)
    graph.run(identifier)

    def both(least: int) -> bool:
        first.publish(_vector([0.0] * 5, LABEL))
        states.send()
        if least:
            second.publish(_vector([1e9] * 5))
        return (identifier.faults.drops.get('adaptation term of a second publisher', 0) >= least
                and bool(identifier.terms.terms))

    wait_until(lambda: both(0))
    wait_until(lambda: both(20))
    assert not np.any([term for _, term in identifier.terms.terms])
    wait_until(lambda: _says(diagnostics, 'identifier', 'several publishers of',
                             ADAPTATION_TERM, '/peer'))


@pytest.mark.parametrize('within_a_pass', [False, True])
def test_a_pause_of_the_loop_is_one_wherever_it_begins(graph, within_a_pass) -> None:
    node, longer = graph.make(ArmDriver, rate=100.0), threading.Event()
    node.spin_data(0.0)
    assert node.listening_since == -np.inf
    longer.wait(1.5 * PAUSE)  # as if the process were stopped
    paused_until = time.monotonic()
    if not within_a_pass:
        node.spin_data(0.0)
    assert node.listening_since >= paused_until


MAKES = {'arm_driver': ArmDriver, 'identifier': IdentifierNode, 'controller': ControllerNode,
         'recorder': Recorder}


@pytest.mark.parametrize(('kind', 'name'), [
    ('arm_driver', 'arm_driver'), ('arm_driver', 'another'), ('identifier', 'identifier'),
    ('identifier', 'another'), ('controller', 'controller'), ('recorder', 'recorder')])
def test_a_second_graph_does_not_start_beside_the_first(
        processes, graph_of, wait_until, kind, name) -> None:
    graph = graph_of(processes.domain)
    given = {'bag': str(processes.folder / 'first')} if kind == 'recorder' else {}
    first = graph.make(MAKES[kind], **given)
    diagnostics = graph.peer().listen(DiagnosticArray, '/diagnostics')
    graph.run(first)
    wait_until(lambda: diagnostics, 'a sign of the first')
    bag = processes.folder / 'made' / 'second'
    own = ('-p', f'bag:={bag}') if kind == 'recorder' else ()
    second = processes.start(kind, '--ros-args', '-r', f'__node:={name}', '-p',
                             'discovery_time:=60.0', *own)
    assert second.wait() == 2
    assert f'/{kind} is running already' in second.text
    assert 'Traceback' not in second.text
    assert not bag.parent.exists()  # a recorder that is refused leaves no folder that it made
    if kind == 'recorder':
        assert first.output.bag.file.exists()


def test_of_a_parameter_that_is_given_twice_the_last_value_counts(
        processes, graph_of, wait_until) -> None:
    diagnostics = graph_of(processes.domain).peer().listen(DiagnosticArray, '/diagnostics')
    recorder = processes.start(
        'recorder', '--ros-args', '-p', f'bag:={processes.folder / "bag"}', '-p',
        'recorder:flush_period:=0.2', '-p', 'recorder:flush_period:=0.4')
    wait_until(lambda: diagnostics or recorder.popen.poll() is not None, 'a sign of it')
    assert recorder.signal(signal.SIGINT) == 0
    values = bag_parameters(read_bag(processes.folder / 'bag'))
    assert node_values(values, 'recorder')['flush_period'] == 0.4


def test_a_parameter_that_reaches_no_node_ends_the_start_with_its_name(processes) -> None:
    given = processes.start('controller', '--ros-args', '-r', '__ns:=/left', '-p',
                            'controller:torque_limit:=[1.0]')
    assert given.wait() == 2
    assert "'-p controller:torque_limit'" in given.text
    assert '/left/controller' in given.text
    elsewhere = processes.start('controller', '--ros-args', '-p', 'history.size:=7')
    recorder = processes.start('recorder', '--ros-args', '-r', '__ns:=/left', '-p',
                               f'bag:={processes.folder / "bag"}', '-p',
                               'recorder:flush_period:=0.2')
    assert recorder.wait() == 2
    assert "'-p recorder:flush_period'" in recorder.text
    assert not (processes.folder / 'bag').exists()
    assert elsewhere.wait() == 2
    assert "'-p history.size'" in elsewhere.text
    file = processes.folder / 'left.yaml'
    file.write_text('controller: {ros__parameters: {torque_limit: [1.0]}}', encoding='utf-8')
    section = processes.start('controller', '--ros-args', '-r', '__ns:=/left', '--params-file',
                              str(file))
    assert section.wait() == 2
    assert "'controller'" in section.text
    assert '/**/controller' in section.text
