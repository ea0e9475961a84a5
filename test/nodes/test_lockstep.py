# SPDX-License-Identifier: Apache-2.0
"""Under use_sim_time a run is a computation: repeatable, equal to `simulate`, never half done."""

from __future__ import annotations

from pathlib import Path
import signal
import time
from typing import Any, NamedTuple

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import ReliabilityPolicy
import yaml

from adaptive_blf_control.bags.reader import Bag, read_bag
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import (
    apply_settings,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.messages.cdr import decode_float64_array
from adaptive_blf_control.messages.joint_state import decode_joint_state
from adaptive_blf_control.messages.topics import RECORDED
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.arm_lockstep import EPOCH_NS, LockstepTimeout
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.nodes.recorder import Recorder
from adaptive_blf_control.runs.bag_observer import BagObserver

KINDS = {'recorder': Recorder, 'identifier': IdentifierNode, 'controller': ControllerNode,
         'arm_driver': ArmDriver}
DIAGNOSTICS, EVENTS = '/diagnostics', '/parameter_events'
STATES, COMMANDS = '/joint_states', '/effort_controller/commands'
# The names of the bag and of the nodes' moment of birth.
START_UP = {(DIAGNOSTICS, 'recorder'), (EVENTS, '')}
# What no arm and no law sends, and what a simulation has no use for.
NOT_SIMULATED = {DIAGNOSTICS, '/clock', EVENTS, '/controller/joint_trajectory',
                 '/controller/guarantee'}


class Message(NamedTuple):
    """A message of a bag: its log time [ns] and its bytes."""

    log_ns: int
    data: bytes


def _messages(bag: Bag) -> dict[str, list[Message]]:
    found: dict[str, list[Message]] = {topic: [] for topic in bag.topics}
    for message in bag:
        found[message.topic].append(Message(message.log_time_ns, message.data))
    return found


class Run:
    """Driver, controller, identifier and recorder on one scenario, in lockstep, in one process.

    Attributes:
        nodes: The nodes by name.
        runners: Their threads.
    """

    def __init__(self, graph: Any, wait_until: Any, config: Path, bag: Path,
                 leave_out: tuple[str, ...] = (), **driver: Any) -> None:
        """Start the nodes but ``leave_out``; ``driver``: its parameters."""
        self._bag = bag
        settings = {'recorder': {'bag': str(bag), 'topics': [*RECORDED, '/clock']},
                    'arm_driver': driver}
        self.nodes = {}
        for name, kind in KINDS.items():
            if name not in leave_out:
                self.nodes[name] = graph.add(kind(
                    context=graph.context,
                    parameter_overrides=[
                        Parameter(key.replace('__', '.'), value=value) for key, value in
                        {'use_sim_time': True, **settings.get(name, {})}.items()],
                    cli_args=['--ros-args', '--params-file', str(config)]))
        self.runners = {}
        for name, node in self.nodes.items():  # the driver comes last
            if name == 'arm_driver':  # a topic whose type the recorder had to look up
                wait_until(lambda: '/clock' in self.nodes['recorder'].received
                           and self._clock_is_heard())
            self.runners[name] = graph.run(node)

    def _clock_is_heard(self) -> bool:
        """Whether the driver has discovered the recorder's subscription; rclpy's has ended."""
        return any(info.node_name == 'recorder'
                   and info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
                   for info in self.nodes['arm_driver'].get_subscriptions_info_by_topic('/clock'))

    def end(self) -> dict[str, list[Message]]:
        """Wait for the driver's end, end the others and return what was recorded."""
        assert self.runners['arm_driver'].join() == 0
        for name in ('controller', 'identifier', 'recorder'):
            assert self.runners[name].end() == 0
        return _messages(read_bag(self._bag))


def _simulate(config: Path, bag: Path, duration: float, change=None) -> dict[str, list[Message]]:
    """Run `simulate` on the scenario; ``change(loop, sample)`` is called after every sample."""
    data = load_yaml(config)
    loop = build_closed_loop(data)
    with BagObserver(bag, loop, data) as observer:
        if change is None:
            loop.run(duration, observer)
        else:  # who changes the loop while it runs takes it sample by sample
            for sample in loop.samples(duration):
                observer(sample)
                change(loop, sample)
    return _messages(read_bag(bag))


def _assert_simulated(run: dict[str, list[Message]], simulated: dict[str, list[Message]]) -> None:
    """Every byte and every log time; the controller's last word is a zero torque besides."""
    assert set(run) - NOT_SIMULATED == {topic for topic in simulated if simulated[topic]}
    for topic in set(run) - NOT_SIMULATED:
        messages = run[topic][:-1] if topic == COMMANDS else run[topic]
        assert messages == simulated[topic], topic


def _by_node(run: dict[str, list[Message]]) -> dict[tuple[str, str], list[Message]]:
    """Return the messages by topic and node: nodes do not wait for one another's diagnostics."""
    apart: dict[tuple[str, str], list[Message]] = {}
    for topic, messages in run.items():
        for message in messages:
            node = ''
            if topic == DIAGNOSTICS:
                node = next(name for name in KINDS if f'{name}: '.encode() in message.data)
            apart.setdefault((topic, node), []).append(message)
    return apart


class Scene:
    """Runs in private graphs, with their bags under one folder."""

    def __init__(self, graph_of: Any, wait_until: Any, config: Path, folder: Path) -> None:
        """Use the scenario ``config`` where no other is given."""
        self.config = config
        self.graph: Any = None
        self._graph_of, self._wait_until, self._folder = graph_of, wait_until, folder
        self._runs = 0

    def run(self, config: Path | None = None, **settings: Any) -> Run:
        """Start a run, in a new graph; arguments as of `Run`."""
        if self.graph is not None:
            self.graph.close()
        self.graph = self._graph_of(0)
        self._runs += 1
        return Run(self.graph, self._wait_until, config or self.config,
                   self._folder / f'run{self._runs}', **settings)

    def with_settings(self, base: Path, *settings: str) -> Path:
        """Return a scenario file with some settings changed."""
        path = self._folder / 'scenario.yaml'
        path.write_text(yaml.safe_dump(apply_settings(load_yaml(base), list(settings))),
                        encoding='utf-8')
        return path


@pytest.fixture
def scene(graph_of, wait_until, repository, tmp_path) -> Scene:
    """Return a scene for the paper's first arm."""
    return Scene(graph_of, wait_until, repository / 'config' / 'two_link.yaml', tmp_path)


def test_two_runs_are_the_same_and_that_of_simulate_byte_for_byte(
        scene, tmp_path) -> None:
    runs = [scene.run(duration=1.2).end() for _ in range(2)]
    first, second = map(_by_node, runs)
    assert set(first) == set(second)
    assert {node for topic, node in first if topic == DIAGNOSTICS} == set(KINDS)
    for key in set(first) - START_UP:
        assert first[key] == second[key], key
    assert len(first[STATES, '']) == len(first['/clock', '']) == 1201
    _assert_simulated(runs[0], _simulate(scene.config, tmp_path / 'simulated', 1.2))


@pytest.mark.parametrize('names', [('controller', 'identifier'), ('arm_control',)])
def test_processes_give_the_bytes_of_simulate_whoever_comes_last(
        names, processes, scene, tmp_path) -> None:
    bag = tmp_path / 'bag'
    settings = ['arm_driver:duration:=0.5', f'arm_driver:wait_for_subscribers:={len(names) + 1}',
                f'identifier:estimate_file:={tmp_path / "theta_hat.yaml"}',
                f'recorder:bag:={bag}']
    started = {name: processes.start(
        name, '--ros-args', '--params-file', str(scene.config), '-p', 'use_sim_time:=true',
        *(word for setting in settings for word in ('-p', setting)))
        for name in ('arm_driver', *names, 'recorder')}
    assert started['arm_driver'].wait() == 0, started['arm_driver'].text
    for name in (*names, 'recorder'):
        assert started[name].signal(signal.SIGINT) == 0, started[name].text
    _assert_simulated(_messages(read_bag(bag)),
                      _simulate(scene.config, tmp_path / 'simulated', 0.5))


def test_an_arm_with_encoders_that_starts_off_its_reference_runs_as_in_simulate(
        scene, repository, tmp_path) -> None:
    config = scene.with_settings(
        repository / 'config' / 'three_link_encoder.yaml',
        'arm_driver.initial_position=[0.0512345, 0.1, -0.03]',
        'arm_driver.dead_time=2', 'controller.monitor_decimation=3',
        'controller.reference.smooth_start=0.2')
    run = scene.run(config, duration=0.3).end()
    _assert_simulated(run, _simulate(config, tmp_path / 'simulated', 0.3))
    measured = decode_joint_state(run[STATES][0].data).position
    assert (np.abs(measured - [0.0512345, 0.1, -0.03]) > 1e-9).any()


def test_the_bag_is_dated_by_samples_whatever_has_no_stamp_too(scene, tmp_path) -> None:
    run = scene.run(duration=0.5).end()
    stamps = [decode_joint_state(message.data).stamp_ns for message in run[STATES]]
    assert stamps == [EPOCH_NS + k * 10**6 for k in range(501)]
    assert [message.log_ns for message in run[STATES]] == stamps
    assert [message.log_ns for message in run['/clock']] == stamps
    assert [message.log_ns for message in run[COMMANDS]] == [*stamps, stamps[-1]]
    for messages in run.values():  # what a node says of its start belongs to the first
        assert {message.log_ns for message in messages} <= set(stamps)
    in_order = [message for message in read_bag(tmp_path / 'run1')
                if message.topic in (STATES, COMMANDS)]
    by_sample = sorted(in_order, key=lambda m: (m.log_time_ns, m.topic != STATES))
    assert [message.topic for message in by_sample] == [STATES, COMMANDS] * 501 + [COMMANDS]


@pytest.mark.parametrize('missing', ['identifier', 'controller'])
def test_a_node_that_is_not_there_is_named(scene, missing) -> None:
    run = scene.run(leave_out=(missing,), lockstep__timeout=0.5)
    with pytest.raises(LockstepTimeout, match=f'^{missing} is not there within 0.5 s'):
        run.runners['arm_driver'].join()


@pytest.mark.parametrize('ending', ['identifier', 'controller'])
def test_a_node_that_ends_in_the_middle_is_named(scene, wait_until, ending) -> None:
    run = scene.run(lockstep__timeout=1.0)
    node = run.nodes[ending]
    wait_until(lambda: node.statistics.samples >= 100, what='the middle')
    assert run.runners[ending].end() == 0
    with pytest.raises(LockstepTimeout, match=fr'^{ending}.* has not answered the state of '
                                              r'\d+\.\d{6} s within 1 s'):
        run.runners['arm_driver'].join()


def test_a_controller_that_is_deactivated_holds_time_still_until_it_is_active_again(
        scene, wait_until) -> None:
    run = scene.run(duration=0.6, lockstep__timeout=30.0)
    controller, peer = run.nodes['controller'], scene.graph.peer()

    def change(transition: int) -> None:
        answer = peer.call(ChangeState, '/controller/change_state',
                           ChangeState.Request(transition=Transition(id=transition)))
        assert answer.success

    wait_until(lambda: controller.statistics.samples >= 100, what='the middle')
    change(Transition.TRANSITION_DEACTIVATE)
    samples = controller.statistics.samples
    assert samples < 600
    change(Transition.TRANSITION_ACTIVATE)
    recorded = run.end()
    torques = np.array([decode_float64_array(message.data) for message in recorded[COMMANDS]])
    assert np.flatnonzero(~torques.any(axis=1)).tolist() == [samples, 602]
    stamps = [decode_joint_state(message.data).stamp_ns for message in recorded[STATES]]
    assert stamps == [EPOCH_NS + k * 10**6 for k in range(601)]


def test_a_driver_without_answers_ends_as_a_process_with_status_2(processes, scene) -> None:
    driver = processes.start('arm_driver', '--ros-args', '--params-file', str(scene.config), '-p',
                             'use_sim_time:=true', '-p', 'lockstep.timeout:=0.2')
    assert driver.wait() == 2
    assert 'controller, identifier is not there within 0.2 s' in driver.text
    assert 'Traceback' not in driver.text


@pytest.mark.parametrize(('rate', 'arm_time'), [(2.0, 0.8), (0.2, 0.2)])
def test_a_run_takes_the_time_that_rate_gives_it(scene, rate, arm_time) -> None:
    begin = time.monotonic()
    scene.run(duration=arm_time, lockstep__rate=rate).end()
    assert time.monotonic() - begin >= arm_time / rate


def test_a_gain_changes_between_two_samples_and_the_run_stays_that_of_simulate(
        scene, tmp_path, wait_until) -> None:
    run = scene.run(duration=1.0, lockstep__rate=1.0)
    controller = run.nodes['controller']
    wait_until(lambda: controller.statistics.samples >= 200, what='the middle')
    request = SetParametersAtomically.Request(parameters=[
        Parameter('k2', value=[40.0, 5.0]).to_parameter_msg(),
        Parameter('k1', value=[500.0, 600.0]).to_parameter_msg()])
    answer = scene.graph.peer().call(SetParametersAtomically,
                               '/controller/set_parameters_atomically', request)
    assert answer.result.successful, answer.result.reason
    recorded = run.end()

    plain = _simulate(scene.config, tmp_path / 'plain', 1.0)
    first = next(k for k, (a, b) in enumerate(zip(recorded[COMMANDS], plain[COMMANDS])) if a != b)
    assert 200 <= first < 1000
    data = load_yaml(scene.config)
    settings = node_settings(data, ControllerNodeSettings).replace(
        k1=[500.0, 600.0], k2=[40.0, 5.0])

    def change(loop, sample) -> None:
        if round(sample.t * 1e3) == first - 1:
            loop.controller.retune(sample.t, sample.measured.q, settings=settings)

    _assert_simulated(recorded, _simulate(scene.config, tmp_path / 'changed', 1.0, change))
    change_ns = [message.log_ns for message in recorded[EVENTS] if b'k2' in message.data]
    assert EPOCH_NS < change_ns[-1] <= recorded[STATES][first + 100].log_ns
