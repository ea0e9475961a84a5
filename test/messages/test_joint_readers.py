# SPDX-License-Identifier: Apache-2.0
"""Joint values from DynamicJointState, from JSON and from topics without a type."""

from __future__ import annotations

import json

import numpy as np
import pytest

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.joint_readers import (
    DYNAMIC_JOINT_STATE,
    joint_kind,
    JOINT_STATE,
)
from adaptive_blf_control.messages.joint_state import JointStateCodec

DEFINITION = {
    'control_msgs/msg/InterfaceValue': 'string[] interface_names\nfloat64[] values\n',
    DYNAMIC_JOINT_STATE: 'std_msgs/Header header\nstring[] joint_names\n'
                         'control_msgs/InterfaceValue[] interface_values\n'}


def dynamic(joints, interfaces, values, stamp=(3, 500), little_endian=True):
    """Serialise a DynamicJointState with another library, from the definition alone."""
    typesys = pytest.importorskip('rosbags.typesys')
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    types = {}
    for name, text in DEFINITION.items():
        types.update(typesys.get_types_from_msg(text, name))
    store.register(types)
    header = store.types['std_msgs/msg/Header'](
        store.types['builtin_interfaces/msg/Time'](*stamp), 'base')
    made = store.types['control_msgs/msg/InterfaceValue']
    message = store.types[DYNAMIC_JOINT_STATE](header, joints, [
        made(list(names), np.array(numbers, dtype=float))
        for names, numbers in zip(interfaces, values)])
    return bytes(store.serialize_cdr(message, DYNAMIC_JOINT_STATE, little_endian=little_endian))


@pytest.mark.parametrize('little_endian', [True, False])
def test_dynamic_joint_state_is_read_by_joint_and_interface(little_endian):
    data = dynamic(['gripper', 'elbow', 'shoulder'],
                   [['position'], ['effort', 'temperature', 'position'],
                    ['velocity', 'position', 'effort']],
                   [[9.0], [5.0, 40.0, 1.0], [4.0, 2.0, 6.0]], little_endian=little_endian)
    kind = joint_kind(DYNAMIC_JOINT_STATE, 'cdr')
    assert kind.names(data) == ('gripper', 'elbow', 'shoulder')
    stamp, position, velocity, effort = kind.reader(['shoulder', 'elbow']).read(data)
    assert stamp == 3_000_000_500
    assert (position.tolist(), effort.tolist()) == ([2.0, 1.0], [6.0, 5.0])
    assert velocity[0] == 4.0
    assert np.isnan(velocity[1])
    with pytest.raises(BagError, match="lacks joint 'wrist'"):
        kind.reader(['wrist']).read(data)


def test_damaged_dynamic_joint_state_raises_nothing_but_bag_errors():
    data = dynamic(['a', 'b'], [['position'], ['effort']], [[1.0], [2.0]])
    kind = joint_kind(DYNAMIC_JOINT_STATE, 'cdr')
    for size in range(len(data)):
        with pytest.raises(BagError):
            kind.names(data[:size])


def test_joint_state_in_json_is_read_with_the_names_of_both_ros_versions():
    message = {'header': {'stamp': {'sec': 3, 'nanosec': 7}}, 'name': ['a', 'b'],
               'position': [1, 2], 'velocity': [None, 4.5], 'effort': []}
    kind = joint_kind('sensor_msgs/JointState', 'json')
    for stamp in ({'sec': 3, 'nanosec': 7}, {'secs': 3, 'nsecs': 7}, {'sec': 3, 'nsec': 7}):
        message['header']['stamp'] = stamp
        row = kind.reader(['b', 'a']).read(json.dumps(message).encode())
        assert row[0] == 3_000_000_007
        assert row[1].tolist() == [2.0, 1.0]
        assert row[2][0] == 4.5
        assert np.isnan([row[2][1], *row[3]]).all()


@pytest.mark.parametrize('data', [b'', b'[]', b'{"name": 3}', b'\xff', b'{}', b'null',
                                  b'{"name": ["a", "b"], "position": [1]}'])
def test_json_that_is_no_joint_state_is_a_bag_error(data):
    with pytest.raises(BagError, match='no JointState in JSON'):
        joint_kind(JOINT_STATE, 'json').names(data)


def test_topic_without_a_type_is_read_as_joint_state_and_others_are_not():
    data = JointStateCodec(['a']).encode(5, [1.0], [2.0], [3.0])
    assert joint_kind('', 'cdr').reader(['a']).read(data)[3] == 3.0
    assert joint_kind('std_msgs/msg/Int32', 'cdr') is None
    assert joint_kind(JOINT_STATE, 'ros1') is None
    assert joint_kind('std_msgs/msg/Int32', 'json') is None
