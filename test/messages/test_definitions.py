# SPDX-License-Identifier: Apache-2.0
"""Definition texts and type hashes against rosbags and an installed ROS."""

from __future__ import annotations

import re

import pytest

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.definitions import (
    embedded_definition,
    message_definition,
    MessageDefinition,
)

TYPES = (
    'sensor_msgs/msg/JointState', 'std_msgs/msg/Float64MultiArray', 'std_msgs/msg/Float64',
    'std_msgs/msg/Int32', 'trajectory_msgs/msg/JointTrajectory', 'rosgraph_msgs/msg/Clock',
    'diagnostic_msgs/msg/DiagnosticArray', 'rcl_interfaces/msg/ParameterEvent')


def parts(text):
    """Split a ros2msg text into {type: [lines with fields or constants]}."""
    blocks = re.split(r'^={80}\nMSG: ', 'root\n' + text, flags=re.MULTILINE)
    found = {}
    for block in blocks:
        name, *lines = block.split('\n')
        lines = [line.split('#')[0].split() for line in lines]
        found[name] = [[word.rpartition('/')[2] for word in line] for line in lines if line]
    return found


@pytest.mark.parametrize('type_name', TYPES)
def test_text_and_hash_equal_those_of_rosbags(type_name):
    typesys = pytest.importorskip('rosbags.typesys')
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    expected, _ = store.generate_msgdef(type_name, ros_version=2)
    for definition in (embedded_definition(type_name), message_definition(type_name)):
        assert definition.name == type_name
        assert definition.type_hash == store.hash_rihs01(type_name)
    found = parts(embedded_definition(type_name).text)
    # Constants are no part of the data; rosbags lists those of its own definition.
    fields = {name: [line for line in lines if '=' not in ''.join(line)]
              for name, lines in found.items()}
    assert fields == {name: [line for line in lines if '=' not in ''.join(line)]
                      for name, lines in parts(expected).items()}


@pytest.mark.parametrize('type_name', TYPES)
@pytest.mark.parametrize('find', [embedded_definition, message_definition])
def test_text_is_parsed_by_another_library_to_the_same_hash(type_name, find):
    typesys = pytest.importorskip('rosbags.typesys')
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(find(type_name).text, type_name))
    assert store.hash_rihs01(type_name) == find(type_name).type_hash


def test_installed_text_is_verbatim_and_depth_first(tmp_path, monkeypatch):
    texts = {
        'a_msgs/Root': '# why\nZed z\nb_msgs/Leaf[<=3] many\nb_msgs/Leaf one\nint32 X=1\n'
                       'd_msgs/E e\nd_msgs/D d\nd_msgs/C c\nd_msgs/B b\n',
        'a_msgs/Zed': 'float64 v # last line without its end',
        'b_msgs/Leaf': 'c_msgs/Twig twig\r\nstring<=5 s\n',
        'c_msgs/Twig': 'uint8 x\n',
        **{f'd_msgs/{letter}': 'bool y\n' for letter in 'BCDE'}}
    for name, text in texts.items():
        package, _, message = name.partition('/')
        folder = tmp_path / 'share' / package / 'msg'
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f'{message}.msg').write_bytes(text.encode())
    (tmp_path / 'share/a_msgs/msg/Root.json').write_text(
        '{"type_hashes": [{"type_name": "a_msgs/msg/Root", "hash_string": "RIHS01_ab"}]}')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere:{tmp_path}')
    line = '\n' + '=' * 80 + '\nMSG: '
    assert message_definition('a_msgs/msg/Root') == MessageDefinition(
        'a_msgs/msg/Root',
        texts['a_msgs/Root'] + line + 'a_msgs/Zed\n' + texts['a_msgs/Zed']
        + line + 'b_msgs/Leaf\n' + texts['b_msgs/Leaf']
        + line + 'c_msgs/Twig\n' + texts['c_msgs/Twig']
        + ''.join(f'{line}d_msgs/{letter}\nbool y\n' for letter in 'BCDE'), 'RIHS01_ab')


def test_no_installation_leaves_the_embedded_text(tmp_path, monkeypatch):
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    monkeypatch.setattr('sys.prefix', str(tmp_path))
    for type_name in TYPES:
        assert message_definition(type_name) == embedded_definition(type_name)


def test_unknown_type_and_unknown_hash():
    with pytest.raises(BagError, match="'no_msgs/msg/Such'"):
        message_definition('no_msgs/msg/Such')
    for name in ('JointState', '../../etc/msg/passwd', 'a/srv/B', ''):
        with pytest.raises(BagError, match='not a message type'):
            message_definition(name)
    assert MessageDefinition('a/msg/B', 'int8 x\n', 'INVALID').type_hash == ''
