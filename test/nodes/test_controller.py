# SPDX-License-Identifier: Apache-2.0
"""The controller answers what it can trust and nothing else, and ends with a zero torque."""

from __future__ import annotations

from collections.abc import Iterator
import inspect
import itertools
import math
import signal
import subprocess
import sys
import time

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.barrier import barrier
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.way import way_through
from adaptive_blf_control.errors import ParameterError, SetViolation
from adaptive_blf_control.limits.prior import prior_of
from adaptive_blf_control.messages.cdr import decode_float64_array
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    BARRIER,
    COMMANDS,
    GUARANTEE,
    JOINT_STATES,
    PARAMETER_SET,
    REFERENCE,
    THETA_HAT,
    TRACKING_ERROR,
)
from adaptive_blf_control.nodes import trajectory_input
from adaptive_blf_control.nodes.command_topic import GIVE_WAY
from adaptive_blf_control.nodes.controller import ControllerNode

TASK = {
    'k1': [1000.0, 800.0], 'k2': [60.0, 8.0], 'torque_limit': [200.0, 100.0],
    'initial_estimate': [3.0, 0.2, 0.3, 5.0, 1.0],
    'safety__lower': [-1.17, -2.17], 'safety__upper': [1.2, 2.2],
    'performance__lower': [-0.17], 'performance__upper': [0.2],
    'reference__joint1__amplitude': [1.0], 'reference__joint1__frequency': [0.5],
    'reference__joint2__amplitude': [2.0], 'reference__joint2__frequency': [0.5],
    'reference__joint2__phase': [math.pi / 2.0],
    'reference__smooth_start': 0.0, 'torque_rate_limit': [1e6], 'state_timeout': 5.0,
}
Q, QD = [0.01, 1.98], [0.4, -0.1]
PARAMETERS = TwoLinkArm().parameters


def _state(ms: float, q=Q, qd=QD, names=('joint1', 'joint2'), effort=(0.0, 0.0)) -> JointState:
    message = JointState(name=list(names), position=[float(x) for x in q],
                         velocity=[float(x) for x in qd], effort=[float(x) for x in effort])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(ms * 1e6) + 10**12,
                                                                    10**9)
    return message


def _estimate(theta, names=PARAMETERS) -> bytes:
    return serialize_message(JointState(name=list(names), position=[float(x) for x in theta]))


class _Rig:
    """A controller whose handlers the test calls, and everything it sends over DDS."""

    def __init__(self, graph, wait_until, namespace: str = '', **parameters) -> None:
        self.node = graph.make(ControllerNode, namespace=namespace, **{**TASK, **parameters})
        self.peer = graph.peer()
        self._wait_until = wait_until
        self.sent = {
            topic: self.peer.listen(kind, f'{namespace}/{topic}') for topic, kind in (
                (COMMANDS, Float64MultiArray), (ADAPTATION_TERM, JointState),
                (REFERENCE, JointState), (TRACKING_ERROR, JointState), (BARRIER, JointState))}
        heard = {f'{namespace}/{topic}' for topic in self.sent}
        wait_until(lambda: self.node.commands.someone_drives() and all(
            publisher.get_subscription_count() for publisher in self.node.topics.publishers
            if publisher.topic_name in heard), what='the match')
        self._answers = 0

    def answer(self, state: JointState) -> np.ndarray:
        """Hand over a state and return the torque that was sent.

        The first one again and again: the node activates itself on it, and then waits for the
        match of the publisher it has made.
        """
        node, data = self.node, serialize_message(state)
        samples = node.statistics.samples

        def answered() -> bool:
            node.on_joint_states(data, {})
            return node.statistics.samples > samples

        if node.output is None:
            self._wait_until(answered, what='the first answer')
        else:
            assert answered(), node.faults.drops
        self._answers += 1
        self._wait_until(lambda: len(self.sent[COMMANDS]) == self._answers, what='the torque')
        return self.torques[-1]

    def answered_over_dds(self, states, state: JointState) -> None:
        """Publish a state until the node, running in its thread, has answered it."""
        samples = self.node.statistics.samples

        def answered() -> bool:
            states.publish(state)
            return self.node.statistics.samples > samples

        self._wait_until(answered, what='the answer')

    @property
    def torques(self) -> list[np.ndarray]:
        return [decode_float64_array(data) for data, _ in self.sent[COMMANDS]]

    def ignores(self, state: JointState | bytes, reason: str) -> None:
        """Check that a message is dropped for ``reason``, unanswered, and leaves no trace."""
        node, data = self.node, state if isinstance(state, bytes) else serialize_message(state)
        before = (node.output, node.theta, node.motion.gate.last_ns, node.heard_at,
                  node.statistics.samples)
        drops = dict(node.faults.drops)
        node.on_joint_states(data, {})
        assert node.faults.drops == {**drops, reason: drops.get(reason, 0) + 1}
        after = (node.output, node.theta, node.motion.gate.last_ns, node.heard_at,
                  node.statistics.samples)
        assert all(a is b or a == b for a, b in zip(before, after))


_LISTENER = """
import rclpy
from std_msgs.msg import Float64MultiArray
rclpy.init(domain_id={domain})
node = rclpy.create_node('arm')
node.create_subscription(Float64MultiArray, '{topic}', lambda _: None, 1)
print('listens', flush=True)
rclpy.spin(node)
"""


@pytest.fixture
def deaf_listener(graph) -> Iterator[subprocess.Popen[str]]:
    """Return a process that DDS shows as a listener of commands, stopped before the first."""
    code = _LISTENER.format(domain=graph.context.get_domain_id(), topic=COMMANDS)
    with subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL, text=True) as listener:
        assert listener.stdout is not None
        assert listener.stdout.readline() == 'listens\n'
        yield listener
        listener.kill()


@pytest.fixture
def rig(graph, wait_until):
    """Return ``rig(**parameters)``."""
    return lambda **parameters: _Rig(graph, wait_until, **parameters)


def _settings(rig_, **changed) -> ControllerNodeSettings:
    return rig_.node.settings.replace(**changed)


def test_the_torque_is_that_of_the_law_for_the_state_and_the_time_since_the_start(
        rig, wait_until) -> None:
    rig = rig(state_timeout=1.0)
    law = Controller(TwoLinkArm(), _settings(rig), start=np.array(Q))
    theta = np.array(TASK['initial_estimate'])
    for ms, q, qd in ((0.0, Q, QD), (1.0, [0.02, 1.97], QD), (250.0, [0.1, 1.99], [0.5, -0.3])):
        expected = law.update(ms * 1e-3, np.array(q), np.array(qd), theta)
        np.testing.assert_allclose(rig.answer(_state(ms, q, qd)), expected.torque, rtol=1e-9)
    wait_until(lambda: len(rig.sent[ADAPTATION_TERM]) == 3, what='the term of the last state')
    term = deserialize_message(rig.sent[ADAPTATION_TERM][-1][0], JointState)
    assert tuple(term.name) == PARAMETERS
    np.testing.assert_allclose(term.position, expected.adaptation_term, rtol=1e-9)
    assert term.header.stamp == _state(250.0).header.stamp


def test_a_motion_whose_torques_nobody_confirms_begins_again_where_the_arm_has_come_to(
        rig, wait_until, deaf_listener) -> None:
    rig = rig(reference__smooth_start=1.0, state_timeout=1.0)
    commands, fallen = rig.node.commands, np.add(Q, [-0.1, 0.05])
    wait_until(lambda: '/arm' in commands.listeners.names(), what='the listener')
    deaf_listener.send_signal(signal.SIGSTOP)
    rig.answer(_state(0.0))
    errors = []

    def begins_again() -> bool:
        rig.answer(_state(len(errors) + 1.0, fallen))
        errors.append(np.abs(rig.node.output.e1).max())
        return errors[-1] < 0.01

    wait_until(begins_again, what='another beginning')
    assert 'a listener does not confirm the torques' in rig.node.faults.last
    deaf_listener.send_signal(signal.SIGCONT)
    wait_until(lambda: not commands.unheard() and commands.confirmed, what='the confirmation')
    rig.answer(_state(len(errors) + 2.0, Q))
    assert np.abs(rig.node.output.e1).max() > 0.09


def test_a_listener_that_was_killed_holds_no_motion_up_for_long(
        rig, wait_until, deaf_listener) -> None:
    rig = rig(reference__smooth_start=1.0, state_timeout=1.0)
    commands = rig.node.commands
    wait_until(lambda: '/arm' in commands.listeners.names(), what='the listener')
    deaf_listener.kill()
    states = itertools.count()

    def goes_on() -> bool:
        rig.answer(_state(next(states)))
        return commands.confirmed

    wait_until(goes_on, what='a motion that stays')
    assert '/arm' in commands.listeners.names()  # still shown: that is not what ended it
    rig.answer(_state(next(states), np.add(Q, [-0.1, 0.05])))
    assert np.abs(rig.node.output.e1).max() > 0.09


def test_what_the_user_sees_is_reference_errors_and_margins_by_name(rig, wait_until) -> None:
    rig = rig(state_timeout=1.0, monitor_decimation=1)
    rig.answer(_state(0.0))
    rig.answer(_state(500.0, [0.3, 1.9], [0.4, -0.4]))
    wait_until(lambda: len(rig.sent[BARRIER]) == 2)
    reference, error, barrier = (deserialize_message(rig.sent[topic][-1][0], JointState)
                                 for topic in (REFERENCE, TRACKING_ERROR, BARRIER))
    yd = np.array([math.sin(0.25), 2.0 * math.cos(0.25)])
    np.testing.assert_allclose(reference.position, yd, rtol=1e-12)
    np.testing.assert_allclose(reference.effort, -0.25 * yd, rtol=1e-12)  # the acceleration
    np.testing.assert_allclose(error.position, np.array([0.3, 1.9]) - yd, rtol=1e-9)
    margins = dict(zip(barrier.name, barrier.position))
    assert margins['joint2.safety_margin'] == pytest.approx(2.2 - 1.9)
    assert margins['joint1.performance_margin'] == pytest.approx(0.2 - (0.3 - yd[0]))
    assert margins['V'] > 0.0


def test_monitors_are_thinned_out_while_every_state_is_answered(rig, wait_until) -> None:
    rig = rig(monitor_decimation=5)
    for k in range(11):
        rig.answer(_state(k))
    wait_until(lambda: len(rig.sent[BARRIER]) == 3 and len(rig.sent[ADAPTATION_TERM]) == 11)


def test_joints_are_matched_by_name_in_any_order_among_any_others(graph, wait_until) -> None:
    plain, other = _Rig(graph, wait_until), _Rig(graph, wait_until, '/other')
    for k, q in enumerate((Q, [0.05, 1.9], [0.0, 2.0])):
        ordered = plain.answer(_state(k, q, QD))
        shuffled = other.answer(_state(k, [7.0, q[1], 8.0, q[0]], [1.0, QD[1], 2.0, QD[0]],
                                       ('gripper', 'joint2', 'wheel', 'joint1'), [0.0] * 4))
        np.testing.assert_array_equal(ordered, shuffled)
        assert ordered[0] != ordered[1]


def test_states_that_cannot_be_used_are_dropped_and_counted(rig) -> None:
    rig = rig()
    good = rig.answer(_state(0.0))
    unusable = 'unusable joint state'
    rig.ignores(_state(1.0, names=('joint1', 'joint3')), unusable)
    rig.ignores(_state(1.0, [1.0], [1.0], ('joint1',), [0.0]), unusable)
    rig.ignores(_state(1.0, [0.0] * 3, [0.0] * 3, ('joint1', 'joint2', 'joint2'), []), unusable)
    rig.ignores(_state(1.0, [0.01], QD), unusable)
    rig.ignores(_state(1.0, Q, [0.1, 0.1, 0.1]), unusable)
    rig.ignores(JointState(), unusable)
    rig.ignores(b'', unusable)
    rig.ignores(serialize_message(_state(1.0))[:50], unusable)
    not_finite = 'non-finite joint state'
    rig.ignores(_state(1.0, [], QD), not_finite)  # empty arrays: nothing was measured
    rig.ignores(_state(1.0, Q, []), not_finite)
    for value in (math.nan, math.inf, -math.inf):
        rig.ignores(_state(1.0, [0.01, value]), not_finite)
        rig.ignores(_state(1.0, Q, [value, 0.1]), not_finite)
    out_of_order = 'joint state out of order'
    rig.ignores(_state(0.0), out_of_order)
    rig.ignores(_state(-0.001), out_of_order)
    rig.ignores(_state(-1e6), out_of_order)
    np.testing.assert_array_equal(good, rig.torques[0])
    assert len(rig.torques) == 1
    assert not np.array_equal(rig.answer(_state(1.0, [0.05, 1.9])), good)
    assert sum(rig.node.faults.drops.values()) == 19


def test_one_wild_stamp_is_dropped_and_a_clock_that_stays_ahead_is_followed(rig) -> None:
    rig = rig(state_timeout=0.1)
    rig.answer(_state(0.0))
    rig.ignores(_state(5000.0), 'stamp jumps ahead')
    rig.answer(_state(1.0))
    rig.ignores(_state(7000.0), 'stamp jumps ahead')
    rig.ignores(_state(9000.0), 'stamp jumps ahead')
    rig.answer(_state(9001.0))
    rig.ignores(_state(8000.0), 'joint state out of order')
    assert rig.node.output.reference.position[0] == pytest.approx(Q[0])  # begins again from there


def test_a_stamp_that_no_message_can_hold_is_dropped(rig) -> None:
    rig = rig()
    rig.answer(_state(0.0))
    state = _state(0.0)
    state.header.stamp.sec, state.header.stamp.nanosec = 2**31 - 1, 2**32 - 1
    rig.ignores(state, 'unusable joint state')


def test_effort_is_not_needed(rig) -> None:
    rig = rig()
    assert np.isfinite(rig.answer(_state(0.0, effort=[math.nan, math.nan]))).all()
    assert np.isfinite(rig.answer(_state(1.0, effort=[]))).all()


def test_no_bytes_on_any_topic_give_a_non_finite_torque(rig) -> None:
    hypothesis = pytest.importorskip('hypothesis')
    from hypothesis import strategies
    rig = rig(monitor_decimation=7, state_timeout=60.0)
    node = rig.node
    rig.answer(_state(0.0))
    state, estimate = serialize_message(_state(1.0)), _estimate(TASK['initial_estimate'])
    numbers = strategies.lists(strategies.floats(), min_size=2, max_size=2)
    extreme = strategies.builds(
        lambda q, qd, ms: serialize_message(_state(ms, q, qd)), numbers, numbers,
        strategies.integers(0, 10**6))
    estimates = strategies.builds(_estimate, strategies.lists(strategies.floats(), min_size=5,
                                                              max_size=5))

    def corrupted(good: bytes):
        return strategies.builds(lambda at, new: good[:at] + new + good[at + len(new):],
                                 strategies.integers(0, len(good)), strategies.binary(max_size=9))

    @hypothesis.settings(max_examples=3000)
    @hypothesis.given(
        strategies.binary(max_size=120) | corrupted(state) | extreme,
        strategies.binary(max_size=120) | corrupted(estimate) | estimates)
    def any_bytes(joint_state: bytes, theta_hat: bytes) -> None:
        node.estimates.receive(theta_hat, {})
        node.motion.gate.last_ns = None  # every stamp is a new one
        with np.errstate(all='ignore'):
            node.on_joint_states(joint_state, {})
        assert np.isfinite(node.output.torque).all()
        assert (np.abs(node.output.torque) <= [200.0, 100.0]).all()
        assert np.isfinite(node.theta).all()

    any_bytes()
    assert node.statistics.samples > 500
    assert len(node.faults.drops) == 5, node.faults.drops
    for torque in rig.torques:
        assert np.isfinite(torque).all()


def test_without_an_estimate_the_controller_goes_on_with_the_first_one(rig) -> None:
    rig = rig()
    law = Controller(TwoLinkArm(), _settings(rig), start=np.array(Q))
    for k in range(20):
        np.testing.assert_allclose(
            rig.answer(_state(k)),
            law.update(k * 1e-3, np.array(Q), np.array(QD), np.array(TASK['initial_estimate'])
                       ).torque, rtol=1e-9)


def test_an_estimate_acts_from_the_next_state_on_matched_by_name(graph, wait_until) -> None:
    plain, other = _Rig(graph, wait_until), _Rig(graph, wait_until, '/other')
    theta = np.array([3.4, 0.19, 0.25, 5.2, 1.3])
    before = plain.answer(_state(0.0)), other.answer(_state(0.0))
    plain.node.estimates.receive(_estimate(theta), {})
    other.node.estimates.receive(_estimate(theta[::-1], PARAMETERS[::-1]), {})
    for ms in (1.0, 2.0):
        after = plain.answer(_state(ms)), other.answer(_state(ms))
    np.testing.assert_array_equal(*before)
    np.testing.assert_array_equal(*after)
    law = Controller(TwoLinkArm(), _settings(plain), start=np.array(Q))
    np.testing.assert_allclose(
        after[0], law.update(2e-3, np.array(Q), np.array(QD), theta).torque, rtol=1e-9)


def test_an_estimate_that_cannot_be_used_leaves_the_last_one(rig) -> None:
    rig = rig()
    rig.node.estimates.receive(_estimate([3.4, 0.19, 0.25, 5.2, 1.3]), {})
    kept = rig.node.theta
    for bad in ([3.0, math.nan, 0.3, 5.0, 1.0], [3.0, 0.2, 0.3, math.inf, 1.0]):
        rig.node.estimates.receive(_estimate(bad), {})
    rig.node.estimates.receive(_estimate([], []), {})
    rig.node.estimates.receive(_estimate([1.0] * 4, PARAMETERS[:4]), {})
    rig.node.estimates.receive(b'\0\1\0\0', {})
    assert rig.node.theta is kept
    assert rig.node.faults.drops == {'non-finite estimate': 2, 'unusable estimate': 3}


@pytest.mark.parametrize(('limit', 'believed', 'beyond', 'named'), [
    ([1000.0], [999.0] * 5, [1000.5, 0.0, 0.0, 0.0, 0.0], f'{PARAMETERS[0]} = 1000 '),
    ([10.0, 1.0, 1.0, 10.0, 10.0], [9.0, 0.9, -0.9, 9.0, 9.0], [9.0, 0.9, -1.1, 9.0, 9.0],
     f'{PARAMETERS[2]} = -1.1 is beyond estimate_limit 1:'),
])
def test_an_estimate_beyond_the_limit_is_refused_and_the_last_good_one_kept(
        rig, capfd, limit, believed, beyond, named) -> None:
    rig = rig(estimate_limit=limit)
    rig.node.estimates.receive(_estimate(believed), {})
    rig.node.estimates.receive(_estimate(beyond), {})
    np.testing.assert_array_equal(rig.node.theta, believed)
    assert rig.node.faults.drops == {'estimate beyond its limit': 1}
    assert named in capfd.readouterr().err
    assert named in rig.node.faults.last


def test_an_estimate_limit_of_another_length_is_refused(graph) -> None:
    with pytest.raises(ParameterError, match=r'estimate_limit.*length 1 or 5'):
        graph.make(ControllerNode, **TASK, estimate_limit=[1.0, 2.0])


def test_with_known_parameters_nothing_is_learned(rig) -> None:
    theta = [3.473, 0.196, 0.242, 5.3, 1.1]
    rig = rig(model='known', known_parameters=theta)
    assert rig.node.count_subscribers(THETA_HAT) == 0
    law = Controller(TwoLinkArm(), _settings(rig), start=np.array(Q))
    np.testing.assert_allclose(
        rig.answer(_state(0.0)),
        law.update(0.0, np.array(Q), np.array(QD), np.array(theta)).torque, rtol=1e-9)


@pytest.mark.parametrize(('q', 'joint', 'value', 'bound', 'what'), [
    ([-1.3, 2.0], 'joint1', -1.3, -1.17, 'safety'),
    ([0.0, 2.5], 'joint2', 2.5, 2.2, 'safety'),
])
def test_a_start_outside_the_safety_set_ends_the_node_without_any_torque(
        graph, wait_until, q, joint, value, bound, what) -> None:
    rig = _Rig(graph, wait_until)
    states = rig.peer.create_publisher(JointState, JOINT_STATES, 10)
    wait_until(lambda: states.get_subscription_count() == 1)
    runner = graph.run(rig.node)
    states.publish(_state(0.0, q))
    with pytest.raises(SetViolation, match=f"joint '{joint}': start .* {what} set") as error:
        runner.join()
    assert error.value.value == pytest.approx(value)
    assert error.value.bound == pytest.approx(bound)
    assert not rig.node.commands.claimed
    assert rig.torques == []


def test_a_process_whose_arm_starts_outside_a_set_says_so_and_fails(
        processes, graph_of, wait_until) -> None:
    process = processes.start('controller', '--ros-args', '-p', 'safety.upper:=[3.0, 0.5]', '-p',
                              'wait_for_identifier:=false')
    peer = graph_of(processes.domain).peer()
    commands = peer.listen(Float64MultiArray, COMMANDS)
    states = peer.create_publisher(JointState, JOINT_STATES, 10)
    wait_until(lambda: states.get_subscription_count() == 1)
    stamps = iter(range(10**6))

    def ended() -> bool:
        states.publish(_state(next(stamps), [0.0, 0.7]))
        return process.popen.poll() is not None

    wait_until(ended)
    assert process.wait() == 2
    assert "joint 'joint2': start position outside the safety set: 0.7 rad against 0.5 rad" in \
        process.text
    assert 'Traceback' not in process.text
    assert commands == []


def test_a_smooth_start_may_begin_anywhere_inside_the_safety_set_and_nowhere_else(rig) -> None:
    rig = rig(reference__smooth_start=1.0)
    assert rig.node.commands.someone_drives()
    with pytest.raises(SetViolation, match="'joint2': start position outside the safety set: 2.3"):
        rig.node.on_joint_states(serialize_message(_state(0.0, [0.0, 2.3])), {})
    assert (rig.node.active, rig.node.commands.claimed, rig.torques) == (False, False, [])


def test_a_performance_set_that_exceeds_the_safety_set_is_refused(graph) -> None:
    with pytest.raises(SetViolation, match="joint 'joint2': .*exceeds.*above: 2.25 .* 2.2 rad"):
        graph.make(ControllerNode, **{**TASK, 'performance__upper': [0.2, 0.25]})
    with pytest.raises(SetViolation, match="joint 'joint1': .*below: -1.18 .* -1.17 rad"):
        graph.make(ControllerNode, **{**TASK, 'performance__lower': [-0.18, -0.17]})


def test_a_smooth_start_takes_the_posture_it_finds(rig) -> None:
    rig = rig(reference__smooth_start=1.0)
    rig.answer(_state(0.0, [0.5, 1.0], [0.0, 0.0]))  # 0.5 and 1 rad away from the reference
    np.testing.assert_allclose(rig.node.output.e1, 0.0, atol=1e-12)


def test_nothing_is_answered_before_somebody_listens(graph, wait_until) -> None:
    node = graph.make(ControllerNode, **TASK)
    node.on_joint_states(serialize_message(_state(0.0)), {})
    assert (node.output, node.active, node.count_publishers(COMMANDS)) == (None, False, 0)
    heard = graph.peer().listen(Float64MultiArray, COMMANDS)

    def answered() -> bool:
        node.on_joint_states(serialize_message(_state(700.0)), {})
        return node.output is not None

    wait_until(answered)
    assert node.active
    wait_until(lambda: len(heard) == 1)
    np.testing.assert_allclose(node.output.reference.position, [0.0, 2.0], atol=1e-12)


def test_the_first_answer_does_not_wait_for_the_logger(rig, monkeypatch) -> None:
    # As in a fresh process: rclpy's logger then reads every module's file, 50 to 110 ms.
    monkeypatch.setattr(inspect, 'modulesbyfile', {})
    monkeypatch.setattr(inspect, '_filesbymodname', {})
    rig = rig()
    data, times = serialize_message(_state(0.0)), []
    while rig.node.output is None:
        begin = time.thread_time()  # of this thread alone: other jobs do not count
        rig.node.on_joint_states(data, {})
        times.append(time.thread_time() - begin)
    assert max(times) < 0.03


def test_a_running_node_ends_with_a_zero_torque(graph, wait_until) -> None:
    rig = _Rig(graph, wait_until)
    states = rig.peer.create_publisher(JointState, JOINT_STATES, 10)
    wait_until(lambda: states.get_subscription_count() == 1)
    runner = graph.run(rig.node)
    rig.answered_over_dds(states, _state(0.0))
    wait_until(lambda: len(rig.torques) == 1)
    assert rig.torques[0].any()
    assert runner.end() == 0
    wait_until(lambda: len(rig.torques) == 2)
    np.testing.assert_array_equal(rig.torques[-1], 0.0)


def test_a_node_that_never_answered_sends_nothing_at_its_end(graph, wait_until) -> None:
    rig = _Rig(graph, wait_until)
    runner = graph.run(rig.node)
    assert runner.end() == 0
    assert rig.torques == []


def test_when_states_stop_one_zero_torque_is_sent_and_the_next_state_resumes(graph,
                                                                            wait_until) -> None:
    rig = _Rig(graph, wait_until, state_timeout=0.2)
    states = rig.peer.create_publisher(JointState, JOINT_STATES, 10)
    wait_until(lambda: states.get_subscription_count() == 1)
    graph.run(rig.node)
    began = time.time_ns()
    rig.answered_over_dds(states, _state(0.0))
    wait_until(lambda: len(rig.torques) == 2)
    assert rig.torques[0].any()
    np.testing.assert_array_equal(rig.torques[1], 0.0)
    assert 'lost' in rig.node.status()[1]
    assert rig.node.faults.last == 'no joint state for 0.2 s: zero torque'
    states.publish(_state(1.0))
    wait_until(lambda: len(rig.torques) == 4)
    assert rig.torques[2].any()
    np.testing.assert_array_equal(rig.torques[3], 0.0)
    zero_sent = rig.sent[COMMANDS][1][1]['source_timestamp']
    assert zero_sent - began >= 0.2e9  # since the state, however long its answer took


def test_of_a_backlog_only_the_newest_state_is_answered(rig, wait_until) -> None:
    rig = rig()
    rig.answer(_state(-1.0))
    peer = rig.peer
    echo = peer.listen(JointState, JOINT_STATES)
    states = peer.create_publisher(JointState, JOINT_STATES, 50)
    wait_until(lambda: states.get_subscription_count() == 2)
    rig.node.spin_data(0.0)
    for k in range(9):
        states.publish(_state(k))
    wait_until(lambda: len(echo) == 9)
    rig.node.spin_data(1.0)
    assert rig.node.statistics.samples == 2
    assert rig.node.motion.gate.last_ns == 10**12 + 8_000_000
    assert rig.node.statistics.superseded == 8
    wait_until(lambda: len(rig.torques) == 2)


def test_gains_set_while_running_act_on_the_next_state(rig) -> None:
    rig = rig()
    rig.answer(_state(0.0))
    assert rig.node.set_parameters([Parameter('k2', value=[90.0, 3.0])])[0].successful
    law = Controller(TwoLinkArm(), _settings(rig, k2=[90.0, 3.0]), start=np.array(Q))
    np.testing.assert_allclose(
        rig.answer(_state(1.0)),
        law.update(1e-3, np.array(Q), np.array(QD), np.array(TASK['initial_estimate'])).torque,
        rtol=1e-9)


def test_one_reason_for_drops_does_not_silence_another(rig, capfd) -> None:
    rig = rig()
    for _ in range(50):
        rig.node.on_joint_states(b'', {})
    rig.node.on_joint_states(serialize_message(_state(0.0, [math.nan, 2.0])), {})
    log = capfd.readouterr().err
    assert log.count('unusable joint state') == 1
    assert "non-finite joint state: joint 'joint1': nan rad, 0.4 rad/s (1 so far)" in log


def test_of_several_states_that_wait_the_newest_usable_one_is_answered(rig) -> None:
    rig = rig()
    rig.answer(_state(0.0))
    others = _state(3.0, [0.01], [0.0], names=['gripper'], effort=[0.0])
    assert rig.node.on_joint_states(serialize_message(others), {}) is False
    assert rig.node.on_joint_states(serialize_message(_state(2.0)), {}) is True


def test_a_newest_state_that_cannot_be_answered_lets_no_older_one_through(rig) -> None:
    rig = rig()
    rig.answer(_state(0.0))
    answered = rig.node.statistics.samples
    for newest in (_state(3.0, [math.nan, 2.0]), _state(0.0), _state(1e7)):
        # True: it was this source's, so that the channel offers no older one.
        assert rig.node.on_joint_states(serialize_message(newest), {}) is True
    assert rig.node.statistics.samples == answered


def test_a_trajectory_that_took_long_to_compute_begins_later(rig, monkeypatch) -> None:
    rig = rig(state_timeout=10.0)
    rig.answer(_state(0.0))
    begins = []

    def slow(points, controller, t):
        begins.append(t)
        if len(begins) == 1:
            rig.answer(_state(200.0))  # past the moment that was meant
        return way_through(points, controller, t)

    monkeypatch.setattr(trajectory_input, 'way_through', slow)
    rig.node.inputs.trajectories.receive(_trajectory([1.0, -0.5]))
    np.testing.assert_allclose(begins, [0.1, 0.6])
    assert rig.node.faults.drops == {}
    np.testing.assert_allclose(rig.node.motion.controller.reference.at(2.0).position, [-0.5, 1.0])


@pytest.mark.parametrize('of_our_kind', [True, False])
def test_a_controller_gives_way_to_another_that_appears_at_its_start_not_to_any_other_sender(
        rig, wait_until, of_our_kind) -> None:
    rig = rig(state_timeout=60.0)
    rig.answer(_state(0.0))
    others = [rig.peer.create_publisher(Float64MultiArray, COMMANDS, 10)]
    if of_our_kind:
        others.append(rig.peer.create_publisher(JointState, ADAPTATION_TERM, 10))
    wait_until(lambda: all(rig.node.count_publishers(publisher.topic_name) == 2
                           for publisher in others))
    late = rig.node.commands.claimed_at + GIVE_WAY
    rig.node.look_around(late)  # it has begun long ago: the other one is to give way
    assert rig.node.active
    rig.node.look_around(late - 0.01)
    assert rig.node.active is not of_our_kind
    assert ('gives way' in rig.node.faults.last) is of_our_kind
    if of_our_kind:
        wait_until(lambda: np.array_equal(rig.torques[-1], [0.0, 0.0]), what='zero torque')


@pytest.mark.parametrize('recorded', [False, True])
def test_where_nobody_listens_any_longer_the_torque_counts_as_lost(
        graph, rig, wait_until, recorded) -> None:
    rig = rig(state_timeout=60.0)
    rig.answer(_state(0.0))
    if recorded:  # which moves no arm
        recorder = graph.add(Node('recorder', context=graph.context))
        recorder.create_subscription(Float64MultiArray, COMMANDS, lambda _: None, 10)
    rig.node.look_around(time.monotonic())
    assert not rig.node.motion.lost
    for subscription in list(rig.peer.subscriptions):
        rig.peer.destroy_subscription(subscription)
    wait_until(lambda: rig.node.count_subscribers(COMMANDS) == int(recorded)
               and not rig.node.commands.someone_drives())
    rig.node.look_around(time.monotonic())
    assert rig.node.motion.lost
    assert 'nobody listens' in rig.node.faults.last
    assert rig.node.status()[:2] == (DiagnosticStatus.ERROR, 'nobody listens: zero torque')


def test_a_clock_that_is_set_back_while_states_come_is_followed_once_they_count_as_lost(
        graph, wait_until) -> None:
    rig = _Rig(graph, wait_until, state_timeout=0.1)
    states = rig.peer.create_publisher(JointState, JOINT_STATES, 10)
    wait_until(lambda: states.get_subscription_count() == 1)
    graph.run(rig.node)
    rig.answered_over_dds(states, _state(0.0))
    stamps = iter(range(-500_000, 0))  # 500 s back, and time goes on from there
    samples = rig.node.statistics.samples

    def followed() -> bool:
        states.publish(_state(next(stamps), [-0.6, 0.4], [0.1, 0.0]))
        return rig.node.statistics.samples > samples + 3

    wait_until(followed)
    assert rig.node.faults.drops['joint state out of order'] > 0
    assert 'no joint state for 0.1 s' in rig.node.faults.last
    np.testing.assert_allclose(rig.node.output.reference.position, [-0.6, 0.4], atol=1e-3)
    assert sum(not torque.any() for torque in rig.torques) == 1


def test_the_torque_rises_no_faster_than_its_limit_the_first_interval_counting_1_ms(rig) -> None:
    rig = rig(torque_rate_limit=[10000.0, 2000.0], k2=[5000.0, 5000.0], loop__unstable='warn')
    rate = np.array([10000.0, 2000.0])
    first = rig.answer(_state(0.0, qd=[0.6, -0.6]))
    np.testing.assert_allclose(np.abs(first), rate * 1e-3, rtol=1e-12)
    assert rig.node.output.saturated.all()
    second = rig.answer(_state(2.5, qd=[0.6, -0.6]))
    np.testing.assert_allclose(np.abs(second - first), rate * 2.5e-3, rtol=1e-12)
    third = rig.answer(_state(3.5, qd=[-0.6, 0.6]))
    np.testing.assert_allclose(np.abs(third - second), rate * 1e-3, rtol=1e-12)


def test_on_violation_stop_brings_the_torque_to_zero_over_the_ramp_and_deactivates(
        rig, wait_until) -> None:
    rig = rig(on_violation='stop', ramp_time=0.05)
    rig.answer(_state(0.0))
    outside = _state(1.0, [0.25, 1.98])
    rig.node.on_joint_states(serialize_message(outside), {})
    wait_until(lambda: len(rig.torques) > 2 and not rig.torques[-1].any(), what='the ramp')
    ramp = np.array(rig.torques[1:])
    np.testing.assert_allclose(ramp, np.outer(np.linspace(1.0, 0.0, 51), ramp[0]), atol=1e-9)
    times = [info['source_timestamp'] for _, info in rig.sent[COMMANDS]]
    assert times[-1] - times[1] >= 0.045e9
    assert (rig.node.active, rig.node.commands.claimed, rig.node.wants_activation) == (
        False, False, False)
    wait_until(lambda: rig.node.count_publishers(COMMANDS) == 0, what='the topic given back')
    rig.node.on_joint_states(serialize_message(_state(2.0)), {})
    assert rig.node.statistics.samples == 2
    assert "'joint1' has left its performance set" in rig.node.faults.last
    assert rig.node.status()[:2] == (b'\x01', 'inactive')


def test_a_set_that_was_left_for_one_sample_stays_in_the_diagnostics(rig) -> None:
    rig = rig(monitor_decimation=100)
    rig.answer(_state(0.0))
    rig.answer(_state(1.0, [0.25, 1.98]))
    rig.answer(_state(2.0))
    level, text, values = rig.node.status()
    assert level == b'\x02'
    assert all(part in text for part in ("'joint1'", 'performance', '0.2 rad'))
    assert values['samples outside a set'] == 1
    assert rig.node.active
    assert "'joint1' has left its performance set: 0.24" in rig.node.faults.last


def test_a_recorder_that_listens_does_not_begin_the_motion(graph, wait_until) -> None:
    node = graph.make(ControllerNode, **TASK)
    recorder = graph.add(Node('recorder', context=graph.context))
    recorder.create_subscription(Float64MultiArray, COMMANDS, lambda _: None, 10)
    wait_until(lambda: node.get_subscriptions_info_by_topic(COMMANDS))
    node.on_joint_states(serialize_message(_state(0.0)), {})
    assert (node.output, node.active, node.commands.claimed) == (None, False, False)


def test_theorem_2_is_stated_at_the_start_from_bounds(rig, wait_until) -> None:
    rig = rig(guarantee__mode='bound', guarantee__theta_error=0.5, guarantee__mass=[0.15, 5.0])
    heard = rig.peer.listen(JointState, GUARANTEE)
    wait_until(lambda: rig.node.count_subscribers(GUARANTEE))
    rig.answer(_state(0.0))
    wait_until(lambda: heard, what='the guarantee')
    message = deserialize_message(heard[0][0], JointState)
    guaranteed = dict(zip(message.name, message.position))
    e2 = np.array(rig.node.output.e2)
    output = rig.node.output
    value = (barrier(output.e1, output.bound, np.ones(2)) + 0.5 * 5.0 * e2 @ e2 + 0.5 * 0.5**2)
    part = math.sqrt(2 * value / (1 + 2 * value))
    assert guaranteed['V0'] == pytest.approx(value)
    assert guaranteed['joint1.error_upper'] == pytest.approx(0.2 * part)
    assert guaranteed['joint2.error_lower'] == pytest.approx(-0.17 * part)
    assert guaranteed['joint2.output_upper'] == pytest.approx(2.0 + 0.2 * part)


LEFT = 'left what Theorem 2 guarantees at [s]'


@pytest.mark.parametrize(('change', 'still'), [
    (None, True), (('torque_limit', [150.0]), True), (('k1', [900.0]), False),
    (('k1', None), True),  # the value that it has
    (('performance.upper', [0.19]), False), (('reference.joint1.offset', 0.001), False)])
def test_a_live_change_of_what_theorem_2_rests_on_takes_the_guarantee_back(rig, change,
                                                                          still) -> None:
    rig = rig(guarantee__mode='bound', guarantee__theta_error=0.0, guarantee__mass=[0.15, 5.0],
              state_timeout=60.0, safety__lower=[-3.0], safety__upper=[3.0])
    rig.answer(_state(0.0))
    if change is not None:
        name, value = change
        value = list(rig.node.get_parameter(name).value) if value is None else value
        result = rig.node.set_parameters([Parameter(name, value=value)])[0]
        assert result.successful, result.reason
    rig.answer(_state(1.0, [0.18, 2.0]))  # inside the performance set, beyond the guarantee
    assert (LEFT in rig.node.status()[2]) is still


def _trajectory(positions, seconds=1.0, names=('joint2', 'joint1'), **fields) -> JointTrajectory:
    point = JointTrajectoryPoint(positions=[float(x) for x in positions], **fields)
    point.time_from_start.sec, point.time_from_start.nanosec = divmod(int(seconds * 1e9), 10**9)
    return JointTrajectory(joint_names=list(names), points=[point])


def test_a_trajectory_replaces_the_reference_smoothly_and_by_joint_name(rig) -> None:
    rig = rig(state_timeout=10.0)
    rig.answer(_state(0.0))
    rig.node.inputs.trajectories.receive(_trajectory([1.0, -0.5]))
    before = rig.node.motion.controller.reference.at(0.1)
    rig.answer(_state(50.0))
    for part, want in zip(rig.node.motion.controller.reference.at(0.1), before):
        np.testing.assert_allclose(part, want, atol=1e-12)
    rig.answer(_state(1100.0, [-0.5, 1.0], [0.0, 0.0]))
    np.testing.assert_allclose(rig.node.output.reference.position, [-0.5, 1.0])
    np.testing.assert_allclose(rig.node.output.e1, 0.0, atol=1e-12)
    assert rig.node.faults.drops == {}


def _from_where_it_is(start, *goals) -> JointTrajectory:
    """Return what MoveIt sends: the first point is at 0 s, where the arm is believed to be."""
    message = _trajectory(start, seconds=0.0)
    for seconds, goal in enumerate(goals or ([1.0, -0.5],), start=1):
        message.points += _trajectory(goal, seconds=seconds).points
    return message


def test_a_first_point_at_0_s_is_checked_and_not_gone_through(rig) -> None:
    rig = rig(state_timeout=10.0)
    rig.answer(_state(0.0))
    wanted = rig.node.motion.controller.reference.at(0.1).position
    rig.node.inputs.trajectories.receive(_from_where_it_is(wanted[::-1] + 0.1, [1.0, -0.5]))
    assert rig.node.faults.drops == {}
    reference = rig.node.motion.controller.reference
    np.testing.assert_allclose(reference.at(0.1).position, wanted, atol=1e-12)
    np.testing.assert_allclose(reference.at(1.1).position, [-0.5, 1.0], atol=1e-12)


@pytest.mark.parametrize(('message', 'what'), [
    (_trajectory([1.0, -0.5], names=('joint1', 'joint3')), 'joint3'),
    (_trajectory([1.0]), '2 values'),
    (_trajectory([1.0, -0.5], seconds=0.0), 'ascending'),
    (_from_where_it_is([1.0, -0.5]), 'first point, at 0 s, outside the performance set'),
    (_trajectory([1.0, -0.5], velocities=[0.1, 0.0]), 'at rest'),
    (_trajectory([math.nan, -0.5]), 'finite'),
    (_trajectory([1.0, 1.1]), "'joint1'"),
    (JointTrajectory(joint_names=['joint1', 'joint2']), 'one point'),
])
def test_a_trajectory_that_cannot_be_followed_is_dropped_whole(rig, capfd, message, what) -> None:
    rig = rig()
    rig.answer(_state(0.0))
    reference = rig.node.motion.controller.reference
    rig.node.inputs.trajectories.receive(message)
    assert rig.node.faults.drops == {'unusable trajectory': 1}
    assert what in capfd.readouterr().err
    rig.answer(_state(1.0))
    assert rig.node.motion.controller.reference is reference


def test_settings_beyond_the_limits_of_the_arm_are_a_warning_with_numbers(
        graph, tmp_path, pair_urdf, capfd) -> None:
    urdf = tmp_path / 'pair.urdf'
    urdf.write_text(pair_urdf, encoding='utf-8')
    graph.make(ControllerNode, arm='urdf', urdf=str(urdf), joints=['shoulder', 'elbow'],
               safety__lower=[-1.9, -2.1], safety__upper=[2.0, 2.0], torque_limit=[60.0, 40.0])
    log = capfd.readouterr().err
    assert ("joint 'elbow': the safety set -2.1 .. 2 rad goes beyond the limits of the arm, "
            '-2 .. 2 rad') in log
    assert "joint 'shoulder': torque_limit 60 N·m is above the limit of the arm, 50 N·m" in log
    assert log.count('of the arm') == 2


LEARNS = {'safety_filter': 'limits', 'limits__learn': True, 'limits__velocity': [20.0, 20.0],
          'limits__prior__mass_error': 0.1, 'limits__prior__friction': [8.0, 2.0]}


def _bounds(part: float, label: str = 'identifier#01234567', **without: float) -> bytes:
    """Return intervals with ``part`` of the half widths of the prior, as an identifier sends."""
    prior = prior_of(TwoLinkArm(), mass_error=0.1, friction=np.array([8.0, 2.0]))
    causes = [cause for cause in prior.causes if cause.name not in without]
    message = JointState(name=[f'prior.{cause.name}' for cause in causes],
                         position=[cause.middle for cause in causes],
                         velocity=[part * cause.half for cause in causes])
    message.header.frame_id = label
    return serialize_message(message)


def test_what_the_identifier_is_sure_of_narrows_the_safety_filter_of_a_motion(rig) -> None:
    rig = rig(**LEARNS)
    rig.answer(_state(0.0))
    sets, motion = rig.node.inputs.sets, rig.node.motion
    assert motion.controller.safety_filter.model.part == 1.0
    assert sets.receive(_bounds(0.25), {})
    assert motion.controller.safety_filter.model.part == pytest.approx(0.25)
    rig.answer(_state(1.0))
    assert 'parameter set' in rig.node.status()[2]
    assert rig.node.status()[2]['parameter set'].startswith('25 %')


@pytest.mark.parametrize(('data', 'reason'), [
    (_bounds(0.25, p1=1.0), 'unusable parameter set'),
    (_bounds(math.nan), 'unusable parameter set'), (_bounds(-0.1), 'unusable parameter set'),
    (_bounds(0.25, 'stranger#76543210'), 'parameter set of a second publisher')])
def test_intervals_that_cannot_be_used_or_are_of_another_source_narrow_nothing(
        rig, data, reason) -> None:
    rig = rig(**LEARNS)
    rig.answer(_state(0.0))
    sets, motion = rig.node.inputs.sets, rig.node.motion
    assert sets.receive(_bounds(0.5), {})
    assert not sets.receive(data, {})
    assert rig.node.faults.drops == {reason: 1}
    assert motion.controller.safety_filter.model.part == pytest.approx(0.5)


def test_intervals_are_believed_for_learn_timeout_and_then_it_is_the_prior_again(rig) -> None:
    rig = rig(**LEARNS, limits__learn_timeout=0.01)
    rig.answer(_state(0.0))
    motion = rig.node.motion
    assert rig.node.inputs.sets.receive(_bounds(0.25), {})
    rig.answer(_state(9.0))
    assert motion.controller.safety_filter.model.part == pytest.approx(0.25)
    rig.answer(_state(11.0))
    assert motion.controller.safety_filter.model.part == 1.0


def test_a_controller_whose_filter_does_not_learn_does_not_listen_to_the_set(rig) -> None:
    assert rig().node.count_subscribers(PARAMETER_SET) == 0
    assert rig(namespace='/other', **LEARNS).node.count_subscribers(PARAMETER_SET) == 1


def test_in_lockstep_nothing_is_learned_from_another_process(graph) -> None:
    with pytest.raises(ParameterError, match=r'controller\.limits\.learn.*lockstep'):
        graph.make(ControllerNode, use_sim_time=True, autostart=True, **{**TASK, **LEARNS})
