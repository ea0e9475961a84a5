# SPDX-License-Identifier: Apache-2.0
"""The SROS 2 policy grants our topics, and everything the running nodes use, and no more."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rclpy.node import Node, NodeNameNonExistentError

from adaptive_blf_control.executables import NODES
from adaptive_blf_control.messages.topics import (
    JOINT_TRAJECTORY,
    OBSTACLES,
    PARAMETER_SET,
    TOPICS,
)
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.nodes.parameter_survey import ParameterSurvey
from adaptive_blf_control.nodes.recorder import Recorder

KINDS = {'arm_driver': ArmDriver, 'controller': ControllerNode, 'identifier': IdentifierNode,
         'recorder': Recorder}
COMMON = {'/rosout', '/parameter_events'}
MANAGED = {'/arm_driver/transition_event', '/controller/transition_event'}
# What the driver uses under use_sim_time only; the others use no less there.
LOCKSTEP = {'publish': {'/clock'},
            'subscribe': {f'/{topic.name}' for topic in TOPICS.values()
                          if 'arm_driver' in topic.lockstep_subscribers}}
# With which the controller hears everything that it may.
LEARNS = {'safety_filter': 'limits', 'limits__learn': True, 'limits__velocity': [20.0]}
Granted = dict[str, dict[str, set[str]]]


@pytest.fixture(scope='module')
def policy(repository: Path) -> Granted:
    """Return what each node is granted: full names by publish, subscribe, reply, request."""
    root = ElementTree.parse(repository / 'config' / 'sros2_policy.xml').getroot()
    assert (root.tag, root.get('version')) == ('policy', '0.2.0')
    granted: Granted = {}
    for enclave in root.findall('enclaves/enclave'):
        profile = enclave.find('profiles/profile')
        assert profile is not None
        node, namespace = profile.get('node'), profile.get('ns')
        assert (enclave.get('path'), namespace) == (f'/adaptive_blf_control/{node}', '/')
        rules = granted[node] = {'publish': set(), 'subscribe': set(), 'reply': set(),
                                 'request': set()}
        for block in profile:
            (use, verdict), = block.attrib.items()
            assert verdict == 'ALLOW'
            assert (block.tag == 'topics') == (use in ('publish', 'subscribe'))
            for entry in block:
                assert f'{entry.tag}s' == block.tag
                name = entry.text
                rules[use].add(name if name.startswith('/') else
                               f'/{node}{name[1:]}' if name.startswith('~') else f'/{name}')
    return granted


def test_policy_has_one_enclave_for_every_node(policy: Granted) -> None:
    assert set(policy) == set(NODES)


def test_policy_grants_every_topic_of_ours_once_to_publish_and_nothing_foreign(
        policy: Granted) -> None:
    ours = {_absolute(topic) for topic in TOPICS}
    published = [topic for rules in policy.values() for topic in rules['publish'] - COMMON
                 if topic != '/diagnostics']
    # A trajectory comes from a planner, obstacles from who sees them: neither is one of ours.
    assert sorted(published) == sorted((ours | MANAGED) - COMMON - {
        '/diagnostics', _absolute(JOINT_TRAJECTORY), _absolute(OBSTACLES)})
    heard = set().union(*(rules['subscribe'] for rules in policy.values()))
    assert heard == ours == policy['recorder']['subscribe']
    for rules in policy.values():
        assert {'/diagnostics', *COMMON} <= rules['publish']


def _absolute(topic: str) -> str:
    return '/' + topic.lstrip('/')


def test_only_the_controller_may_command_and_only_the_driver_listens(policy: Granted) -> None:
    commands = '/effort_controller/commands'
    assert [node for node, rules in policy.items() if commands in rules['publish']] == [
        'controller']
    assert {node for node, rules in policy.items() if commands in rules['subscribe']} == {
        'arm_driver', 'recorder'}


@pytest.mark.parametrize('lockstep', [False, True])
def test_everything_a_running_node_uses_is_granted_and_the_other_way_round(
        graph, graph_of: Callable, wait_until: Callable, tmp_path: Path, policy: Granted,
        monkeypatch: pytest.MonkeyPatch, lockstep: bool) -> None:
    # What the recorder asks with is in the graph only until it is answered, else.
    monkeypatch.setattr(ParameterSurvey, '_end', lambda *_: None)
    made = {name: graph.make(kind, use_sim_time=lockstep, **(
        {'bag': str(tmp_path / 'bag')} if name == 'recorder' else {'initial_estimate': [1.0]}
        if name in ('controller', 'identifier') else {}),
        **(LEARNS if name == 'controller' and not lockstep else {}))
        for name, kind in KINDS.items()}
    for node in made.values():
        graph.run(node)
    wait_until(lambda: made['controller'].output, what='the controller, which has the arm now')
    # The recorder asks each of the others for its parameters, once it hears it.
    others = {f'/{name}' for name in KINDS} - {'/recorder'}
    wait_until(lambda: others <= set(made['recorder'].survey.clients),
               what='clients of the recorder')
    # From outside, as `ros2 node info` looks.
    observer = graph_of(graph.context.get_domain_id()).peer()
    for name in made:
        granted = {use: set(names) for use, names in policy[name].items()}
        granted['subscribe'] -= {'/clock'}  # heard at most while a node is being made
        if lockstep:
            granted['subscribe'] -= set() if name == 'recorder' else {
                _absolute(PARAMETER_SET)}  # with limits.learn only
        for use in LOCKSTEP if name == 'arm_driver' and not lockstep else ():
            granted[use] -= LOCKSTEP[use]
        seen: list[object] = []  # what the graph tells of a node comes bit by bit

        def agrees(name=name, granted=granted, seen=seen) -> bool:
            seen[:] = [_used(observer, name)]
            return seen[0] == granted

        with suppress(pytest.fail.Exception):  # the difference says more
            wait_until(agrees)
        assert seen[0] == granted, f'config/sros2_policy.xml has to follow {name}'


def _used(observer: Node, node: str) -> dict[str, set[str]]:
    """Return what a node has in the graph: full names by publish, subscribe, reply, request.

    Without what the recorder asks the observer, which has come into its graph.
    """
    queries = {'publish': observer.get_publisher_names_and_types_by_node,
               'subscribe': observer.get_subscriber_names_and_types_by_node,
               'reply': observer.get_service_names_and_types_by_node,
               'request': observer.get_client_names_and_types_by_node}
    found: dict[str, set[str]] = {}
    for use, query in queries.items():
        try:
            found[use] = {name for name, _ in query(node, '/') if not name.startswith('/peer/')}
        except NodeNameNonExistentError:  # not discovered yet
            found[use] = set()
    return found


def test_a_node_without_its_keys_refuses_to_start_where_security_is_enforced(
        processes, tmp_path: Path) -> None:
    processes.environment.update(
        ROS_SECURITY_ENABLE='true', ROS_SECURITY_STRATEGY='Enforce',
        ROS_SECURITY_KEYSTORE=str(tmp_path))
    enclave = '/adaptive_blf_control/identifier'
    node = processes.start('identifier', '--ros-args', '--enclave', enclave)
    assert node.wait() == 2
    assert f'{tmp_path}/enclaves{enclave}' in node.text
