# SPDX-License-Identifier: Apache-2.0
"""Whatever arrives on a subscription: no crash, no bad torque, no trace of what was refused.

Every subscription gets at least 10,000 messages: arbitrary bytes, good messages cut and spoiled,
and well-formed ones with any doubles, names, lengths and stamps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import itertools
import math
import random
import re
import threading
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration
import numpy as np
import pytest
from rclpy.duration import Duration as Wait
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import node_settings
from adaptive_blf_control.errors import BlfError, SetViolation
from adaptive_blf_control.messages.cdr import decode_float64_array
from adaptive_blf_control.messages.topics import (
    COMMANDS,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    THETA_HAT,
)
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.nodes.recorder import Recorder
from adaptive_blf_control.runtime.answers import Answers
from adaptive_blf_control.runtime.robot_description import arm_from
from patience import PATIENCE

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

LEAST = 10_000
BATCH = 50
JOINTS = ('joint1', 'joint2')
PARAMETERS = TwoLinkArm().parameters
LIMIT = np.array([200.0, 100.0])
TASK = {
    'k1': [1000.0, 800.0], 'k2': [60.0, 8.0], 'torque_limit': LIMIT.tolist(),
    'initial_estimate': [3.0, 0.2, 0.3, 5.0, 1.0],
    'safety__lower': [-2.0, -2.0], 'safety__upper': [2.0, 2.0],
    'performance__lower': [-0.17], 'performance__upper': [0.2],
    'reference__smooth_start': 0.0, 'monitor_decimation': 7,
    'state_timeout': 60.0,  # so that no silence is one of the changes that are looked for
}
FIRST = 10**12  # ns, stamp of the first message

SPECIAL = (0.0, -0.0, math.nan, math.inf, -math.inf, 1e308, -1.7e308, 1e154, 5e-324, 1e-300)
doubles = st.sampled_from(SPECIAL) | st.floats(-2.0, 2.0) | st.floats()
numbers = st.integers(-5, 5) | st.integers(0, 2**63 - 1)


class _Drawn(NamedTuple):
    """What one example draws: a batch of messages is mixed of it, which is much faster."""

    random: random.Random
    wild: list[float]
    usual: list[float]
    chunks: list[bytes]
    texts: list[str]
    stamps: list[tuple[int, int]]
    info: dict[str, int]

    def some(self, values: Sequence[Any], most: int) -> list[Any]:
        """Return 0 to ``most`` of the values, any of them several times."""
        return self.random.choices(values, k=self.random.randint(0, most))

    def row(self, n: int) -> list[float]:
        """Return doubles: most often ``n`` of them, and most often usual ones."""
        values = self.usual if self.random.random() < 0.7 else self.usual + self.wild
        if self.random.random() < 0.8:
            return self.random.choices(values, k=n)
        return self.some(values, n + 2)

    def spoiled(self, good: bytes) -> bytes:
        """Return a good message with some of it replaced, or cut off."""
        at, new = self.random.randint(0, len(good)), self.random.choice(self.chunks)[:9]
        end = self.random.choice([None, self.random.randint(0, len(good))])
        return (good[:at] + new + good[at + len(new):])[:end]


drawn = st.builds(
    _Drawn, st.builds(random.Random, st.integers(0, 2**64)),
    st.lists(doubles, min_size=8, max_size=8), st.lists(st.floats(-0.3, 0.3), min_size=4,
                                                        max_size=4),
    st.lists(st.binary(max_size=80), min_size=3, max_size=3),
    st.lists(st.text(st.characters(exclude_characters='\0', codec='utf-8'), max_size=4),
             min_size=2, max_size=2),
    st.lists(st.tuples(st.integers(-2**31, 2**31 - 1), st.integers(0, 2**32 - 1)), min_size=3,
             max_size=3),
    st.fixed_dictionaries({}, optional={
        'publication_sequence_number': st.none() | numbers, 'source_timestamp': numbers,
        'received_timestamp': numbers}))


def _vector(names: Sequence[str], stamp: tuple[int, int], *fields: list[float]) -> bytes:
    message = JointState(name=list(names), position=fields[0], velocity=fields[1],
                         effort=fields[2])
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    return serialize_message(message)


def _good(names: Sequence[str], stamp_ns: int = FIRST) -> bytes:
    values = [0.01 * (k + 1) for k in range(len(names))]
    return _vector(names, divmod(stamp_ns, 10**9), values, values, values)


def _vectors(known: tuple[str, ...]) -> Callable[[_Drawn], bytes]:
    """Return a maker of joint states or named vectors; many have the stamp that comes next."""
    clock = itertools.count(1)
    good, n = _good(known), len(known)

    def make(drawn: _Drawn) -> bytes:
        kind = drawn.random.random()
        if kind < 0.1:
            return drawn.random.choice(drawn.chunks)
        if kind < 0.3:
            return drawn.spoiled(good)
        names = list(known)
        if kind < 0.5:
            drawn.random.shuffle(names)
        elif kind < 0.6:
            names = drawn.some([*known, *drawn.texts], n + 2)
        stamp = divmod(FIRST + next(clock) * 10**6, 10**9)
        if drawn.random.random() < 0.2:
            stamp = drawn.random.choice(drawn.stamps)
        return _vector(names, stamp, *(drawn.row(n) for _ in range(3)))

    return make


def _feed(make: Callable[[_Drawn], Any], handle: Callable[[Any, dict], None]) -> None:
    """Hand at least 10,000 messages, each with its info, to ``handle``."""
    fed = 0

    @hypothesis.settings(max_examples=LEAST // BATCH, phases=[hypothesis.Phase.generate])
    @hypothesis.given(drawn)
    def any_messages(drawn: _Drawn) -> None:
        nonlocal fed
        for _ in range(BATCH):
            with np.errstate(all='ignore'):
                handle(make(drawn), drawn.info)
            fed += 1

    any_messages()
    assert fed >= LEAST


def _same(before: tuple, after: tuple) -> bool:
    return all(a is b or np.array_equal(a, b, equal_nan=isinstance(a, np.ndarray))
               for a, b in zip(before, after))


def _refused(node: Any) -> int:
    return sum(node.faults.drops.values())


class _Watched:
    """Calls a handler and checks that what was dropped has left no trace."""

    def __init__(self, node: Any, handler: Callable[..., None],
                 state: Callable[[], tuple]) -> None:
        self.node = node
        self.taken = self.refused = 0
        self._handler = handler
        self._state = state

    def __call__(self, *message: Any) -> None:
        before, drops = self._state(), _refused(self.node)
        self._handler(*message)
        if _refused(self.node) > drops:
            self.refused += 1
            assert _same(before, self._state()), self.node.faults.drops
        else:
            self.taken += 1


@pytest.fixture
def moving(graph, wait_until):
    """Return a controller in motion, a function that sends it a good state, torques heard."""
    node = graph.make(ControllerNode, **TASK)
    peer = graph.peer()
    heard = peer.listen(Float64MultiArray, COMMANDS)
    stamps = itertools.count(FIRST, 10**7)
    wait_until(lambda: node.count_subscribers(COMMANDS) == 1)

    def good() -> None:
        node.on_joint_states(_good(JOINTS, next(stamps)), {})

    def begun() -> bool:
        good()
        return bool(heard)

    wait_until(begun)
    return node, good, heard


def _motion(node: ControllerNode) -> tuple:
    motion, controller = node.motion, node.motion.controller
    return (node.theta, node.output, controller, controller and controller.reference,
            motion.gate.last_ns, motion.t, node.heard_at, motion.lost, motion.q, node.active,
            node.statistics.samples)


def test_joint_states_of_the_controller(moving) -> None:
    node, _, heard = moving
    watched = _Watched(node, node.on_joint_states, lambda: _motion(node))

    def handle(data: bytes, info: dict) -> None:
        last_ns = node.motion.gate.last_ns
        if last_ns is not None and last_ns > FIRST + 10**10:
            _begin_again(node)  # a clock that has run ahead would make all others old
        try:
            watched(data, info)
        except SetViolation:  # the clock has jumped, and the arm is outside: the node would end
            node.finish()
            _begin_again(node)
        torque = node.output.torque
        assert np.isfinite(torque).all()
        assert (np.abs(torque) <= LIMIT).all()

    _feed(_vectors(JOINTS), handle)
    assert watched.taken > 1000
    assert watched.refused > 1000
    assert {'unusable joint state', 'non-finite joint state', 'joint state out of order',
            'stamp jumps ahead'} <= set(node.faults.drops)
    for data, _ in heard:
        assert np.isfinite(decode_float64_array(data)).all()


def _begin_again(node: ControllerNode) -> None:
    node.motion.end()
    node.motion.gate.last_ns = None
    node.on_joint_states(_good(JOINTS), {})


def test_estimates_of_the_controller(moving) -> None:
    node, good, _ = moving
    watched = _Watched(node, node.estimates.receive, lambda: _motion(node))

    def handle(data: bytes, info: dict) -> None:
        watched(data, info)
        assert np.isfinite(node.theta).all()
        assert (np.abs(node.theta) <= 1000.0).all()
        if watched.taken % 10 == 1:
            good()
            assert np.isfinite(node.output.torque).all()

    _feed(_vectors(PARAMETERS), handle)
    assert watched.taken > 200
    assert {'unusable estimate', 'non-finite estimate',
            'estimate beyond its limit'} <= set(node.faults.drops)


def _trajectory(drawn: _Drawn) -> JointTrajectory:
    message = JointTrajectory(joint_names=list(JOINTS))
    if drawn.random.random() < 0.2:
        message.joint_names = drawn.some([*JOINTS, *drawn.texts], 3)
    for second in range(drawn.random.randint(0, 3)):
        time = Duration(sec=second + 1)
        if drawn.random.random() < 0.1:
            time = Duration(**dict(zip(('sec', 'nanosec'), drawn.random.choice(drawn.stamps))))
        still = drawn.random.random() < 0.7
        message.points.append(JointTrajectoryPoint(
            positions=drawn.row(2), velocities=[] if still else drawn.row(2),
            accelerations=[] if still else drawn.row(2), time_from_start=time))
    return message


def test_trajectories_of_the_controller(moving) -> None:
    node, good, _ = moving
    watched = _Watched(node, node.inputs.trajectories.receive, lambda: _motion(node))

    def handle(message: JointTrajectory, _: dict) -> None:
        before = watched.taken
        watched(message)
        if watched.taken > before:
            good()
            assert np.isfinite(node.output.torque).all()
            assert np.isfinite(np.concatenate(node.output.reference)).all()

    _feed(_trajectory, handle)
    assert watched.taken > 100
    assert watched.refused > 1000


def test_robot_descriptions(pair_urdf: str) -> None:
    pytest.importorskip('pinocchio', reason='no URDF without it')
    values = {'arm': 'urdf', 'urdf': 'topic:robot_description', 'joints': ['shoulder', 'elbow']}
    settings = node_settings({'/**': {'ros__parameters': values}}, ControllerNodeSettings)
    good = serialize_message(String(data=pair_urdf))
    assert arm_from(good, 'robot_description', settings).joints == ('shoulder', 'elbow')
    built = refused = 0

    def make(drawn: _Drawn) -> bytes:
        kind = drawn.random.random()
        if kind < 0.1:
            return drawn.random.choice(drawn.chunks)
        if kind < 0.2:
            return serialize_message(String(data=drawn.random.choice(drawn.texts)))
        if kind < 0.6:  # another number somewhere
            places = [match.span(1) for match in re.finditer(r'"([-0-9. ]+)"', pair_urdf)]
            start, end = drawn.random.choice(places)
            number = repr(drawn.random.choice(drawn.wild + drawn.usual))
            return serialize_message(String(data=pair_urdf[:start] + number + pair_urdf[end:]))
        return drawn.spoiled(good)

    def handle(data: bytes, _: dict) -> None:
        nonlocal built, refused
        try:
            arm = arm_from(data, 'robot_description', settings)
        except BlfError:
            refused += 1
        else:
            built += 1
            assert np.isfinite(arm.nominal).all()

    _feed(make, handle)
    assert built > 100
    assert refused > 1000


def test_bytes_that_are_no_trajectory_do_not_end_the_thread_that_serves_requests(
        graph, moving, wait_until) -> None:
    node, _, _ = moving
    publisher = graph.peer().create_publisher(JointTrajectory, JOINT_TRAJECTORY, 100)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    graph.run(node)
    good = serialize_message(JointTrajectory(joint_names=['nobody']))

    @hypothesis.settings(max_examples=200, phases=[hypothesis.Phase.generate])
    @hypothesis.given(drawn)
    def any_bytes(drawn: _Drawn) -> None:
        publisher.publish(drawn.spoiled(good))
        publisher.publish(drawn.chunks[0])

    any_bytes()
    before = _refused(node)
    publisher.publish(good)
    wait_until(lambda: _refused(node) > before, what='the trajectory of nobody')


def test_joint_states_of_the_identifier(graph) -> None:
    node = graph.make(IdentifierNode, filter__settle=0.0)
    identifier = node.identifier
    watched = _Watched(node, node.on_joint_states, lambda: (
        identifier.theta, identifier.stack.count, identifier.stack.sigma_min, node.last_ns,
        node.statistics.samples))

    def handle(data: bytes, info: dict) -> None:
        before = identifier.theta, identifier.stack.insertions, sum(identifier.dropped.values())
        watched(data, info)
        assert np.isfinite(identifier.theta).all()
        assert math.isfinite(identifier.stack.sigma_min)
        if sum(identifier.dropped.values()) > before[2]:
            assert identifier.theta is before[0]
            assert identifier.stack.insertions == before[1]

    _feed(_vectors(JOINTS), handle)
    assert watched.taken > 1000
    assert watched.refused > 1000
    assert identifier.dropped['not finite'] > 100


def test_adaptation_terms_of_the_identifier(graph) -> None:
    node = graph.make(IdentifierNode, filter__settle=0.0)
    watched = _Watched(node, node.terms.receive, lambda: (
        len(node.terms.terms), *(term for _, term in node.terms.terms), node.identifier.theta))
    stamps = itertools.count(FIRST, 10**6)

    def handle(data: bytes, info: dict) -> None:
        watched(data, info)
        if watched.taken % 10 == 1:
            node.on_joint_states(_good(JOINTS, next(stamps)), {})
            assert np.isfinite(node.identifier.theta).all()

    _feed(_vectors(PARAMETERS), handle)
    assert watched.taken > 1000
    assert {'unusable adaptation term', 'non-finite adaptation term'} <= set(node.faults.drops)
    assert len(node.terms.terms) <= 100


def _command(drawn: _Drawn) -> bytes:
    kind = drawn.random.random()
    if kind < 0.1:
        return drawn.random.choice(drawn.chunks)
    if kind < 0.4:
        return drawn.spoiled(serialize_message(_array([3.0, -2.0], [], 0)))
    return serialize_message(_array(drawn.row(2), drawn.some(drawn.texts, 2),
                                    drawn.random.choice(drawn.stamps)[1]))


def _array(data: list[float], labels: list[str], offset: int) -> Float64MultiArray:
    message = Float64MultiArray(data=data)
    message.layout.dim = [MultiArrayDimension(label=label, size=offset)
                          for label in labels]
    message.layout.data_offset = offset
    return message


def _check_commands(driver: ArmDriver, state: Callable[[], tuple],
                    torque: Callable[[], np.ndarray]) -> None:
    watched = _Watched(driver, driver.on_command, state)
    own = itertools.count(1)

    def handle(data: bytes, info: dict) -> None:
        if 'source_timestamp' not in info:  # else a stranger, perhaps
            info = {**info, 'publication_sequence_number': next(own)}
        watched(data, info)
        assert np.isfinite(torque()).all()
        assert np.isfinite([driver.plant.q, driver.plant.qd]).all()

    _feed(_command, handle)
    assert watched.taken > 1000
    assert watched.refused > 1000
    assert {'unreadable command', 'command of wrong length', 'non-finite command',
            'command of a second publisher'} <= set(driver.faults.drops)


def test_commands_of_the_driver(graph) -> None:
    driver = graph.make(ArmDriver, rate=100.0, torque_limit=LIMIT.tolist(), command_timeout=60.0)
    driver.start_clock()
    # That a command is kept by the plant shows from outside only when it advances.
    _check_commands(driver, lambda: (
        driver.plant.torque, driver.plant._commanded, driver.started,
        driver.drives.timed_out, driver.commands.heard_ns,
        driver.commands.source.source),
        lambda: driver.plant.torque / LIMIT)
    assert (np.abs(driver.plant.torque) <= LIMIT).all()


def test_commands_and_answers_of_the_driver_in_lockstep(graph) -> None:
    driver = graph.make(ArmDriver, use_sim_time=True, command_timeout=60.0)
    answers = driver.stepping.answers
    _check_commands(driver, lambda: (
        answers.torque, answers.commanded, driver.commands.heard_ns,
        driver.commands.source.source),
        lambda: answers.torque)
    awaited = FIRST + 500 * 10**6
    answers.expect(awaited)
    answers.command(np.zeros(2))
    answers.hear('controller', _good(PARAMETERS, awaited))
    assert answers.missing() == ['identifier']
    missing = set()

    def handle(data: bytes, info: dict) -> None:
        answers.hear('controller', data)
        missing.update(answers.missing())

    _feed(_vectors(PARAMETERS), handle)
    assert missing == {'identifier'}  # an answer stays one, whatever follows


def test_answers_that_a_player_waits_for(graph, wait_until) -> None:
    peer = graph.peer()
    publisher = peer.create_publisher(JointState, THETA_HAT, 100)
    player = graph.add(Node('player', context=graph.context))
    answers = Answers(player, [f'/{THETA_HAT}'], threading.Event())
    answers.discover(20.0)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    heard = 0

    def handle(data: bytes, _: dict) -> None:
        nonlocal heard
        publisher.publish(data)
        heard += 1
        if heard % 50 == 0:
            publisher.wait_for_all_acked(Wait(seconds=PATIENCE))
            answers.wait(-1, 0.0)

    _feed(_vectors(PARAMETERS), handle)
    publisher.publish(_good(PARAMETERS, 2 * 10**18))
    assert answers.wait(2 * 10**18, PATIENCE) == []


@pytest.mark.parametrize('use_sim_time', [False, True])
def test_raw_input_of_the_recorder(graph, tmp_path, use_sim_time) -> None:
    node = graph.make(Recorder, bag=str(tmp_path / 'bag'), topics=[JOINT_STATES, THETA_HAT],
                      use_sim_time=use_sim_time)
    given: dict[str, list[bytes]] = {f'/{JOINT_STATES}': [], f'/{THETA_HAT}': []}
    turn = itertools.cycle(given)

    def handle(data: bytes, info: dict) -> None:
        topic = next(turn)
        given[topic].append(data)
        node.record(topic, 'sensor_msgs/msg/JointState', data, {
            'received_timestamp': FIRST, 'source_timestamp': FIRST, **info})

    _feed(_vectors(JOINTS), handle)
    node.finish()
    assert node.exit_code == 0
    assert node.status()[0] == b'\0'
    bag = read_bag(tmp_path / 'bag')
    assert bag.complete
    for topic, messages in given.items():
        assert sorted(m.data for m in bag.messages([topic])) == sorted(messages)


def test_any_value_of_a_parameter_is_taken_or_refused_with_a_reason(moving) -> None:
    node, good, _ = moving
    names = [name for name in node.settings.values()
             if '.' not in name or name.startswith('safety')]

    @hypothesis.settings(max_examples=300, phases=[hypothesis.Phase.generate])
    @hypothesis.given(st.sampled_from(names), doubles | st.lists(doubles, min_size=1, max_size=3)
                      | st.integers(-5, 5) | st.booleans() | st.text(max_size=3))
    def any_value(name: str, value: Any) -> None:
        before = node.settings.values()
        result = node.set_parameters([Parameter(name, value=value)])[0]
        if not result.successful:
            assert result.reason
            assert node.settings.values() == before
        with np.errstate(all='ignore'):
            good()
        assert np.isfinite(node.output.torque).all()

    any_value()
