# SPDX-License-Identifier: Apache-2.0
"""Our metadata.yaml as rosbag2 of Jazzy decodes it: each key that it asks for, by its type.

rosbag2 itself cannot be installed beside the wheels (docs/bags.md). This follows its sources,
`rosbag2_storage/yaml.hpp` and `qos.cpp` of the branch jazzy. yaml-cpp throws where a key is
missing or a scalar does not have the type, and `ros2 bag` then does not open the bag.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import re

import pytest
import yaml

from adaptive_blf_control.bags.metadata import default_qos
from adaptive_blf_control.bags.recovery import recover_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.messages.cdr import encode_int32

Decode = Callable[[yaml.Node], None]
START = 1_700_000_000_000_000_000  # ns


def _text(node: yaml.Node) -> None:
    assert isinstance(node, yaml.ScalarNode), node
    assert not node.tag.endswith(':null'), 'yaml-cpp makes the text "null" of it'


def _whole(bits: int) -> Decode:
    def decode(node: yaml.Node) -> None:
        assert isinstance(node, yaml.ScalarNode), node
        assert re.fullmatch('[0-9]+', node.value), node
        assert int(node.value) < 2**bits, node
    return decode


def _one_of(*values: str) -> Decode:
    def decode(node: yaml.Node) -> None:
        _text(node)
        assert node.value in values, node
    return decode


def _items(of: Decode) -> Decode:
    def decode(node: yaml.Node) -> None:
        assert isinstance(node, yaml.SequenceNode), node
        for each in node.value:
            of(each)
    return decode


def _keys(**decoders: Decode) -> Decode:
    def decode(node: yaml.Node) -> None:
        assert isinstance(node, yaml.MappingNode), node
        there = {key.value: value for key, value in node.value}
        for key, of in decoders.items():
            assert key in there, f'{key} is missing'
            of(there[key])
    return decode


def _texts_by_name(node: yaml.Node) -> None:
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            _text(key)
            _text(value)
    else:  # an empty one: rosbag2 goes through nothing
        assert node.tag.endswith(':null'), node


_COUNT = _whole(64)
_TIME = _keys(sec=_COUNT, nsec=_COUNT)
_QOS = _keys(
    history=_one_of('keep_last', 'keep_all', 'system_default', 'unknown'), depth=_whole(31),
    reliability=_one_of('reliable', 'best_effort', 'system_default'),
    durability=_one_of('volatile', 'transient_local', 'system_default'),
    deadline=_TIME, lifespan=_TIME, liveliness_lease_duration=_TIME,
    liveliness=_one_of('automatic', 'manual_by_topic', 'system_default'),
    avoid_ros_namespace_conventions=_one_of('true', 'false'))
_TOPIC = _keys(
    topic_metadata=_keys(name=_text, type=_text, serialization_format=_text,
                         offered_qos_profiles=_items(_QOS), type_description_hash=_text),
    message_count=_COUNT)
# Times are read as unsigned and kept as signed.
_SPAN, _SINCE = _keys(nanoseconds=_whole(63)), _keys(nanoseconds_since_epoch=_whole(63))
_FILE = _keys(path=_text, starting_time=_SINCE, duration=_SPAN, message_count=_COUNT)
_BAG = _keys(
    version=_one_of('9'), storage_identifier=_text, duration=_SPAN, starting_time=_SINCE,
    message_count=_COUNT, topics_with_message_count=_items(_TOPIC),
    relative_file_paths=_items(_text), compression_format=_text, compression_mode=_text,
    files=_items(_FILE), custom_data=_texts_by_name, ros_distro=_text)


def _decode(bag: Path) -> None:
    _keys(rosbag2_bagfile_information=_BAG)(
        yaml.compose((bag / 'metadata.yaml').read_text(), Loader=yaml.SafeLoader))


def _write(bag: Path, *, messages: int, **custom: str) -> Path:
    with BagWriter(bag, custom_data=custom) as writer:
        writer.add_topic('/rank', 'std_msgs/msg/Int32')
        writer.add_topic('/silent', 'sensor_msgs/msg/JointState',
                         qos=default_qos('best_effort', 'transient_local'))
        for number in range(messages):
            writer.write('/rank', encode_int32(number), START + number)
    return writer.path


@pytest.mark.parametrize(('messages', 'custom'), [
    (3, {'run': '1e5', 'empty': '', 'lines': 'a\nb: c'}), (3, {}), (0, {})])
def test_rosbag2_decodes_the_metadata_of_a_bag(tmp_path: Path, messages: int,
                                               custom: dict[str, str]) -> None:
    _decode(_write(tmp_path / 'run', messages=messages, **custom))


def test_rosbag2_decodes_the_metadata_of_a_recovered_bag(tmp_path: Path) -> None:
    bag = _write(tmp_path / 'run', messages=500)
    (bag / 'metadata.yaml').unlink()
    _decode(recover_bag(bag).path)
    file = bag / 'run_0.mcap'
    file.write_bytes(file.read_bytes()[:-1500])
    _decode(recover_bag(bag).path)


@pytest.mark.parametrize(('old', 'new'), [
    ('version: 9', 'version: 8'), ("compression_mode: ''", 'compression_mode:'),
    ('ros_distro', 'distro'), ('depth: 0', 'depth: -1'), ('message_count: 3', 'message_count: x'),
    ('reliability: reliable', 'reliability: 1')])
def test_what_rosbag2_does_not_decode_is_seen(tmp_path: Path, old: str, new: str) -> None:
    bag = _write(tmp_path / 'run', messages=3)
    text = (bag / 'metadata.yaml').read_text()
    assert old in text
    (bag / 'metadata.yaml').write_text(text.replace(old, new))
    with pytest.raises(AssertionError):
        _decode(bag)
