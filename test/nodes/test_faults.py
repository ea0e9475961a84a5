# SPDX-License-Identifier: Apache-2.0
"""What goes wrong is injected into the real nodes; docs/safety.md says which test proves what."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import functools
import itertools
import math
from pathlib import Path
import random
import shutil
import signal
import threading
import time
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
import yaml

import adaptive_blf_control
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.bags.reader import Bag, read_bag
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.errors import BagError, SetViolation
from adaptive_blf_control.messages.cdr import (
    decode_float64_array,
    decode_joint_state,
    Float64MultiArrayCodec,
)
from adaptive_blf_control.messages.topics import (
    BARRIER,
    COMMANDS,
    JOINT_STATES,
    REFERENCE,
    THETA_HAT,
    TRACKING_ERROR,
)
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.command_topic import GIVE_WAY
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from patience import PATIENCE

LIMIT = [200.0, 100.0]
TASK = {
    'k1': [1000.0, 800.0], 'k2': [60.0, 8.0], 'torque_limit': LIMIT,
    'initial_estimate': [3.0, 0.2, 0.3, 5.0, 1.0],
    'safety__lower': [-2.0, -2.0], 'safety__upper': [2.0, 2.0],
    'performance__lower': [-0.17], 'performance__upper': [0.2],
    'reference__joint1__amplitude': [0.5], 'reference__smooth_start': 0.0,
    'state_timeout': 0.3, 'reference__resume_time': 0.5,
}
EPOCH = 1_700_000_000 * 10**9
PARAMETERS = TwoLinkArm().parameters
MAGIC = b'\x89MCAP0\r\n'


def _torques(heard: list) -> np.ndarray:
    return np.array([decode_float64_array(data) for data, _ in list(heard)])


def _statuses(heard: list, node: str) -> list[DiagnosticStatus]:
    found = (deserialize_message(data, DiagnosticArray).status[0] for data, _ in list(heard))
    return [status for status in found if status.name.startswith(f'{node}:')]


def _says(heard: list, node: str, level: bytes, *words: str) -> bool:
    """Whether a diagnostic of ``node`` has this level and all of these words."""
    return any(status.level == level and all(word in status.message for word in words)
               for status in _statuses(heard, node))


class _Arm:
    """Joint states as a driver sends them, from what the test says; the torques that answer."""

    def __init__(self, graph, wait_until, **parameters: Any) -> None:
        self.node = graph.make(ControllerNode, **{**TASK, **parameters})
        peer = self.peer = graph.peer()
        self.commands = peer.listen(Float64MultiArray, COMMANDS)
        self.errors = peer.listen(JointState, TRACKING_ERROR)
        self.references = peer.listen(JointState, REFERENCE)
        self.diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
        self.stamp_ns = EPOCH
        self._wait_until = wait_until
        self._states = peer.create_publisher(JointState, JOINT_STATES, 10)
        wait_until(lambda: self._states.get_subscription_count() == 1
                   and self.node.count_subscribers(COMMANDS) == 1
                   and self.node.count_subscribers(TRACKING_ERROR) == 1, what='the match')
        self.runner = graph.run(self.node)

    def publish(self, q, qd=(0.0, 0.0), ms: float = 5.0) -> None:
        """Publish a state ``ms`` after the last one."""
        self.stamp_ns += round(ms * 1e6)
        message = JointState(name=['joint1', 'joint2'], position=[float(x) for x in q],
                             velocity=[float(x) for x in qd])
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.stamp_ns, 10**9)
        self._states.publish(message)

    def step(self, q, qd=(0.0, 0.0), ms: float = 5.0) -> np.ndarray:
        """Publish a state and return the torque that answers it."""
        before = len(self.commands)
        self.publish(q, qd, ms)
        self._wait_until(lambda: len(self.commands) > before, what='an answer')
        return self.last

    def begin(self, q) -> None:
        """Publish states until the first is answered."""
        def answered() -> bool:
            self.publish(q)
            return bool(self.commands)

        self._wait_until(answered, what='the first answer')

    @property
    def last(self) -> np.ndarray:
        return decode_float64_array(self.commands[-1][0])

    def until_zero(self) -> None:
        """Wait until the torque sent last is zero."""
        self._wait_until(lambda: not self.last.any(), what='a zero torque')


@pytest.fixture
def arm(graph, wait_until) -> Callable[..., _Arm]:
    """Return ``arm(**parameters of the controller)``."""
    return lambda **parameters: _Arm(graph, wait_until, **parameters)


def test_after_a_clock_that_jumps_back_the_torque_is_zero_and_the_motion_begins_again(
        arm, wait_until) -> None:
    arm = arm(reference__joint2__offset=0.4)
    arm.begin([0.0, 0.4])
    for _ in range(20):
        arm.step([0.01, 0.41])
    assert arm.last.any()
    posture = [-0.9, -0.6]  # nowhere near the reference any more
    arm.stamp_ns -= 3600 * 10**9
    sent = len(arm.commands)

    def begins_again() -> bool:
        arm.publish(posture)
        return len(arm.commands) > sent + 3

    wait_until(begins_again, what='an answer on the new clock')
    torques = _torques(arm.commands)[sent:]
    assert not torques[0].any()  # the watchdog's, before anything on the new clock
    assert np.abs(torques[1]).max() < 1.0
    times = [info['source_timestamp'] for _, info in arm.commands[sent - 1:sent + 1]]
    assert 0.2e9 < times[1] - times[0] < 1.5e9  # state_timeout, and what a busy machine adds
    assert arm.node.faults.drops['joint state out of order'] > 0
    wait_until(lambda: decode_joint_state(arm.errors[-1][0]).stamp_ns < EPOCH - 10**12)
    first = next(error for error in (decode_joint_state(data) for data, _ in arm.errors)
                 if error.stamp_ns < EPOCH - 10**12)
    np.testing.assert_allclose(first.position, 0.0, atol=1e-12)


def test_after_a_clock_that_jumps_ahead_the_motion_begins_again_with_the_second_state(
        arm, wait_until) -> None:
    arm = arm(state_timeout=5.0)
    arm.begin([0.0, 0.0])
    arm.stamp_ns += 3600 * 10**9
    first_ns = arm.stamp_ns

    def seen() -> bool:
        arm.publish([0.3, 0.1], ms=0.0)
        return 'stamp jumps ahead' in arm.node.faults.drops

    def anew() -> list:
        arm.publish([0.3, 0.1])
        return [error for error in (decode_joint_state(data) for data, _ in arm.errors)
                if error.stamp_ns >= first_ns]

    wait_until(seen)
    begun = wait_until(anew, what='an answer on the new clock')
    assert begun[0].stamp_ns > first_ns
    np.testing.assert_allclose(begun[0].position, 0.0, atol=1e-12)


def test_a_motion_that_cannot_begin_again_ends_with_a_zero_torque(arm, wait_until) -> None:
    arm = arm(state_timeout=5.0)
    arm.begin([0.0, 0.0])
    assert arm.step([0.02, 0.1]).any()
    arm.stamp_ns += 20 * 10**9  # another clock, and an arm beyond its safety set

    def ended() -> bool:
        arm.publish([2.5, 0.0])
        return not arm.runner.thread.is_alive()

    wait_until(ended)
    with pytest.raises(SetViolation, match="'joint1'"):
        arm.runner.join()
    arm.until_zero()


@pytest.mark.parametrize(('joint', 'sign', 'bound'), [(0, 1, 0.2), (0, -1, 0.17), (1, 1, 0.2)])
def test_at_and_beyond_its_bound_an_error_is_pushed_back_and_named(
        arm, wait_until, joint, sign, bound) -> None:
    arm = arm(reference__joint1__amplitude=[0.0], state_timeout=5.0, torque_rate_limit=[1e6])
    arm.begin([0.0, 0.0])
    for part in (0.99, 1.0 - 1e-12, 1.0, 1.0 + 1e-12, 1.5, 9.0, 1e3, 1e200):
        q = np.zeros(2)
        q[joint] = sign * bound * part
        for _ in range(5):  # the torque rises at a limited rate
            torque = arm.step(q, ms=10.0)
            assert np.isfinite(torque).all()
            assert (np.abs(torque) <= LIMIT).all()
        assert sign * torque[joint] < -50.0, part
    wait_until(lambda: _says(arm.diagnostics, 'controller', DiagnosticStatus.ERROR,
                             f"joint 'joint{joint + 1}' has left", 'performance set', 'margin'))
    q[joint] = 0.0
    arm.step(q, ms=10.0)
    torque = arm.step(q, ms=50.0)
    assert np.abs(torque).max() < 1.0  # back inside: as if nothing had been


def test_with_stop_a_set_that_is_left_deactivates_the_controller_at_zero_torque(
        arm, wait_until) -> None:
    arm = arm(on_violation='stop', ramp_time=0.05, state_timeout=5.0)
    arm.begin([0.0, 0.0])
    arm.publish([0.3, 0.0])
    wait_until(lambda: not arm.node.active, what='deactivation')
    arm.until_zero()
    wait_until(lambda: _says(arm.diagnostics, 'controller', DiagnosticStatus.WARN, 'inactive'))
    sent = len(arm.commands)

    def heard() -> bool:
        arm.publish([0.0, 0.0])
        return arm.node.motion.q[0] == 0.0

    wait_until(heard, what='a state while inactive')
    assert len(arm.commands) == sent
    assert 'joint1' in arm.node.faults.last


def test_late_states_cost_the_torque_and_the_next_one_brings_it_back(arm, wait_until) -> None:
    arm = arm()
    arm.begin([0.0, 0.0])
    assert arm.step([0.02, 0.1]).any()
    arm.until_zero()
    wait_until(lambda: _says(arm.diagnostics, 'controller', DiagnosticStatus.ERROR,
                             'joint states lost'))
    sent, anew = len(arm.commands), len(arm.errors)

    def pushes() -> bool:
        arm.publish([0.03, 0.12], [0.2, 0.2])
        return bool(_torques(arm.commands)[sent:].any())

    wait_until(pushes)
    first = wait_until(lambda: arm.errors[anew:])[0]
    np.testing.assert_allclose(decode_joint_state(first[0]).position, 0.0, atol=1e-12)


@pytest.fixture
def loop(graph, wait_until) -> Iterator[tuple]:
    """Run driver and controller at 200 Hz in threads; return both, a peer and what it hears."""
    driver = graph.make(ArmDriver, rate=200.0, torque_limit=LIMIT, command_timeout=5.0)
    controller = graph.make(ControllerNode, **{**TASK, 'state_timeout': 5.0})
    peer = graph.peer()
    states = peer.listen(JointState, JOINT_STATES, 5000)
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    for node in (controller, driver):
        graph.run(node)
    wait_until(lambda: driver.started and controller.statistics.samples > 20, what='the motion')
    return driver, controller, peer, states, diagnostics


def test_a_publisher_that_shouts_commands_is_refused_and_named(loop, wait_until) -> None:
    driver, controller, peer, states, diagnostics = loop
    wait_until(lambda: driver.commands.source.number > 300
               and time.monotonic() - controller.commands.claimed_at > GIVE_WAY,
               what='the arm is taken')
    stranger = peer.create_publisher(Float64MultiArray, COMMANDS, 100)
    wait_until(lambda: stranger.get_subscription_count() == 1)
    begin, sent = len(states), itertools.count(1)

    def refused() -> bool:
        number = next(sent)  # far below that of the controller, whatever is lost on the way
        wait_until(lambda: driver.commands.source.number > number + 200,
                   'the controller to go on')
        stranger.publish(Float64MultiArray(data=[-77.0, 77.0]))
        return driver.faults.drops.get('command of a second publisher', 0) >= 100

    wait_until(refused, 'a hundred refused commands')
    seen = len(states)
    wait_until(lambda: len(states) > seen + 20)
    effort = np.array([decode_joint_state(data).effort for data, _ in states[begin:]])
    assert np.abs(effort[:, 1]).max() < 70.0
    wait_until(lambda: _says(diagnostics, 'arm_driver', DiagnosticStatus.ERROR, 'several',
                             '/peer'))
    wait_until(lambda: _says(diagnostics, 'controller', DiagnosticStatus.ERROR, 'another node'))
    assert controller.active


def test_an_estimate_beyond_its_limit_does_not_reach_the_torque(loop, wait_until) -> None:
    driver, controller, peer, states, _ = loop
    estimates = peer.create_publisher(JointState, THETA_HAT, 100)
    wait_until(lambda: estimates.get_subscription_count() == 1)
    kept = controller.theta
    for bad in (1e9, math.nan, -math.inf, 1e300):
        reasons = sum(controller.faults.drops.values())
        estimates.publish(JointState(name=list(PARAMETERS), position=[bad] * 5))
        wait_until(lambda reasons=reasons: sum(controller.faults.drops.values()) > reasons)
    begin = len(states)
    wait_until(lambda: len(states) > begin + 20)
    assert controller.theta is kept
    assert {'estimate beyond its limit', 'non-finite estimate'} == set(controller.faults.drops)


class _Counts(NamedTuple):
    received: int
    written: int
    dropped: int


def _counts(status: DiagnosticStatus) -> _Counts:
    """Return what the recorder says of all topics together."""
    values = {value.key: value.value for value in status.values}
    return _Counts(*(sum(int(value) for key, value in values.items() if key.endswith(what))
                     for what in (' received', ' written', 'dropped: disk')))


def test_a_full_disk_at_the_recorder_is_reported_and_does_not_disturb_the_motion(
        processes, graph_of, wait_until, tmp_path) -> None:
    graph = graph_of(processes.domain)
    recorder = processes.start('recorder', '--ros-args', '-p', f'bag:={tmp_path / "bag"}', '-p',
                               'flush_period:=0.05', largest_file=300_000)
    driver = graph.make(ArmDriver, rate=200.0, torque_limit=LIMIT, wait_for_subscribers=2)
    controller = graph.make(ControllerNode, **{**TASK, 'state_timeout': 5.0})
    diagnostics = graph.peer().listen(DiagnosticArray, '/diagnostics')
    for node in (controller, driver):
        graph.run(node)
    wait_until(lambda: 'recording stopped, what was written is kept' in recorder.text)
    wait_until(lambda: _says(diagnostics, 'recorder', DiagnosticStatus.ERROR, 'cannot be written'))
    samples = controller.statistics.samples
    wait_until(lambda: controller.statistics.samples > samples + 100)
    assert controller.active
    known = len(_statuses(diagnostics, 'recorder'))
    wait_until(lambda: len(_statuses(diagnostics, 'recorder')) >= known + 2)
    before, after = (_counts(status) for status in _statuses(diagnostics, 'recorder')[-2:])
    assert before.received > before.written > 10
    # Counted one after the other while messages go on arriving.
    assert before.received - before.written <= before.dropped <= after.received - after.written
    assert recorder.signal(signal.SIGTERM) == 1
    assert read_bag(tmp_path / 'bag').topics['/joint_states'].count > 10


def _moving_state(k: int) -> JointState:
    t = 1e-3 * k
    message = JointState(name=['joint1', 'joint2'], position=[math.sin(9 * t), math.cos(7 * t)],
                         velocity=[9 * math.cos(9 * t), -7 * math.sin(7 * t)], effort=[1.0, 2.0])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(EPOCH + k * 10**6, 10**9)
    return message


def test_an_estimate_that_cannot_be_written_is_a_fault_and_learning_goes_on(
        graph, wait_until, tmp_path) -> None:
    folder = tmp_path / 'folder'
    folder.write_text('not a folder, so that root cannot write here either')
    path = folder / 'theta_hat.yaml'
    node = graph.make(IdentifierNode, estimate_file=str(path), estimate_period=0.05,
                      filter__settle=0.0)
    peer = graph.peer()
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    states = peer.create_publisher(JointState, JOINT_STATES, 100)
    wait_until(lambda: states.get_subscription_count() == 1)
    graph.run(node)
    stamps = itertools.count()

    def learns_until(condition: Callable[[], Any]) -> None:
        def step() -> Any:
            states.publish(_moving_state(next(stamps)))
            return condition()
        wait_until(step)

    learns_until(lambda: 'estimate not written' in node.faults.last)
    assert str(path) in node.faults.last
    theta = node.identifier.theta
    learns_until(lambda: not np.array_equal(node.identifier.theta, theta))
    wait_until(lambda: any(value.key == 'last fault' and str(path) in value.value
                           for status in _statuses(diagnostics, 'identifier')
                           for value in status.values))
    folder.unlink()
    folder.mkdir()
    learns_until(path.exists)
    assert list(folder.iterdir()) == [path]


TRUTH = [3.473, 0.196, 0.242, 5.3, 1.1]
LOOP = {  # calm enough for a machine that is busy with other things
    'k1': [200.0, 200.0], 'k2': [40.0, 6.0], 'torque_limit': [40.0, 15.0],
    'initial_estimate': [3.0, 0.25, 0.3, 4.0, 0.8],
    'safety.lower': [-3.0, -3.0], 'safety.upper': [3.0, 3.0],
    'performance.lower': [-0.5, -0.5], 'performance.upper': [0.5, 0.5],
    'reference.smooth_start': 1.0, 'reference.resume_time': 1.0,
    'reference.joint1.amplitude': [0.7], 'reference.joint1.frequency': [1.5],
    'reference.joint2.amplitude': [1.0], 'reference.joint2.frequency': [2.0],
    'rate': 200.0, 'loop.rate': 200.0, 'true_model': 'given', 'true_parameters': TRUTH,
    'command_timeout': 0.1, 'state_timeout': 5.0, 'wait_for_identifier': False,
    'kt': 30.0, 'kh': 30.0, 'history.size': 7,
    'estimate_period': 0.2, 'resume_within': 60.0,
}


@pytest.fixture
def process_loop(processes, graph_of, tmp_path):
    """Return ``start(kind, name=kind)``, a peer, and the commands it hears, for one closed loop.

    The parameters are for nodes of any name; a section for each name would not fit a second one.
    """
    file = tmp_path / 'parameters.yaml'
    settings = {**LOOP, 'estimate_file': str(tmp_path / 'theta_hat.yaml'),
                'bag': str(tmp_path / 'bag')}
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': settings}}), encoding='utf-8')
    peer = graph_of(processes.domain).peer()

    def start(kind: str, name: str = '', *arguments: str):
        return processes.start(kind, '--ros-args', '--params-file', str(file), '-r',
                               f'__node:={name or kind}', *arguments)

    return start, peer, peer.listen(Float64MultiArray, COMMANDS, 5000)


def test_an_identifier_that_was_killed_goes_on_learning_where_it_was(
        process_loop, wait_until, tmp_path) -> None:
    start, peer, commands = process_loop
    estimates = peer.listen(JointState, THETA_HAT, 5000)
    identifier, controller, _ = map(start, ('identifier', 'controller', 'arm_driver'))

    def error(message: tuple[bytes, dict]) -> float:
        return float(np.linalg.norm(decode_joint_state(message[0]).position - TRUTH))

    nothing = float(np.linalg.norm(np.subtract(LOOP['initial_estimate'], TRUTH)))
    wait_until(lambda: estimates and error(estimates[-1]) < 0.2 * nothing, 'a good estimate')
    file = tmp_path / 'theta_hat.yaml'
    saved = file.stat().st_mtime_ns if file.exists() else 0
    wait_until(lambda: file.exists() and file.stat().st_mtime_ns > saved, what='it is written')
    assert identifier.signal(signal.SIGKILL) == -signal.SIGKILL
    before, answered = len(estimates), len(commands)
    # Written while it learned, so it may be less good than the one that was waited for.
    kept = np.array(list(yaml.safe_load(file.read_text(encoding='utf-8'))['theta_hat'].values()))
    known = float(np.linalg.norm(kept - TRUTH))
    wait_until(lambda: len(commands) > answered + 100, what='answers without an identifier')
    again = start('identifier')
    wait_until(lambda: len(estimates) > before + 50, 'new estimates')
    assert error(estimates[before]) < max(1.5 * known, 0.25 * nothing)
    assert 'going on from the estimate in' in again.text
    assert controller.signal(signal.SIGINT) == 0
    wait_until(lambda: not decode_float64_array(commands[-1][0]).any())
    assert _torques(commands)[1:-1].any(axis=1).all()  # the controller has never stopped
    for process in (controller, again):
        assert 'set left' not in process.text
        assert 'Traceback' not in process.text


def test_an_estimate_that_does_not_come_or_is_old_is_a_warning(arm, wait_until) -> None:
    arm = arm(state_timeout=60.0, reference__joint1__amplitude=[0.0])
    estimates = arm.peer.create_publisher(JointState, THETA_HAT, 10)
    arm.begin([0.0, 0.0])
    warn = DiagnosticStatus.WARN
    wait_until(lambda: _says(arm.diagnostics, 'controller', warn, 'no estimate yet',
                             'initial_estimate'))
    estimate = JointState(name=list(PARAMETERS), position=TASK['initial_estimate'])

    def heard() -> bool:
        estimates.publish(estimate)
        arm.publish([0.0, 0.0])
        return _says(arm.diagnostics, 'controller', DiagnosticStatus.OK, 'running')

    wait_until(heard, what='the estimate')
    status = _statuses(arm.diagnostics, 'controller')[-1]
    assert 0.0 <= float({v.key: v.value for v in status.values}['age of the estimate [s]']) <= 1.0
    wait_until(lambda: _says(arm.diagnostics, 'controller', warn, 'no estimate for',
                             'the last one is used'))


def test_a_controller_that_was_killed_takes_the_arm_over_again_from_where_it_is(
        process_loop, wait_until) -> None:
    start, peer, commands = process_loop
    states = peer.listen(JointState, JOINT_STATES, 5000)
    barrier = peer.listen(JointState, BARRIER, 5000)
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    running, _ = map(start, ('controller', 'arm_driver'))
    wait_until(lambda: len(commands) > 200, 'the motion')
    for _ in range(5):  # until DDS has let the peer hear a motion from its beginning
        running.signal(signal.SIGKILL)
        since, told = len(states), len(diagnostics)
        wait_until(lambda since=since: len(states) > since + 10 and not np.any(
            decode_joint_state(states[-1][0]).effort), what='zero torque at the arm')
        wait_until(lambda told=told: _says(diagnostics[told:], 'arm_driver',
                                           DiagnosticStatus.ERROR, 'no commands'))
        sent, shown, at_zero = len(commands), len(barrier), len(states)
        running = start('controller')
        wait_until(lambda sent=sent: len(commands) > sent + 300, 'the motion again')
        assert any(decode_joint_state(data).effort.any() for data, _ in states[at_zero:])
        margins = [decode_joint_state(data).position[:-1] for data, _ in barrier[shown:]]
        assert np.min(margins) > 0.0
        if commands[sent][1]['publication_sequence_number'] <= 20:  # 0.1 s of a blend of 1 s
            break
    else:
        pytest.fail('the first torques of a motion were never heard')
    assert np.abs(_torques(commands)[sent]).max() < 20.0  # joined, not jumped, to the reference
    assert running.signal(signal.SIGINT) == 0


def test_a_driver_that_was_stopped_goes_on_with_the_publisher_that_it_obeyed(
        process_loop, wait_until) -> None:
    start, peer, _ = process_loop
    states = peer.listen(JointState, JOINT_STATES, 5000)
    # A silence that the test's own thread does not keep, were it made to wait.
    driver = start('arm_driver', '', '-p', 'command_timeout:=1.5')
    publishers = [peer.create_publisher(Float64MultiArray, COMMANDS, 1) for _ in range(2)]
    first, stranger = (Float64MultiArrayCodec(2, label).encode(torque) for label, torque in (
        ('/controller#0123abcd', [2.0, 1.0]), ('', [-9.0, -6.0])))
    wait_until(lambda: all(p.get_subscription_count() for p in publishers), what='the driver')
    obeyed, ended = threading.Event(), threading.Event()

    def speak() -> None:
        while not ended.wait(0.005):  # the pace of commands
            for _ in range(5 if obeyed.is_set() else 0):
                publishers[1].publish(stranger)
            publishers[0].publish(first)

    def efforts(since: int) -> np.ndarray:
        return np.nan_to_num([decode_joint_state(data).effort for data, _ in states[since:]])

    speaker = threading.Thread(target=speak)
    speaker.start()
    try:
        wait_until(lambda: states and efforts(-1).any(), what='the first torque')
        obeyed.set()
        for _ in range(4):
            driver.popen.send_signal(signal.SIGSTOP)
            _after(2.0)
            driver.popen.send_signal(signal.SIGCONT)
            since = len(states)
            wait_until(lambda since=since: len(states) > since + 60, what='states again')
            wait_until(lambda: efforts(-1).any(), what='the torque again')
    finally:
        ended.set()
        speaker.join()
    assert efforts(0).min() >= 0.0  # the stranger's is negative


def test_a_second_controller_ends_with_the_name_of_the_first_which_goes_on(
        process_loop, wait_until) -> None:
    start, _, commands = process_loop
    first = start('controller', 'first')
    start('arm_driver')
    wait_until(lambda: len(commands) > 50, 'the motion')
    second = start('controller', 'second')
    assert second.wait() == 2
    assert '/first' in second.text
    assert 'one controller at a time' in second.text
    assert 'Traceback' not in second.text
    sent = len(commands)
    wait_until(lambda: len(commands) > sent + 50)
    assert first.signal(signal.SIGINT) == 0
    wait_until(lambda: not decode_float64_array(commands[-1][0]).any(), what='zero torque')
    assert _torques(commands)[1:-1].any(axis=1).all()
    numbers = [info['publication_sequence_number'] for _, info in commands]
    assert numbers == sorted(set(numbers))  # one publisher's


def _after(seconds: float) -> None:
    threading.Event().wait(seconds)  # a moment that nothing marks


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGHUP])
def test_a_node_that_inherits_an_ignored_signal_ends_on_it_once_it_runs(
        processes, wait_until, tmp_path, number) -> None:
    recorder = processes.start('recorder', '--ros-args', '-p', f'bag:={tmp_path / "bag"}',
                               ignoring=(signal.SIGINT, signal.SIGHUP))
    wait_until((tmp_path / 'bag').exists, what='a recorder that runs')
    assert recorder.signal(number) == 0, recorder.text


@pytest.mark.parametrize('moment', ['start-up', 'run'])
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_at_any_moment_leaves_zero_torque_and_a_bag_that_is_closed(
        process_loop, wait_until, tmp_path, number, moment) -> None:
    start, _, commands = process_loop
    seed, bag = random.Random(f'{number} {moment}'), tmp_path / 'bag'
    running = [start(kind) for kind in ('recorder', 'controller', 'arm_driver')]
    if moment == 'run':
        wait_until(lambda: len(commands) > 20, 'the motion')
        _after(seed.uniform(0.0, 0.3))
    else:
        _after(seed.uniform(0.5, 4.0))
    for process in running:
        process.popen.send_signal(number)
    codes = [process.wait() for process in running]
    assert set(codes) <= {0, 128 + number, -number}, codes  # -number: while Python was loading
    if moment == 'run':
        assert codes == [0, 0, 0]
    if commands:
        wait_until(lambda: not decode_float64_array(commands[-1][0]).any(), what='zero torque')
    if bag.exists():
        _check_closed(bag)
    for process, code in zip(running, codes):
        assert code == -number or 'Traceback' not in process.text


class NoMessageYet(Exception):
    """Nothing had been said when the recorder was told to end."""


def _read(bag: Path) -> Bag:
    try:
        return read_bag(bag)
    except BagError as error:
        if 'it has no message' in str(error):
            raise NoMessageYet from None
        raise


def _check_closed(bag: Path) -> None:
    (file,) = bag.glob('*.mcap')
    assert file.read_bytes().endswith(MAGIC)  # its footer
    with contextlib.suppress(NoMessageYet):
        assert _read(bag).complete


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
@pytest.mark.parametrize(('kind', 'number', 'autostart', 'code'), [
    ('identifier', signal.SIGINT, None, 130), ('controller', signal.SIGTERM, 'true', 143),
    ('controller', signal.SIGINT, 'false', 0)])
def test_a_signal_during_the_first_compilation_ends_a_node_before_the_next_function(
        processes, graph_of, wait_until, tmp_path, kind, number, autostart, code) -> None:
    package = Path(adaptive_blf_control.__file__).parent
    shutil.copytree(package, tmp_path / package.name,  # without machine code of earlier starts
                    ignore=shutil.ignore_patterns('__pycache__'))
    given = ['--ros-args', '-p', f'autostart:={autostart}'] if autostart else []
    process = processes.start(kind, *given, folder=tmp_path)
    if autostart == 'false':  # then a request makes it compile
        client = graph_of(processes.domain).peer().create_client(
            ChangeState, f'/{kind}/change_state')
        assert client.wait_for_service(PATIENCE)
        client.call_async(ChangeState.Request(transition=Transition(label='configure')))
    compiled = functools.partial(tmp_path.rglob, '*.nbi')
    wait_until(lambda: any(compiled()), 'the first compiled function')
    wait_until(lambda: 'compiling for this machine' in process.text, 'word of it')
    assert process.signal(number) == code
    assert 'Traceback' not in process.text
    if kind == 'identifier':
        assert not any('residual_with_scale' in file.name for file in compiled())
        return
    assert not any('law.answer' in file.name for file in compiled())  # needed last


def test_signals_in_a_burst_do_not_hang_a_node(process_loop, wait_until) -> None:
    start, _, commands = process_loop
    running = [start(kind) for kind in ('controller', 'arm_driver')]
    wait_until(lambda: len(commands) > 20, 'the motion')
    for _ in range(20):
        for process in running:
            if process.popen.poll() is None:
                for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                    process.popen.send_signal(number)
    assert [process.wait() for process in running] == [0, 0]
    wait_until(lambda: not decode_float64_array(commands[-1][0]).any(), what='zero torque')
