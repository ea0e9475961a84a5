# SPDX-License-Identifier: Apache-2.0
"""The identifier node publishes the consistent model beside its loop and writes it on request."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from adaptive_blf_control.arms.pseudo_inertia import pseudo_inertias
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.identification.given_parameters import read_estimate
from adaptive_blf_control.messages.joint_state import decode_joint_state, JointStateCodec
from adaptive_blf_control.messages.topics import CONSISTENT_MODEL, THETA_STD
from adaptive_blf_control.nodes.identifier import IdentifierNode
from spatial_arm import JOINTS, spatial_arm, true_theta, URDF

PERIOD = 0.004
EPOCH = 1_700_000_000 * 10**9


@pytest.fixture(scope='module')
def arm() -> UrdfArm:
    return spatial_arm()


@pytest.fixture(scope='module')
def states(arm: UrdfArm) -> list[bytes]:
    """Return 3 s of joint states of another robot than the described one, with noise."""
    codec, random, theta = JointStateCodec(JOINTS), np.random.default_rng(1), true_theta(arm)
    rates = np.array([2.1, 3.3, 4.7])
    result = []
    for k in range(750):
        t = PERIOD * k
        q, qd = 0.8 * np.sin(rates * t), 0.8 * rates * np.cos(rates * t)
        qdd = -0.8 * rates ** 2 * np.sin(rates * t)
        tau = arm.Y(q, qd, qdd) @ theta + random.normal(scale=0.5, size=3)
        result.append(codec.encode(EPOCH + round(t * 1e9), q, qd, tau))
    return result


@pytest.fixture
def make(graph, tmp_path):
    """Return ``make(**parameters)``: an identifier of the arm."""
    urdf = tmp_path / 'arm.urdf'
    urdf.write_text(URDF, encoding='utf-8')

    def of(**parameters) -> IdentifierNode:
        return graph.make(IdentifierNode, arm='urdf', urdf=str(urdf), joints=list(JOINTS),
                          friction__coulomb=True, friction__offset=True,
                          friction__square_root=True, friction__rotor_inertia=True,
                          filter__time_constant=0.02, history__size=100, kh=1000.0,
                          change__window=0.0, **parameters)
    return of


def test_the_model_is_written_with_its_urdf_on_request(graph, make, states, arm, tmp_path) -> None:
    path = tmp_path / 'model.yaml'
    node = make(model_file=str(path))
    for state in states:
        node.on_joint_states(state, {})
    graph.run(node)
    answer = graph.peer().call(Trigger, '/identifier/save_model')
    assert (answer.success, answer.message) == (True, f'{path} {tmp_path / "model.urdf"}')
    theta = read_estimate(path, arm.parameters)
    back = UrdfArm(tmp_path / 'model.urdf', JOINTS, friction_coulomb=True)
    assert not np.array_equal(theta, node.identifier.theta)
    for q in np.random.default_rng(2).uniform(-2.0, 2.0, (50, 3)):
        assert np.linalg.eigvalsh(arm.mass_matrix(q, theta))[0] > 0.0
    np.testing.assert_array_equal(back.friction(back.nominal)[:2], arm.friction(theta)[:2])
    assert np.all(np.linalg.eigvalsh(pseudo_inertias(back.inertial))[:, 0] > 0.0)


def test_it_is_published_with_the_standard_deviations_every_period(
        graph, make, states, arm, wait_until) -> None:
    node, peer = make(model_period=0.5), graph.peer()
    heard = [peer.listen(JointState, f'/{topic}') for topic in (CONSISTENT_MODEL, THETA_STD)]
    for state in states:
        node.on_joint_states(state, {})
    graph.run(node)
    for each in heard:
        wait_until(lambda each=each: len(each) > 1, what='two messages')
    model, std = (decode_joint_state(each[-1][0]) for each in heard)
    assert model.names == std.names == arm.parameters
    assert model.stamp_ns == std.stamp_ns == EPOCH + round(749 * PERIOD * 1e9)
    assert np.linalg.eigvalsh(arm.mass_matrix(np.zeros(3), model.position))[0] > 0.0
    error = np.abs(node.identifier.theta - true_theta(arm))
    known = np.isfinite(std.position)
    assert known.any()
    assert np.mean(error[known] < 3.0 * std.position[known]) > 0.9


def test_publication_can_be_switched_off_and_on(graph, make, states, wait_until) -> None:
    node, peer = make(model_period=0.0), graph.peer()
    heard = peer.listen(JointState, f'/{THETA_STD}')
    for state in states:
        node.on_joint_states(state, {})
    graph.run(node)
    assert node.set_parameters([Parameter('model_period', value=0.5)])[0].successful
    wait_until(lambda: heard, what='a message')


def test_an_arm_without_links_has_standard_deviations_and_no_model(graph, tmp_path) -> None:
    node = graph.make(IdentifierNode, model_file=str(tmp_path / 'model.yaml'))
    graph.run(node)
    answer = graph.peer().call(Trigger, '/identifier/save_model')
    assert not answer.success
    assert 'TwoLinkArm has no inertial parameters per link' in answer.message
    assert not list(Path(tmp_path).iterdir())


def test_before_the_first_pair_there_is_nothing_to_write(graph, make) -> None:
    graph.run(make())
    answer = graph.peer().call(Trigger, '/identifier/save_model')
    assert (answer.success, answer.message) == (False, 'no pair was recorded yet')
