# SPDX-License-Identifier: Apache-2.0
"""The identifier node publishes the load that it finds."""

from __future__ import annotations

from geometry_msgs.msg import InertiaStamped
import numpy as np
import pytest
from rclpy.serialization import deserialize_message

from adaptive_blf_control.arms.load_frame import load_map
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_changes
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.estimate_file import write_estimate
from adaptive_blf_control.identification.knowledge import Snapshot
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.topics import (
    JOINT_STATES,
    PAYLOAD,
    PAYLOAD_STD,
)
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.report.panels import sections
from adaptive_blf_control.runs.bag_observer import BagObserver
from adaptive_blf_control.runs.recording import read_recording
from spatial_arm import JOINTS, spatial_arm, true_theta, URDF

PERIOD = 0.004
EPOCH = 1_700_000_000 * 10**9
LOAD = np.array([1.5, 0.03, 0.0, 0.06, 0.005, 0.0, 0.006, -0.001, 0.0, 0.004])  # π at the tool


@pytest.fixture(scope='module')
def arm() -> UrdfArm:
    return spatial_arm()


@pytest.fixture(scope='module')
def states(arm: UrdfArm) -> list[bytes]:
    """Return 5 s of joint states of another robot than the described one, loaded from 2 s on."""
    codec, random, theta = JointStateCodec(JOINTS), np.random.default_rng(1), true_theta(arm)
    rates, added = np.array([2.1, 3.3, 4.7]), load_map(arm, 'tool') @ LOAD
    result, before = [], np.zeros(3)
    for k in range(1250):
        t = PERIOD * k
        q, qd = 0.8 * np.sin(rates * t), 0.8 * rates * np.cos(rates * t)
        qdd = -0.8 * rates ** 2 * np.sin(rates * t)
        tau = arm.Y(q, qd, qdd) @ (theta + added * (t >= 2.0))
        mean, before = 0.5 * (before + tau), tau  # over the interval that ends here
        result.append(codec.encode(EPOCH + round(t * 1e9), q, qd,
                                   mean + random.normal(scale=0.1, size=3)))
    return result


@pytest.fixture
def make(graph, tmp_path, arm):
    """Return ``make(**parameters)``: an identifier of the arm, with a model without the load."""
    urdf, baseline = tmp_path / 'arm.urdf', tmp_path / 'theta_hat.yaml'
    urdf.write_text(URDF, encoding='utf-8')
    write_estimate(baseline, Snapshot(arm.parameters, true_theta(arm), arm.m, 1.0, 100))

    def of(**parameters) -> IdentifierNode:
        return graph.make(IdentifierNode, **{
            'arm': 'urdf', 'urdf': str(urdf), 'joints': list(JOINTS),
            'friction__coulomb': True, 'friction__offset': True, 'friction__square_root': True,
            'friction__rotor_inertia': True, 'filter__time_constant': 0.02,
            'history__size': 100, 'change__window': 0.0, 'model_period': 0.0,
            'payload__frame': 'tool', 'payload__baseline': str(baseline), **parameters})
    return of


def test_the_load_is_published_with_its_standard_deviations(graph, make, states,
                                                            wait_until) -> None:
    node, peer = make(), graph.peer()
    heard = [peer.listen(InertiaStamped, f'/{topic}') for topic in (PAYLOAD, PAYLOAD_STD)]
    wait_until(lambda: all(node.count_subscribers(f'/{topic}') for topic in (PAYLOAD,
                                                                             PAYLOAD_STD)),
               what='both subscriptions')
    for state in states:
        node.on_joint_states(state, {})

    def last_is_here() -> bool:
        if not all(heard):
            return False
        found = deserialize_message(bytes(heard[0][-1][0]), InertiaStamped).inertia
        return (found.ixz == node.payload.estimate.load.inertia[3]
                and stamp_of(heard[1][-1][0]) == stamp_of(heard[0][-1][0]))

    wait_until(last_is_here, what='the last load')
    first = deserialize_message(bytes(heard[0][0][0]), InertiaStamped)
    last, std = (deserialize_message(bytes(each[-1][0]), InertiaStamped) for each in heard)
    assert first.inertia.m == 0.0
    assert last.header.frame_id == std.header.frame_id == 'tool'
    assert last.inertia.m == pytest.approx(1.5, rel=0.05)
    assert last.inertia.com.x == pytest.approx(0.02, abs=0.01)
    assert last.inertia.com.z == pytest.approx(0.04, abs=0.01)
    assert 0.0 < std.inertia.m < 0.1
    assert stamp_of(heard[0][-1][0]) > EPOCH + 4.5e9
    assert '1.5' in node.status()[2]['payload']
    assert node.status()[2]['changes of the payload'] == 1


def test_a_load_that_was_there_at_the_start_is_found_from_the_model_without_it(
        make, states, tmp_path) -> None:
    """The identifier too begins with that model; the states begin under the load."""
    node = make(initial_estimate=str(tmp_path / 'theta_hat.yaml'))
    for state in states[500:575]:
        node.on_joint_states(state, {})
    assert node.status()[2]['payload'].startswith('not known yet')
    for state in states[575:]:
        node.on_joint_states(state, {})
    found = node.payload.estimate
    assert found.attached
    assert found.since < 0.5
    assert abs(found.load.mass - 1.5) < 1.96 * found.std.mass < 0.2
    assert node.status()[2]['changes of the payload'] == 1


def test_without_a_load_the_mass_is_told_above_which_there_is_none(make, states) -> None:
    node = make()
    for state in states[:490]:
        node.on_joint_states(state, {})
    assert node.status()[2]['payload'].startswith('no load above 0.')


def stamp_of(data: bytes) -> int:
    stamp = deserialize_message(bytes(data), InertiaStamped).header.stamp
    return stamp.sec * 10**9 + stamp.nanosec


def test_no_load_is_looked_for_without_a_frame(make, states) -> None:
    node = make(payload__frame='')
    for state in states[:300]:
        node.on_joint_states(state, {})
    assert node.payload.estimate is None
    assert 'payload' not in node.status()[2]


def test_states_without_effort_say_nothing_of_the_load(make, states) -> None:
    node, codec = make(), JointStateCodec(JOINTS)
    for k in range(300):
        node.on_joint_states(codec.encode(EPOCH + k * 4_000_000, np.zeros(3), np.zeros(3),
                                          np.full(3, np.nan)), {})
    assert node.payload.estimate is None
    assert node.status()[2]['payload'] == 'not known yet'


def test_a_frame_that_is_not_there_is_refused_with_those_that_are(make) -> None:
    with pytest.raises(ParameterError, match='one of column, upper, fore, tool') as caught:
        make(payload__frame='palm')
    assert caught.value.name == 'identifier.payload.frame'


def test_a_model_of_another_robot_is_refused(make, tmp_path, arm) -> None:
    other = tmp_path / 'other.yaml'
    names = tuple(name.replace('bend', 'elbow') for name in arm.parameters)
    write_estimate(other, Snapshot(names, true_theta(arm), arm.m, 1.0, 100))
    with pytest.raises(ParameterError, match='parameters of this arm.*elbow|bend') as caught:
        make(payload__baseline=str(other))
    assert caught.value.name == 'identifier.payload.baseline'


def test_a_model_with_more_friction_than_the_arm_has_is_refused(make) -> None:
    with pytest.raises(ParameterError, match='fs_'):
        make(friction__square_root=False)


def test_a_model_that_cannot_be_read_is_refused(make, tmp_path) -> None:
    with pytest.raises(ParameterError, match='readable file'):
        make(payload__baseline=str(tmp_path / 'missing.yaml'))


def test_the_bag_of_a_simulation_holds_what_the_node_publishes(graph, make, tmp_path,
                                                               wait_until) -> None:
    """A load is attached at 1 s: `simulate --bag` and the node say the same, byte for byte."""
    urdf = tmp_path / 'arm.urdf'
    urdf.write_text(URDF, encoding='utf-8')
    swing = {joint: {'amplitude': 0.4, 'frequency': rate} for joint, rate in zip(
        JOINTS, (2.1, 3.3, 4.7))}
    data = apply_changes({}, {
        'arm': 'urdf', 'urdf': str(urdf), 'joints': list(JOINTS), 'initial_estimate': 'nominal',
        'arm_driver': {'rate': 250.0, 'schedule': {'time': [1.0], 'parameter': ['payload'],
                                                   'value': [1.5]}},
        'controller': {'k2': 20.0, 'safety': {'lower': -2.0, 'upper': 2.0},
                       'performance': {'lower': -0.5, 'upper': 0.5}, 'reference': swing},
        'identifier': {'filter.time_constant': 0.02, 'history.size': 30,
                       'payload': {'frame': 'tool'}}})
    loop = build_closed_loop(data)
    with BagObserver(tmp_path / 'bag', loop, data) as observer:
        loop.run(2.5, observer)
    bag = read_bag(tmp_path / 'bag')
    simulated = {topic: [message.data for message in bag.messages((f'/{topic}',))]
                 for topic in (JOINT_STATES, PAYLOAD)}
    recording = read_recording(tmp_path / 'bag')
    assert recording.payload.values[-1, 0] == pytest.approx(1.5, rel=0.05)
    panel = next(part for part in sections([recording], [None]) if part.key == 'payload')
    assert panel.panels[0].curves[0].y[-1] == recording.payload.values[-1, 0]

    node, peer = make(friction__coulomb=False, friction__offset=False,
                      friction__square_root=False, friction__rotor_inertia=False,
                      payload__baseline='nominal', initial_estimate='nominal', kt=10.0, kh=10.0,
                      history__size=30, change__window=0.1), graph.peer()
    heard = peer.listen(InertiaStamped, f'/{PAYLOAD}')
    wait_until(lambda: node.count_subscribers(f'/{PAYLOAD}'), what='the subscription')
    for state in simulated[JOINT_STATES]:
        node.on_joint_states(state, {})
    wait_until(lambda: len(heard) == len(simulated[PAYLOAD]), what='every load')
    assert [bytes(message[0]) for message in heard] == simulated[PAYLOAD]
