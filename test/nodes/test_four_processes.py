# SPDX-License-Identifier: Apache-2.0
"""Four processes over real DDS: the demo's verdict, its bag, its end; an arm sent as a URDF."""

from __future__ import annotations

import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.arms.urdf_source import urdf_joints
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.configuration.parameter_file import load_yaml, node_values
from adaptive_blf_control.errors import ArmError
from adaptive_blf_control.executables import NODES
from adaptive_blf_control.identification.given_parameters import read_estimate
from adaptive_blf_control.messages.cdr import decode_float64_array
from adaptive_blf_control.messages.diagnostics import decode_diagnostics
from adaptive_blf_control.messages.topics import (
    COMMANDS,
    CONSISTENT_MODEL,
    GUARANTEE,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    OBSTACLES,
    PARAMETER_SET,
    PAYLOAD,
    PAYLOAD_STD,
    RECORDED,
    RESERVE,
    THETA_STD,
)
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.runs.bag_run import bag_parameters
from adaptive_blf_control.runtime import robot_description
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.process import run_node
from adaptive_blf_control.runtime.stop_flag import StopFlag
from patience import PATIENCE

# Spoken on only if asked for, where a parameter changes, for an arm from a URDF, and every
# model_period, which is longer than the demo here.
QUIET = (GUARANTEE, JOINT_TRAJECTORY, '/parameter_events', CONSISTENT_MODEL, THETA_STD, PAYLOAD,
         PAYLOAD_STD, OBSTACLES, PARAMETER_SET, RESERVE)


def _left_over(folder: Path) -> list[str]:
    """Return the processes whose environment names ``folder``."""
    found = []
    for process in Path('/proc').glob('[0-9]*'):
        try:
            if str(folder).encode() in (process / 'environ').read_bytes():
                found.append((process / 'cmdline').read_bytes().decode().replace('\0', ' '))
        except OSError:  # ended meanwhile
            continue
    return found


@pytest.fixture(scope='module')
def demo(tmp_path_factory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """Run the demo for 4 s; return the finished process and its output folder."""
    pytest.importorskip('matplotlib')
    output = tmp_path_factory.mktemp('demo') / 'output'
    environment = {name: value for name, value in os.environ.items() if name != 'ROS_LOG_DIR'}
    result = subprocess.run(
        [sys.executable, '-m', 'adaptive_blf_control', 'demo', '--duration', '4', '--output',
         str(output), '--json'], stdin=subprocess.DEVNULL, capture_output=True, text=True,
        timeout=PATIENCE, env=environment)
    return result, output


def test_the_demo_keeps_the_sets_and_says_so(demo) -> None:
    result, output = demo
    assert result.returncode == 0, result.stdout + result.stderr
    figures = json.loads(result.stdout[result.stdout.index('{'):])
    assert figures['set_violations'] == 0
    assert np.min(figures['min_margin']) > 0.0
    assert figures['history_rank'] == 5
    held = figures['rates_hz']
    assert held['controller'] > 50.0
    assert max(held.values()) <= 1000.01  # stamps lie on a grid of 1 ms
    assert str(output / 'bag') in result.stdout


def test_the_demo_leaves_a_picture_a_complete_bag_and_no_process(demo) -> None:
    result, output = demo
    assert result.returncode == 0, result.stdout + result.stderr
    assert (output / 'run.png').read_bytes().startswith(b'\x89PNG')
    assert _left_over(output) == []
    bag = read_bag(output / 'bag')
    assert bag.complete, bag.problem
    assert set(bag.topics) >= {topic if topic[0] == '/' else f'/{topic}' for topic in RECORDED
                               if topic not in QUIET}
    log = (output / 'recorder.txt').read_text(encoding='utf-8')
    for topic, info in bag.topics.items():
        assert info.count > 0, topic
        account = re.search(rf'{topic}: received (\d+), written (\d+), lost (\d+)', log)
        assert account is not None, topic
        received, written, lost = map(int, account.groups())
        assert received == written == info.count
        assert lost <= 0.02 * received  # where the machine is busy, and then it is counted
    for name in ('arm_driver', 'controller', 'identifier', 'recorder'):
        assert 'Traceback' not in (output / f'{name}.txt').read_text(encoding='utf-8')


def test_the_bag_of_the_demo_has_the_run_from_brakes_to_zero_torque(demo, repository) -> None:
    _, output = demo
    bag = read_bag(output / 'bag')
    states = bag.joint_states('/joint_states')
    assert states.names == ('joint1', 'joint2')
    period = np.diff(states.stamp_ns)
    assert (period > 0).all()
    assert (period % 1_000_000 == 0).all()
    moving = np.isfinite(states.effort).all(axis=1)
    assert not moving[0]
    np.testing.assert_array_equal(states.position[~moving][:, 1], 2.0)
    assert 3.9 < (states.stamp_ns[-1] - states.stamp_ns[moving][0]) * 1e-9 < 4.1
    _, torques = bag.doubles('/effort_controller/commands')
    assert np.isfinite(torques).all()
    acting = torques.any(axis=1)
    assert acting[0]
    assert not acting[-1]
    to_zero = np.diff(acting.astype(int)).tolist().count(-1)
    stalls = (output / 'controller.txt').read_text(encoding='utf-8').count('zero torque')
    assert 1 <= to_zero <= max(stalls, 1)  # once zero it stays zero, unless the machine stalled
    config = load_yaml(repository / 'config' / 'two_link.yaml')
    recorded = bag_parameters(bag)
    learned = output / 'theta_hat.yaml'
    alone = {'discovery_time': 0.0}  # in a domain of their own
    assert node_values(recorded, 'identifier') == {
        **node_values(config, 'identifier'), **alone, 'estimate_file': str(learned)}
    assert node_values(recorded, 'controller') == {**node_values(config, 'controller'), **alone}
    assert node_values(recorded, 'arm_driver')['duration'] == 4.0
    np.testing.assert_allclose(  # written at the end, not only every few seconds
        read_estimate(learned, TwoLinkArm().parameters),
        bag.joint_states('/identifier/theta_hat').position[-1], rtol=1e-9)


def test_the_page_of_interfaces_explains_every_key_of_the_diagnostics(demo, repository) -> None:
    _, output = demo
    page = (repository / 'docs' / 'interfaces.md').read_text(encoding='utf-8')
    table = page.split('## Diagnostics')[1].split('\n## ')[0]
    reported: dict[str, set[str]] = {}
    for message in read_bag(output / 'bag').messages(['/diagnostics']):
        for status, values in decode_diagnostics(message.data).items():
            reported.setdefault(status, set()).update(values)
    assert set(reported) == {f'{name}: {name}' for name in NODES}
    for status, keys in reported.items():
        assert len(keys) > 5, status
        for key in keys:
            general = re.sub(r'^joint\d (?=[a-z])', '<joint> ', re.sub(r'^/\S+', '<topic>', key))
            general = re.sub(r'^(dropped:|samples) .*', r'\1 <reason>', general)
            assert f'`{key}`' in table or f'`{general}`' in table, f'{status}: {key}'


def test_the_demo_refuses_a_folder_that_exists_before_it_starts_anything(tmp_path) -> None:
    result = subprocess.run(
        [sys.executable, '-m', 'adaptive_blf_control', 'demo', '--output', str(tmp_path)],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=PATIENCE)
    assert result.returncode == 2
    assert 'exists already' in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_controller_process_ends_with_0_after_a_zero_torque(processes, graph_of, wait_until,
                                                              number) -> None:
    process = processes.start('controller', '--ros-args', '-p', 'state_timeout:=30.0', '-p',
                              'wait_for_identifier:=false')
    peer = graph_of(processes.domain).peer()
    commands = peer.listen(Float64MultiArray, COMMANDS)
    states = peer.create_publisher(JointState, JOINT_STATES, 10)
    wait_until(lambda: states.get_subscription_count() == 1)

    def answered() -> bool:
        state = JointState(name=['joint2', 'joint1'], position=[0.1, 0.05], velocity=[0.2, 0.3])
        state.header.stamp = peer.get_clock().now().to_msg()
        states.publish(state)
        return len(commands) > 5

    wait_until(answered)
    assert decode_float64_array(commands[-1][0]).any()
    assert process.signal(number) == 0
    wait_until(lambda: not decode_float64_array(commands[-1][0]).any(), what='the zero torque')
    assert 'Traceback' not in process.text


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_node_is_being_made_ends_the_process_at_once(number) -> None:
    handlers = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}

    def interrupted(stop: StopFlag) -> DataNode:
        os.kill(os.getpid(), number)
        raise ArmError('could not wait for the rest')

    try:
        with pytest.raises(SystemExit) as end:
            run_node('controller', interrupted, [])
        assert end.value.code == 128 + number
    finally:
        for n, handler in handlers.items():
            signal.signal(n, handler)
        rclpy.try_shutdown()


@pytest.mark.parametrize('kind', [ControllerNode, ArmDriver])
def test_an_arm_is_built_from_the_urdf_on_a_latched_topic(graph, pair_urdf, kind) -> None:
    pytest.importorskip('pinocchio')
    publisher = graph.peer().create_publisher(
        String, '/left/robot_description',
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    publisher.publish(String(data=pair_urdf))
    node = graph.make(kind, namespace='/left', arm='urdf', urdf='topic:robot_description',
                      joints=['shoulder', 'elbow'])
    assert node.arm.joints == ('shoulder', 'elbow')
    assert node.count_subscribers('/left/robot_description') == 0  # heard once, then let go
    gravity = node.arm.Y2(np.zeros(2), np.zeros(2)) @ node.arm.nominal
    np.testing.assert_allclose(np.abs(gravity), [9.81 * 2.0 * (0.2 + 0.6), 9.81 * 2.0 * 0.2],
                               rtol=1e-6)


def test_the_driver_describes_its_arm_to_those_who_come_late(graph, wait_until) -> None:
    driver = graph.make(ArmDriver, namespace='/left')
    late = graph.peer().listen(String, '/left/robot_description', QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    wait_until(lambda: late, what='the description')
    text = deserialize_message(late[0][0], String).data
    assert [joint.name for joint in urdf_joints(text)] == list(driver.arm.joints)


def test_a_description_that_comes_from_a_topic_is_not_published_again(graph, pair_urdf) -> None:
    pytest.importorskip('pinocchio')
    publisher = graph.peer().create_publisher(
        String, 'robot_description',
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    publisher.publish(String(data=pair_urdf))
    driver = graph.make(ArmDriver, arm='urdf', urdf='topic:robot_description',
                        joints=['shoulder', 'elbow'])
    assert driver.count_publishers('robot_description') == 1


def test_a_urdf_that_does_not_come_is_an_error_that_names_the_topic(graph, monkeypatch) -> None:
    monkeypatch.setattr(robot_description, 'URDF_TIMEOUT', 0.2)
    with pytest.raises(ArmError, match="no URDF arrived on topic 'nowhere' within 0.2 s"):
        graph.make(ControllerNode, arm='urdf', urdf='topic:nowhere', joints=['shoulder', 'elbow'])


def test_a_urdf_without_the_joints_is_refused_by_name(graph, pair_urdf) -> None:
    pytest.importorskip('pinocchio')
    publisher = graph.peer().create_publisher(
        String, 'robot_description',
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    publisher.publish(String(data=pair_urdf))
    with pytest.raises(ArmError, match='wrist'):
        graph.make(ControllerNode, arm='urdf', urdf='topic:robot_description',
                   joints=['shoulder', 'wrist'])
