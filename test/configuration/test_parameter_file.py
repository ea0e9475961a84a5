# SPDX-License-Identifier: Apache-2.0
"""Facts about parameter files: our own are valid, faulty ones are refused with a clear message."""

from __future__ import annotations

import copy
from pathlib import Path

import pytest
import yaml

from adaptive_blf_control.configuration.node_settings import TABLES
from adaptive_blf_control.configuration.parameter_file import (
    apply_settings,
    given_values,
    known_elsewhere,
    load_yaml,
    node_values,
)
from adaptive_blf_control.errors import ParameterError

CONFIGS = sorted((Path(__file__).resolve().parents[2] / 'config').glob('*.yaml'))
TEXT = """
/**:
  ros__parameters:
    joints: [left, right]
    kt: 3.0
    use_sim_time: true
/**/identifier:
  ros__parameters:
    filter: {time_constant: 0.02}
    history.size: 9
controller:
  ros__parameters:
    k1: [40.0, 30.0]
    reference:
      left: {amplitude: [1.0], frequency: [0.5], phase: [0.0]}
"""


@pytest.fixture
def data():
    return yaml.safe_load(TEXT)


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / 'params.yaml'
    path.write_text(text, encoding='utf-8')
    return path


@pytest.mark.parametrize('node', TABLES)
@pytest.mark.parametrize('config', CONFIGS, ids=lambda path: path.stem)
def test_our_own_files_are_valid_for_every_node(config, node):
    values = node_values(load_yaml(config), node)
    assert all(isinstance(value, float) for parameter in TABLES[node]
               if parameter.kind == 'double' and '<' not in parameter.name
               for value in [values[parameter.name]])


@pytest.mark.parametrize('config', CONFIGS, ids=lambda path: path.stem)
def test_our_own_files_have_sections_that_ros_matches_under_any_namespace(config):
    data = load_yaml(config)
    assert data
    assert set(data) <= {'/**', *(f'/**/{node}' for node in TABLES)}


def test_there_are_scenarios_to_check():
    assert {'two_link', 'two_link_paper'} <= {config.stem for config in CONFIGS}


def test_sections_and_nested_names_reach_their_node(data):
    identifier = node_values(data, 'identifier')
    assert identifier['kt'] == 3.0
    assert identifier['filter.time_constant'] == 0.02
    assert identifier['history.size'] == 9
    assert identifier['joints'] == ['left', 'right']
    assert identifier['kh'] == 10.0  # the default
    controller = node_values(data, 'controller')
    assert controller['k1'] == [40.0, 30.0]
    assert controller['reference.left.amplitude'] == [1.0]
    assert controller['reference.right.amplitude'] == [0.0]
    assert 'kt' not in controller


def test_later_sections_win(data):
    data['/**/identifier']['ros__parameters']['kt'] = 5.0
    assert node_values(data, 'identifier')['kt'] == 5.0
    data['/arm/identifier'] = {'ros__parameters': {'kt': 7.0}}
    assert node_values(data, 'identifier')['kt'] == 7.0
    data['/arm/other_identifier'] = {'ros__parameters': {'kt': 9.0}}
    assert node_values(data, 'identifier')['kt'] == 7.0


def test_what_ros_itself_declares_is_accepted_and_left_out(data):
    data['controller']['ros__parameters']['qos_overrides'] = {'/x': {'publisher': {'depth': 3}}}
    for node in ('identifier', 'controller'):
        assert not any(name.startswith(('use_sim', 'qos')) for name in node_values(data, node))


@pytest.mark.parametrize(('section', 'entry', 'expected'), [
    ('/**', {'kT': 1.0}, r"'kT' is 1\.0: no such parameter \(did you mean identifier\.kt\?\)"),
    ('/**', {'filter': {'gep': 1.0}},
     r"'filter\.gep' is 1\.0: .*did you mean identifier\.filter\.gap\?"),
    ('/**/identifier', {'k1': [1.0]}, r"'identifier\.k1'.*no such parameter"),
    ('/**/identifier', {'filter': {'size': 3}}, r'did you mean history\.size\?'),
    ('/**/identifier', {'kt': 1}, r"'identifier\.kt' is 1: .*write 1\.0"),
    ('/**/identifier', {'kt': 'fast'}, r"'identifier\.kt' is 'fast'.*floating-point"),
    ('/**/identifier', {'kt': -1.0}, r"'identifier\.kt' is -1\.0: expected >= 0"),
    ('/**/identifier', {'kt': float('nan')}, r"'identifier\.kt' is nan"),
    ('/**/identifier', {'history': {'size': 0}}, r"\.history\.size' is 0: expected >= 1"),
    ('/**/identifier', {'filter': 3.0}, r"'identifier\.filter'.*no such parameter"),
    ('/**/identifier', {'kt': {'a': 1.0}}, r"'identifier\.kt\.a'.*no such parameter"),
    ('controller', {'k1': [1.0, 2.0, 3.0]}, r"'controller\.k1'.*length 1 or 2"),
    ('controller', {'k1': [1.0, 0.0]}, r"'controller\.k1'.*> 0"),
    ('controller', {'coupling': 'soft'}, r"'controller\.coupling' is 'soft'.*per_joint"),
    ('controller', {'joints': 'left'}, r"'controller\.joints' is 'left': expected a list"),
    ('controller', {'reference': {'rihgt': {'offset': 1.0}}}, r'controller\.reference\.rihgt'),
    ('controller', {'reference': {'right': {'offset': 1}}}, r'right\.offset.*write 1\.0'),
])
def test_a_faulty_entry_is_named_with_what_is_expected(data, section, entry, expected):
    data[section]['ros__parameters'].update(entry)
    node = 'controller' if section == 'controller' else 'identifier'
    with pytest.raises(ParameterError, match=expected):
        node_values(data, node)


@pytest.mark.parametrize(('text', 'expected'), [
    ('a: [1.0', '(?s)well-formed YAML.*line 1'),
    ('\ta: 1', 'well-formed YAML'),
    ('', 'a mapping of node names'),
    ('[1, 2]', 'a mapping of node names'),
    ('k1: [1.0]', "under 'k1' one key ros__parameters"),
    ('/**: {kt: 1.0}', 'one key ros__parameters'),
    ('/**: {ros__parameters: {}, kt: 1.0}', 'one key ros__parameters'),
    ('/**: {ros__parameters: 3.0}', 'one key ros__parameters'),
    ('/**: {ros__parameters: }', 'one key ros__parameters'),
    ('1: {ros__parameters: {}}', 'a name of a node, not 1'),
    ('? [a, b]\n: {ros__parameters: {}}', 'parameter file'),
])
def test_a_malformed_file_is_refused(tmp_path, text, expected):
    path = write(tmp_path, text)
    with pytest.raises(ParameterError, match=expected) as caught:
        load_yaml(path)
    assert str(path) in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ParameterError, match=r'nothing\.yaml.*No such file'):
        load_yaml(tmp_path / 'nothing.yaml')
    with pytest.raises(ParameterError, match='directory'):
        load_yaml(tmp_path)


def test_a_binary_file_is_refused(tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_bytes(b'\x89PNG\xff\xfe\x00')
    with pytest.raises(ParameterError, match='well-formed YAML'):
        load_yaml(path)


def test_a_file_comes_back_as_it_is(tmp_path, data):
    assert load_yaml(write(tmp_path, TEXT)) == data


def test_given_values_are_only_what_is_given(data):
    assert given_values(data, 'recorder') == {'use_sim_time': True}
    assert given_values(data, 'identifier') == {
        'joints': ['left', 'right'], 'kt': 3.0, 'use_sim_time': True,
        'filter.time_constant': 0.02, 'history.size': 9}


def test_what_another_node_knows_is_told_apart_from_what_none_knows():
    assert known_elsewhere('kt', 'controller')
    assert known_elsewhere('reference.elbow.offset', 'identifier')
    assert not known_elsewhere('kt', 'identifier')
    assert not known_elsewhere('nonsense', 'identifier')


def test_a_setting_for_one_node_changes_that_node(data):
    data = apply_settings(data, ['identifier.kt=8.0', 'controller.k1=[9.0]',
                          'controller.reference.left.amplitude=[0.5]'])
    assert node_values(data, 'identifier')['kt'] == 8.0
    controller = node_values(data, 'controller')
    assert controller['k1'] == [9.0]
    assert controller['reference.left.amplitude'] == [0.5]
    assert controller['reference.left.frequency'] == [0.5]


def test_a_setting_for_every_node_wins_over_the_sections_of_the_nodes(data):
    data = apply_settings(data, ['filter.time_constant=0.5', 'arm=urdf', 'history.size=4'])
    identifier = node_values(data, 'identifier')
    assert identifier['filter.time_constant'] == 0.5
    assert identifier['history.size'] == 4
    for node in ('arm_driver', 'identifier', 'controller'):
        assert node_values(data, node)['arm'] == 'urdf'


def test_a_setting_for_one_node_wins_over_every_section_of_that_node(data):
    data['/**/controller'] = {'ros__parameters': {'k2': [1.0]}}
    data['/robot/controller'] = {'ros__parameters': {'k2': [2.0]}}
    data = apply_settings(data, ['controller.k2=[3.0]'])
    assert node_values(data, 'controller')['k2'] == [3.0]


def test_the_last_of_two_settings_wins(data):
    data = apply_settings(data, ['identifier.kt=8.0', 'identifier.kt=9.0'])
    assert node_values(data, 'identifier')['kt'] == 9.0


@pytest.mark.parametrize(('text', 'value'), [
    ('1e-5', 1e-5), ('2E3', 2e3), ('-3.e+2', -300.0), ('.5e1', 5.0),
    ('[1.0, -3e-05]', [1.0, -3e-05])])
def test_a_number_without_a_point_before_its_exponent_is_a_number(tmp_path, text, value):
    assert apply_settings({}, [f'identifier.kt={text}']) == {
        '/**/identifier': {'ros__parameters': {'kt': value}}}
    path = tmp_path / 'file.yaml'
    path.write_text(f'/**/identifier: {{ros__parameters: {{kt: {text}}}}}')
    assert load_yaml(path)['/**/identifier']['ros__parameters']['kt'] == value


def test_settings_leave_the_data_they_are_applied_to_as_they_were(data):
    before = copy.deepcopy(data)
    apply_settings(data, ['identifier.kt=8.0'])
    assert data == before


@pytest.mark.parametrize(('setting', 'expected'), [
    ('identifier.kt', 'NODE.NAME=VALUE'),
    ('=3.0', 'NODE.NAME=VALUE'),
    ('identifier.kt=[1.0', 'a YAML value'),
])
def test_a_malformed_setting_is_refused(data, setting, expected):
    with pytest.raises(ParameterError, match=expected):
        apply_settings(data, [setting])


@pytest.mark.parametrize(('setting', 'expected'), [
    ('identifier.kt=much', r'a floating-point number'),
    ('identifier.tk=1.0', 'no such parameter'),
    ('identifer.kt=1.0', r"'identifer\.kt' .*did you mean identifier\.kt\?"),
    ('identifier__kt=1.0', r"'identifier__kt' .*did you mean identifier\.kt\?"),
    ('kz=1.0', r"'kz' .*no such parameter"),
    ('gamma=much', r"'identifier\.gamma' is 'much': expected a list of doubles"),
])
def test_a_setting_is_checked_like_the_file(data, setting, expected):
    with pytest.raises(ParameterError, match=expected):
        node_values(apply_settings(data, [setting]), 'identifier')


@pytest.mark.parametrize(('setting', 'node', 'name', 'value'), [
    ('identifier.kt=1', 'identifier', 'kt', 1.0), ('kt=1', 'identifier', 'kt', 1.0),
    ('gamma=3', 'identifier', 'gamma', [3.0]), ('gamma=[3, 4, 5, 6, 7]', 'identifier', 'gamma',
                                                [3.0, 4.0, 5.0, 6.0, 7.0]),
    ('k2=5', 'controller', 'k2', [5.0]), ('safety.upper=2', 'controller', 'safety.upper', [2.0]),
])
def test_a_setting_takes_a_number_where_floats_or_a_list_of_them_are_meant(
        data, setting, node, name, value):
    assert node_values(apply_settings(data, [setting]), node)[name] == value


def test_a_number_with_an_exponent_needs_no_point(tmp_path):
    """As in YAML 1.2 and for ROS; YAML 1.1 takes 1e-5 for a string."""
    data = apply_settings({}, ['identifier.kt=1e-5', 'controller.k2=[1e2, -.5E+3]'])
    assert data['/**/identifier']['ros__parameters'] == {'kt': 1e-5}
    assert data['/**/controller']['ros__parameters'] == {'k2': [100.0, -500.0]}
    path = tmp_path / 'file.yaml'
    path.write_text('/**/identifier: {ros__parameters: {kt: 2e3, update_law: e5}}',
                    encoding='utf-8')
    assert load_yaml(path)['/**/identifier']['ros__parameters'] == {'kt': 2e3, 'update_law': 'e5'}
