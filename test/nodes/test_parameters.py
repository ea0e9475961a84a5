# SPDX-License-Identifier: Apache-2.0
"""The table of a node is its ROS parameters: descriptors, refusals at start and while it runs."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
import importlib
import os
from pathlib import Path
import re
import signal
import time

import numpy as np
import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, SetParametersAtomically
import rclpy
from rclpy.context import Context
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter

from adaptive_blf_control.configuration.node_settings import TABLES
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.executables import entry_of, NODES
from adaptive_blf_control.nodes.arm_driver import ArmDriver
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.nodes.recorder import Recorder
from adaptive_blf_control.parameters.table import per_joint
from adaptive_blf_control.runtime import process

KINDS = {'arm_driver': ArmDriver, 'identifier': IdentifierNode, 'controller': ControllerNode,
         'recorder': Recorder}


@pytest.fixture
def start(capfd) -> Iterator[Callable[..., tuple[int, str]]]:
    """Return ``start(kind, *ros_args)``: main() in this process; exit status and stderr."""
    handlers = {number: signal.getsignal(number)
                for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}

    def run(kind: str, *arguments: str) -> tuple[int, str]:
        capfd.readouterr()
        module, function = entry_of(kind)
        status = getattr(importlib.import_module(module), function)(['--ros-args', *arguments])
        return status, capfd.readouterr().err

    yield run
    rclpy.try_shutdown()
    for number, handler in handlers.items():
        signal.signal(number, handler)


def _file(folder: Path, text: str) -> str:
    path = folder / 'parameters.yaml'
    path.write_text(text, encoding='utf-8')
    return str(path)


@pytest.mark.parametrize('kind', NODES)
def test_every_parameter_of_the_table_is_declared_with_text_type_and_access(
        graph, tmp_path: Path, kind: str) -> None:
    given = {'bag': str(tmp_path / 'bag')} if kind == 'recorder' else {}
    node = graph.make(KINDS[kind], **given)
    table = per_joint(TABLES[kind], ['joint1', 'joint2'])
    assert set(table) <= set(node.get_parameters_by_prefix(''))
    for name, parameter in table.items():
        descriptor = node.describe_parameter(name)
        assert parameter.description in descriptor.description
        assert f'[{parameter.unit}]' in descriptor.description or not parameter.unit
        assert descriptor.read_only == parameter.read_only
        assert descriptor.type == getattr(ParameterType, 'PARAMETER_' + {
            'int': 'INTEGER'}.get(parameter.kind, parameter.kind.upper()))
        value = node.get_parameter(name).value
        assert given.get(name, parameter.default) == (
            list(value) if parameter.is_array else value)


def test_no_attribute_of_ours_takes_the_place_of_one_of_rclpy(graph, repository: Path) -> None:
    theirs = set(vars(graph.add(LifecycleNode('plain', context=graph.context))))
    checked = []
    for source in (repository / 'adaptive_blf_control').glob('*/*.py'):
        for kind in ast.walk(ast.parse(source.read_text(encoding='utf-8'))):
            if isinstance(kind, ast.ClassDef) and any(
                    re.search(r'(Node|Driver)\b', ast.unparse(base)) for base in kind.bases):
                checked.append(kind.name)
                assert not _assigned(kind) & theirs, f'{source.name}: {kind.name}'
    assert {'DataNode', 'ManagedNode', 'ControllerNode', 'IdentifierNode', 'ArmDriver',
            'Recorder'} <= set(checked)


def _assigned(kind: ast.ClassDef) -> set[str]:
    """Return the attributes that a class sets."""
    return {target.attr for node in ast.walk(kind) if isinstance(node, (ast.Assign, ast.AnnAssign))
            for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
            if isinstance(target, ast.Attribute)}


@pytest.mark.parametrize('given', [{}, {'rate': 500.0, 'substeps': 3, 'torque_limit': [5.0]}])
def test_ranges_stand_in_the_descriptors_given_or_default(graph, given) -> None:
    node = graph.make(ArmDriver, **given)
    rate = node.describe_parameter('rate').floating_point_range[0]
    assert (rate.from_value, rate.to_value) == (1.0, 10000.0)
    substeps = node.describe_parameter('substeps').integer_range[0]
    assert (substeps.from_value, substeps.to_value) == (1, 1000)
    limit = node.describe_parameter('torque_limit')
    assert '> 0 N*m' in limit.additional_constraints
    assert 'length 1 or one for each of the joints' in limit.additional_constraints
    assert 'two_link' in node.describe_parameter('arm').additional_constraints


REFUSED = [  # kind, given, what the message has to hold
    ('controller', {'k9': [3.0]}, ['controller.k9', '[3.0]', 'no such parameter', 'k1', 'k2']),
    ('controller', {'safety.lowr': [3.0]}, ['controller.safety.lowr', 'safety.lower']),
    ('controller', {'state_timeout': 1}, ['controller.state_timeout', 'is 1:', 'write 1.0']),
    ('controller', {'k1': [3, 4]}, ['controller.k1', '[3, 4]', 'write 3.0']),
    ('controller', {'k1': 3.0}, ['controller.k1', 'is 3.0:', 'list of doubles']),
    ('controller', {'k1': [1.0, 2.0, 3.0]}, ['controller.k1', '[1.0, 2.0, 3.0]',
                                             'length 1 or 2 (one for each of the joints)']),
    ('controller', {'k1': [1.0, float('nan')]}, ['controller.k1', 'not NaN']),
    ('controller', {'k1': [float('inf')]}, ['controller.k1', 'inf']),
    ('controller', {'k2': [0.0]}, ['controller.k2', '[0.0]', '> 0 N*m*s/rad']),
    ('controller', {'coupling': 'strong'}, ['controller.coupling', "'strong'", 'per_joint']),
    ('controller', {'model': True}, ['controller.model', 'True', 'one of estimated, known']),
    ('controller', {'initial_estimate': [0.0, 1.0]}, ['controller.initial_estimate',
                                                      'length 1 or 5']),
    ('controller', {'joints': ['elbow', 'elbow']}, ['joints', "['elbow', 'elbow']", 'distinct']),
    ('controller', {'joints': ['a', 'b', 'c']}, ['two joints', "['a', 'b', 'c']"]),
    ('controller', {'reference.joint1.amplitude': [1.0, 2.0]},
     ['reference.joint1', '2 of amplitude, 1 of frequency', 'same length']),
    ('controller', {'reference.joint3.offset': 0.0}, ['reference.joint3.offset',
                                                      'no such parameter']),
    ('controller', {'performance.lower': [0.1]}, ['performance', '0.1', 'lower < 0 < upper']),
    ('controller', {'safety.upper': [-4.0]}, ['safety.lower', '-4.0']),
    ('arm_driver', {'rate': 0.5}, ['arm_driver.rate', '0.5', '>= 1 and <= 10000 Hz']),
    ('arm_driver', {'substeps': 0}, ['arm_driver.substeps', 'is 0:', '>= 1']),
    ('arm_driver', {'substeps': 1.0}, ['arm_driver.substeps', '1.0', 'an integer']),
    ('arm_driver', {'true_model': 'given', 'true_parameters': [1.0]},
     ['arm_driver.true_parameters', '[1.0]', '5 values']),
    ('arm_driver', {'arm': 'urdf'}, ["'urdf'", 'a path, package://... or topic:NAME']),
    ('identifier', {'gamma': [1.0, 2.0]}, ['identifier.gamma', '[1.0, 2.0]', 'length 1 or 5']),
    ('identifier', {'history.size': 0}, ['identifier.history.size', '>= 1']),
    ('identifier', {'initial_estimate_file': '/nowhere/theta.yaml'},
     ['initial_estimate_file', '/nowhere/theta.yaml', 'readable']),
    ('recorder', {'flush_period': 2.0}, ['recorder.flush_period', '2.0', '<= 1 s']),
]


@pytest.mark.parametrize(('kind', 'given', 'words'), REFUSED,
                         ids=[f'{kind}-{next(iter(given))}-{i}'
                              for i, (kind, given, _) in enumerate(REFUSED)])
def test_a_bad_value_is_refused_by_name_and_value_with_what_is_expected(
        graph, kind, given, words) -> None:
    with pytest.raises(ValueError) as error:
        graph.make(KINDS[kind], **given)
    for word in words:
        assert word in str(error.value)


def test_an_empty_list_is_refused_by_name(graph) -> None:
    with pytest.raises(ParameterError, match=r"'controller\.k1' is \[\]: .*at least one element"):
        graph.make(ControllerNode, k1=None)


def test_what_another_node_knows_is_let_pass_but_not_declared(graph) -> None:
    node = graph.make(ControllerNode, rate=100.0, kt=1.0, bag='b')
    assert not any(node.has_parameter(name) for name in ('rate', 'kt', 'bag'))


@pytest.mark.parametrize(('text', 'words'), [
    ('/**/controller:\n  ros__parameters:\n    k1: [3.0, 4.0\n', ['parameters.yaml', 'line 4']),
    ('just words\n', ['parameters.yaml', 'a mapping of node names']),
    ('/**/controller:\n  k1: [3.0]\n', ['parameters.yaml', '/**/controller', 'ros__parameters']),
    ('/**/controller:\n  ros__parameters:\n    k1: [40.0, 40]\n',
     ['controller.k1', '[40.0, 40]', 'write 40.0']),
    ('/**/controller:\n  ros__parameters:\n    k1:\n', ['controller.k1', 'None', 'a list']),
    ('/**/controller:\n  ros__parameters:\n    k1: []\n', ['controller.k1', 'at least one']),
    ('/**/controller:\n  ros__parameters:\n    k1: [3, 4]\n', ['controller.k1', 'write 3.0']),
    ('/**/controller:\n  ros__parameters:\n    state_timeout: 1\n', ['_timeout', 'write 1.0']),
    ('/**/controller:\n  ros__parameters:\n    k9: 1.0\n', ['controller.k9', 'no such parameter']),
    ('/**:\n  ros__parameters:\n    k9: 1.0\n', ['k9', 'no such parameter']),
    ('/**:\n  ros__parameters:\n    safety: {lower: [-0.1]}\n',
     ["joint 'joint1'", '-0.15 rad against -0.1 rad']),
], ids=['malformed', 'no mapping', 'no ros__parameters', 'mixed list', 'no value', 'empty list',
        'integers', 'integer', 'unknown', 'unknown in shared', 'performance exceeds'])
def test_a_faulty_file_ends_the_node_with_one_clear_line(start, tmp_path, text, words) -> None:
    status, errors = start('controller', '--params-file', _file(tmp_path, text))
    assert status == 2
    assert errors.startswith('controller: ')
    assert 'Traceback' not in errors
    assert '[ERROR]' not in errors
    for word in words:
        assert word in errors
    assert errors.count('\n') == 1 or words[-1] == 'line 4'  # YAML's own error shows the place


def test_a_missing_file_is_named(start, tmp_path: Path) -> None:
    path = tmp_path / 'no_such.yaml'
    status, errors = start('controller', '--params-file', str(path))
    assert (status, errors.count('\n')) == (2, 1)
    assert str(path) in errors
    assert 'No such file' in errors


@pytest.mark.parametrize(('argument', 'word'), [('--bogus', '--bogus'), ('-p', '-p')])
def test_arguments_that_ros_does_not_know_are_named(start, argument, word) -> None:
    status, errors = start('identifier', argument)
    assert (status, errors.count('\n')) == (2, 1)
    assert errors.startswith('identifier: ')
    assert word in errors


def test_a_value_that_comes_before_the_file_that_beats_it_is_refused(start, tmp_path) -> None:
    path = _file(tmp_path, '/**/arm_driver:\n  ros__parameters:\n    rate: 500.0\n')
    status, errors = start('arm_driver', '-p', 'arm_driver:rate:=100.0', '--params-file', path)
    assert (status, errors.count('\n')) == (2, 1)
    assert "'-p arm_driver:rate' is '100.0'" in errors
    assert '--params-file before' in errors
    assert '500.0' in errors


def test_a_process_with_a_bad_parameter_exits_with_one_line(processes, tmp_path) -> None:
    path = _file(tmp_path, '/**/controller:\n  ros__parameters:\n    k1: [3, 4]\n')
    process = processes.start('controller', '--ros-args', '--params-file', path)
    assert process.wait() == 2
    assert process.text == ("controller: parameter 'controller.k1' is [3, 4]: expected a list in "
                            'which every element is a floating-point number: write 3.0\n')


@pytest.mark.parametrize('namespace', ['', '/left', '/left/arm'])
@pytest.mark.parametrize('key', ['/**', '/**/controller'])
def test_wildcard_sections_match_under_any_namespace(tmp_path, key, namespace) -> None:
    path = _file(tmp_path, f'{key}:\n  ros__parameters:\n    k1: [7.0, 8.0]\n')
    remap = ['-r', f'__ns:={namespace}'] if namespace else []
    context = Context()
    context.init(args=['--ros-args', '--params-file', path, *remap], domain_id=1)
    node = None
    try:
        node = ControllerNode(context=context)
        assert node.get_namespace() == (namespace or '/')
        assert node.settings.values()['k1'] == [7.0, 8.0]
        assert node.resolve_topic_name('joint_states') == f'{namespace}/joint_states'
    finally:
        if node is not None:
            node.destroy_node()
        context.shutdown()


def test_a_section_of_another_name_is_not_for_this_node(tmp_path) -> None:
    path = _file(tmp_path, '/**/identifier:\n  ros__parameters:\n    nonsense: 1\n'
                           '/right/controller:\n  ros__parameters:\n    k1: [7.0]\n')
    context = Context()
    context.init(args=['--ros-args', '--params-file', path, '-r', '__ns:=/left'], domain_id=1)
    try:
        node = ControllerNode(context=context)
        assert node.settings.values()['k1'] == [40.0]
        node.destroy_node()
    finally:
        context.shutdown()


def _set(node, **values):
    return node.set_parameters_atomically([Parameter(name, value=value)
                                           for name, value in values.items()])


def test_gains_may_change_while_the_node_runs(graph) -> None:
    node = graph.make(ControllerNode)
    assert _set(node, k1=[50.0, 60.0], coupling='pseudoinverse').successful
    assert node.settings.values()['k1'] == [50.0, 60.0]
    assert node.settings.values()['coupling'] == 'pseudoinverse'
    identifier = graph.make(IdentifierNode)
    assert _set(identifier, gamma=[1.0, 2.0, 3.0, 4.0, 5.0], kt=3.0).successful
    np.testing.assert_array_equal(identifier.identifier.settings.gamma, [1.0, 2.0, 3.0, 4.0, 5.0])
    assert identifier.identifier.settings.kt == 3.0


@pytest.mark.parametrize(('values', 'words'), [
    ({'k1': [50.0], 'k2': [-1.0]}, ['controller.k2', '-1.0', '> 0']),
    ({'k1': [50.0], 'coupling': 'strong'}, ['coupling', 'strong', 'per_joint']),
    ({'k1': [50.0], 'k2': [1.0, 2.0, 3.0]}, ['k2', 'length 1 or 2']),
    ({'k1': [50.0], 'k2': [float('nan')]}, ['k2', 'NaN']),
    ({'k1': [50.0], 'k2': [float('inf')]}, ['k2', 'inf']),
    ({'k1': [50.0], 'k2': [30, 30]}, ['controller.k2', '[30, 30]', 'write 30.0']),
    ({'k1': [50.0], 'k2': 30.0}, ['controller.k2', '30.0', 'a list of doubles']),
    ({'k1': [50.0], 'state_timeout': 1}, ['controller.state_timeout', 'write 1.0']),
    ({'k1': [50.0], 'coupling': True}, ['controller.coupling', 'True', 'one of per_joint']),
    ({'k1': [50.0], 'safety.lowr': [-1.0]}, ['controller.safety.lowr', 'no such', 'safety.lower']),
    ({'k1': [50.0], 'model': 'known'}, ['read-only', 'model']),
    ({'k1': [50.0], 'joints': ['a', 'b']}, ['read-only', 'joints']),
], ids=['range', 'choice', 'length', 'nan', 'inf', 'integers', 'no list', 'integer', 'no string',
        'unknown', 'read-only', 'read-only joints'])
def test_a_request_with_one_bad_value_changes_nothing(graph, values, words) -> None:
    node = graph.make(ControllerNode)
    before = node.settings.values()
    result = _set(node, **values)
    assert not result.successful
    for word in words:
        assert word in result.reason
    assert node.settings.values() == before
    assert list(node.get_parameter('k1').value) == [40.0]


def test_what_the_core_refuses_is_refused_as_a_whole(graph) -> None:
    node = graph.make(IdentifierNode)
    result = _set(node, kt=99.0, gamma=[1.0, 2.0])
    assert not result.successful
    assert 'gamma' in result.reason
    assert node.settings.values()['kt'] == node.identifier.settings.kt == 10.0
    assert node.get_parameter('kt').value == 10.0


def test_parameters_are_described_and_set_by_service_while_the_node_runs(graph) -> None:
    node = graph.make(ControllerNode, namespace='left')
    graph.run(node)
    peer = graph.peer()
    answer = peer.call(DescribeParameters, '/left/controller/describe_parameters',
                       DescribeParameters.Request(names=['k2', 'model']))
    assert answer.descriptors[0].description.endswith('[N*m*s/rad]')
    assert answer.descriptors[1].read_only
    request = SetParametersAtomically.Request(parameters=[
        Parameter('k1', value=[1.0, 2.0]).to_parameter_msg(),
        Parameter('k2', value=[-1.0]).to_parameter_msg()])
    result = peer.call(SetParametersAtomically, '/left/controller/set_parameters_atomically',
                       request).result
    assert (result.successful, node.settings.values()['k1']) == (False, [40.0])
    request.parameters[1] = Parameter('k2', value=[5.0]).to_parameter_msg()
    result = peer.call(SetParametersAtomically, '/left/controller/set_parameters_atomically',
                       request).result
    assert result.successful
    assert (node.settings.k1.tolist(), node.settings.k2.tolist()) == ([1.0, 2.0], [5.0])


def test_a_port_that_a_killed_process_left_empty_is_named(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(process, 'SHARED_MEMORY', tmp_path)
    for name, size, age in (('fastrtps_port7004', 0, 60.0), ('fastrtps_port7005', 9, 60.0),
                            ('fastrtps_port7004_el', 0, 60.0), ('fastrtps_port7006', 0, 0.0)):
        path = tmp_path / name
        path.write_bytes(b'x' * size)
        os.utime(path, (time.time() - age, time.time() - age))
    process.warn_of_leftovers('controller')
    said = capsys.readouterr().err
    assert 'fastrtps_port7004 is empty' in said
    assert len(said.splitlines()) == 1
