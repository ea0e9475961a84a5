# SPDX-License-Identifier: Apache-2.0
"""Controller and identifier in one process do what they do in two, and the command comes first."""

from __future__ import annotations

import itertools
import signal
import threading
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.messages.cdr import decode_float64_array, decode_joint_state
from adaptive_blf_control.messages.command import read_command
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    COMMANDS,
    JOINT_STATES,
    THETA_HAT,
    TRACKING_ERROR,
)
from adaptive_blf_control.nodes.arm_control import ArmControl

CONTROLLER = {
    'k1': [1000.0, 800.0], 'k2': [60.0, 8.0], 'torque_limit': [200.0, 100.0],
    'safety.lower': [-2.0, -2.0], 'safety.upper': [2.0, 2.0],
    'performance.lower': [-0.17], 'performance.upper': [0.2],
    'reference.joint1.amplitude': [0.5], 'reference.smooth_start': 0.0,
    'reference.resume_time': 0.5,
    'state_timeout': 60.0,  # a machine that stalls loses no state
}
EPOCH = 1_700_000_000 * 10**9


def _overrides(values: dict[str, Any]) -> dict[str, Any]:
    return {'parameter_overrides': [Parameter(name, value=value)
                                    for name, value in values.items()]}


class _Arm:
    """An arm that the test moves, and the two nodes of one process that answer it."""

    def __init__(self, graph, wait_until, tmp_path, identifier: dict[str, Any] | None = None,
                 **controller: Any) -> None:
        self._wait_until = wait_until
        estimate = {'estimate_file': str(tmp_path / 'theta_hat.yaml'), **(identifier or {})}
        self.both = ArmControl(context=graph.context,
                               controller=_overrides({**CONTROLLER, **controller}),
                               identifier=_overrides(estimate))
        for node in self.both.nodes:
            graph.add(node)
        peer = self.peer = graph.peer()
        self.heard = {topic: peer.listen(kind, topic) for topic, kind in (
            (COMMANDS, Float64MultiArray), (TRACKING_ERROR, JointState), (THETA_HAT, JointState),
            (ADAPTATION_TERM, JointState), ('/diagnostics', DiagnosticArray))}
        self.stamp_ns = EPOCH
        self._states = peer.create_publisher(JointState, JOINT_STATES, 10)
        wait_until(lambda: self._states.get_subscription_count() == 1
                   and self.both.controller.count_subscribers(COMMANDS) == 1
                   and self.both.controller.count_subscribers(TRACKING_ERROR) == 1,
                   what='the match')
        self.code: list[int] = []
        self.thread = threading.Thread(target=lambda: self.code.append(self.both.run()),
                                       daemon=True)
        graph._threads.append((self.both.stop, self.thread))
        self.thread.start()

    def step(self, q=(0.0, 0.0), qd=(0.0, 0.0), effort=(0.1, 0.1)) -> np.ndarray:
        """Publish a state 5 ms after the last one and return the torque that answers it."""
        before = len(self.heard[COMMANDS])
        self.publish(q, qd, effort)
        self._wait_until(lambda: len(self.heard[COMMANDS]) > before, what='an answer')
        return decode_float64_array(self.heard[COMMANDS][-1][0])

    def publish(self, q=(0.0, 0.0), qd=(0.0, 0.0), effort=(0.1, 0.1)) -> None:
        """Publish a state 5 ms after the last one."""
        self.stamp_ns += 5_000_000
        message = JointState(name=['joint1', 'joint2'], position=[float(x) for x in q],
                             velocity=[float(x) for x in qd], effort=[float(x) for x in effort])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.stamp_ns, 10**9)
        self._states.publish(message)

    def begin(self) -> None:
        """Publish states until the motion has begun: it waits for the first estimate."""
        def answered() -> bool:
            self.publish()
            return len(self.heard[COMMANDS]) > 0
        self._wait_until(answered, what='the motion')

    def statuses(self, node: str) -> list[DiagnosticStatus]:
        """Return the diagnostics of a node so far."""
        found = (deserialize_message(data, DiagnosticArray).status[0]
                 for data, _ in list(self.heard['/diagnostics']))
        return [status for status in found if status.name.startswith(f'{node}:')]

    def end(self) -> int:
        """End both and return the exit code."""
        self.both.stop.set()
        self._wait_until(lambda: self.code, what='the end')
        return self.code[0]


@pytest.fixture
def arm(graph, wait_until, tmp_path):
    """Return a maker of an arm with both nodes."""
    return lambda **controller: _Arm(graph, wait_until, tmp_path, **controller)


def test_an_estimate_acts_with_the_next_state_and_is_published_every_tenth(arm, wait_until):
    arm = arm()
    arm.begin()
    controller, identifier = arm.both.nodes
    for k in range(60):
        arm.step((0.001 * k, 0.002 * k), (0.2, 0.4))
    wait_until(lambda: identifier.last_ns == arm.stamp_ns, what='the last state learned')
    learned = identifier.identifier.theta
    assert np.abs(learned).max() > 0.0
    arm.step((0.06, 0.12), (0.2, 0.4))
    np.testing.assert_array_equal(controller.theta, learned)
    answered = len(arm.heard[TRACKING_ERROR])
    assert answered >= 60
    for topic in (THETA_HAT, ADAPTATION_TERM):
        stamps = [decode_joint_state(data).stamp_ns for data, _ in arm.heard[topic]]
        assert 5 <= len(stamps) <= answered // 10 + 10, topic
        assert (np.diff(stamps)[-3:] == 10 * 5_000_000).all(), topic
    assert arm.end() == 0


def test_the_term_of_the_state_before_is_the_one_that_is_learned_with(arm, wait_until):
    arm = arm()
    arm.begin()
    identifier = arm.both.identifier
    held: list[tuple[int, Any]] = []
    of_stamp = identifier.terms.held

    def note(stamp: int) -> Any:
        held.append((stamp, of_stamp(stamp)))
        return held[-1][1]

    identifier.terms.held = note
    terms = {}
    for k in range(5):
        arm.step((0.001 * k, 0.0), (0.2, 0.0))
        terms[arm.stamp_ns] = arm.both.controller.output.adaptation_term
    wait_until(lambda: held and held[-1][0] == arm.stamp_ns, what='the last state learned')
    for stamp, term in held[-4:]:
        np.testing.assert_array_equal(term, terms[stamp - 5_000_000])


def test_the_command_is_out_before_anything_is_learned(arm, wait_until):
    arm = arm()
    arm.begin()
    wait_until(lambda: arm.both.identifier.last_ns == arm.stamp_ns, what='nothing left to learn')
    going, may_go = threading.Event(), threading.Event()
    learn = arm.both.identifier.on_state

    def wait(sample: Any) -> None:
        going.set()
        may_go.wait()
        learn(sample)

    arm.both.identifier.on_state = wait
    arm.step()
    assert going.wait(60.0)  # it is answered, and learning stands still
    assert arm.both.identifier.last_ns < arm.stamp_ns
    may_go.set()
    wait_until(lambda: arm.both.identifier.last_ns == arm.stamp_ns, what='learning')


def test_a_request_that_keeps_the_identifier_keeps_no_torque(arm, wait_until):
    arm = arm()
    arm.begin()
    identifier = arm.both.identifier
    wait_until(lambda: identifier.last_ns == arm.stamp_ns, what='nothing left')
    with identifier.between_samples:
        for _ in range(5):
            arm.step()
        last = identifier.last_ns
    arm.step()
    wait_until(lambda: identifier.last_ns == arm.stamp_ns, what='all learned')
    assert last == arm.stamp_ns - 6 * 5_000_000
    assert identifier.identifier.restarts == 1  # it has learned from all of them


def test_a_failure_in_learning_is_named_and_the_torque_goes_on(arm, wait_until):
    arm = arm()
    arm.begin()
    arm.step()

    def fail(*_: Any) -> None:
        raise ZeroDivisionError('on purpose')

    vars(arm.both.identifier.identifier)['take'] = fail  # closed to others
    arm.step()  # which takes what was learned from the state before
    theta = arm.both.controller.theta
    for _ in range(3):
        arm.step()
    np.testing.assert_array_equal(arm.both.controller.theta, theta)
    wait_until(lambda: any(
        (each.level, 'ZeroDivisionError: on purpose' in each.message) == (
            DiagnosticStatus.ERROR, True)
        for each in arm.statuses('identifier')), what='the diagnostics')
    assert np.isfinite(arm.step()).all()
    assert arm.end() == 2


def test_without_states_the_torque_is_zero_and_the_next_one_begins_again(arm, wait_until):
    arm = arm(state_timeout=0.3)
    arm.begin()
    wait_until(lambda: not decode_float64_array(arm.heard[COMMANDS][-1][0]).any(), what='zero')
    assert 'no joint state for 0.3 s' in arm.both.controller.faults.last
    assert read_command(arm.heard[COMMANDS][-1][0]).stamp_ns is None
    zeros = len(arm.heard[COMMANDS])

    def answered() -> bool:
        arm.publish((0.05, 0.0))
        return any(decode_float64_array(data).any() for data, _ in arm.heard[COMMANDS][zeros:])
    wait_until(answered, what='another motion')


def test_deactivation_ends_the_torque_and_the_identifier_goes_on_learning(arm, wait_until):
    arm = arm(ramp_time=0.05)
    arm.begin()
    arm.step((0.05, 0.0))
    answer = arm.peer.call(ChangeState, 'controller/change_state', ChangeState.Request(
        transition=Transition(id=Transition.TRANSITION_DEACTIVATE)))
    assert answer.success
    wait_until(lambda: not decode_float64_array(arm.heard[COMMANDS][-1][0]).any(), what='zero')
    sent = len(arm.heard[COMMANDS])
    arm.publish((0.05, 0.0))
    wait_until(lambda: arm.both.identifier.last_ns == arm.stamp_ns, what='learning')
    assert len(arm.heard[COMMANDS]) == sent
    for transition in (Transition.TRANSITION_CLEANUP, Transition.TRANSITION_CONFIGURE):
        assert arm.peer.call(ChangeState, 'controller/change_state', ChangeState.Request(
            transition=Transition(id=transition))).success
        arm.publish((0.05, 0.0))
        wait_until(lambda: arm.both.identifier.last_ns == arm.stamp_ns, what='learning')
    assert arm.end() == 0


def test_live_parameters_and_services_of_both_work(arm, wait_until):
    arm = arm()
    arm.begin()
    for node, name, value in (('controller', 'k2', [50.0, 8.0]),
                              ('controller', 'composed_decimation', 1),
                              ('identifier', 'composed_decimation', 1),
                              ('identifier', 'kt', 3.0)):
        request = SetParametersAtomically.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()])
        result = arm.peer.call(SetParametersAtomically, f'{node}/set_parameters_atomically',
                               request).result
        assert result.successful, result.reason
    before = {topic: len(arm.heard[topic]) for topic in (THETA_HAT, ADAPTATION_TERM)}
    for _ in range(5):
        arm.step()
    wait_until(lambda: all(len(arm.heard[topic]) >= count + 5 for topic, count in before.items()),
               what='every estimate and term')
    assert arm.peer.call(Trigger, 'identifier/save_estimate').success


def test_another_arm_in_the_two_nodes_is_refused(graph):
    with pytest.raises(ParameterError, match='controller: joints of the arm'):
        ArmControl(context=graph.context, controller=_overrides({'joints': ['a', 'b']}))


def test_a_signal_ends_both_with_zero_torque_and_the_estimate(
        processes, wait_until, tmp_path, repository):
    estimate = tmp_path / 'theta_hat.yaml'
    config = ['--params-file', str(repository / 'config' / 'two_link.yaml')]
    driver = processes.start('arm_driver', '--ros-args', *config)
    both = processes.start('arm_control', '--ros-args', *config,
                           '-p', f'identifier:estimate_file:={estimate}',
                           '-p', 'controller:state_timeout:=60.0',
                           '-p', 'identifier:estimate_period:=0.2')
    wait_until(lambda: 'motion begins' in both.text and estimate.exists(), what='learning')
    before = len(both.text)
    assert both.signal(signal.SIGINT) == 0, both.text
    assert 'ERROR' not in both.text[before:]
    assert driver.signal(signal.SIGINT) == 0, driver.text


LEARNS = {'safety_filter': 'limits', 'limits.learn': True, 'limits.velocity': [20.0, 20.0],
          'limits.prior.mass_error': 0.3, 'limits.prior.friction': [8.0, 2.0],
          'limits.prior.unexplained': [1.0]}
SURE = {'parameter_set.period': 0.02, 'parameter_set.prior.mass_error': 0.3,
        'parameter_set.prior.friction': [8.0, 2.0], 'parameter_set.prior.unexplained': [1.0]}


def test_a_filter_that_learns_gets_the_intervals_of_the_identifier_in_memory(
        arm, wait_until) -> None:
    arm, two_link = arm(identifier=SURE, **LEARNS), TwoLinkArm()
    arm.begin()
    controller, identifier = arm.both.nodes
    moved, size = itertools.count(1), np.array([0.05, 0.1])

    def narrowed() -> bool:
        phase = 8.0 * 0.005 * next(moved)
        q, qd, qdd = size * (1.0 - np.cos(phase)), 8.0 * size * np.sin(phase), (
            64.0 * size * np.cos(phase))
        arm.step(q, qd, two_link.X(q, qd, qd, qdd) @ two_link.nominal)
        return controller.motion.controller.safety_filter.model.part < 1.0

    wait_until(narrowed, what='intervals that are narrower than the prior')
    assert identifier.parameter_set.estimator.falsified == 0
    assert controller.count_subscribers('identifier/parameter_set') == 0
    assert arm.end() == 0


def test_a_filter_that_learns_from_an_identifier_without_a_set_does_not_start(arm) -> None:
    with pytest.raises(ParameterError, match=r'identifier\.parameter_set\.period.*learn'):
        arm(**LEARNS)
