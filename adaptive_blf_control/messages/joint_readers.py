# SPDX-License-Identifier: Apache-2.0
"""Joint values from messages of the types and encodings that bags hold them in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import json
from typing import Any, NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr_cursor import Cursor
from adaptive_blf_control.messages.joint_state import (
    decode_joint_state,
    FIELDS,
    NANOSECONDS,
)
from adaptive_blf_control.messages.joint_state_reader import JointStateReader

__all__ = ['DYNAMIC_JOINT_STATE', 'JOINT_STATE', 'JointKind', 'JointReader', 'joint_kind']

JOINT_STATE = 'sensor_msgs/msg/JointState'
DYNAMIC_JOINT_STATE = 'control_msgs/msg/DynamicJointState'

Row = tuple[int, np.ndarray, np.ndarray, np.ndarray]


class JointReader(Protocol):
    """Reads messages into the order of its own joints, as `JointStateReader` does."""

    joints: tuple[str, ...]

    def read(self, data: bytes) -> Row:
        """Return stamp [ns], position [rad], velocity [rad/s], effort [N·m], each (n,)."""


class JointKind(NamedTuple):
    """How messages of one type and encoding are read.

    Attributes:
        names: Joint names of a message.
        reader: Makes a reader for some joints.
    """

    names: Callable[[bytes], tuple[str, ...]]
    reader: Callable[[Sequence[str]], JointReader]


class _Values(NamedTuple):
    """A decoded message: per joint the values of its interfaces."""

    stamp_ns: int
    joints: dict[str, dict[str, float]]


class _ValueReader:
    """Reader of messages that are decoded to values by joint and interface."""

    def __init__(self, decode: Callable[[bytes], _Values], joints: Sequence[str]) -> None:
        self.joints = tuple(joints)
        self._decode = decode

    def read(self, data: bytes) -> Row:
        stamp_ns, values = self._decode(data)
        if missing := [joint for joint in self.joints if joint not in values]:
            raise BagError(f'message lacks joint {", ".join(map(repr, missing))}: it has '
                           f'{list(values)}')
        position, velocity, effort = np.array([
            [values[joint].get(field, np.nan) for joint in self.joints] for field in FIELDS])
        return stamp_ns, position, velocity, effort


def joint_kind(type_name: str, encoding: str) -> JointKind | None:
    """Return how joint values of a type and encoding are read; None where they are not.

    A topic without a type is read as JointState, which fails at its first message if it is not.
    """
    if encoding == 'json' and type_name in (JOINT_STATE, 'sensor_msgs/JointState', ''):
        return _kind_of_values(_decode_json)
    if encoding == 'cdr' and type_name == DYNAMIC_JOINT_STATE:
        return _kind_of_values(_decode_dynamic)
    if encoding == 'cdr' and type_name in (JOINT_STATE, ''):
        return JointKind(lambda data: decode_joint_state(data).names, JointStateReader)
    return None


def _kind_of_values(decode: Callable[[bytes], _Values]) -> JointKind:
    return JointKind(lambda data: tuple(decode(data).joints),
                     lambda joints: _ValueReader(decode, joints))


def _decode_dynamic(data: bytes) -> _Values:
    """Decode control_msgs/msg/DynamicJointState.

    It has ``Header header``, ``string[] joint_names`` and ``InterfaceValue[] interface_values``,
    each of these ``string[] interface_names`` and ``float64[] values``.
    """
    cursor = Cursor(data, 'DynamicJointState')
    stamp_ns = cursor.int32('header.stamp.sec') * NANOSECONDS + cursor.uint32(
        'header.stamp.nanosec')
    cursor.string('header.frame_id')
    joints = _strings(cursor, 'joint_names')
    count = cursor.count(8, 'interface_values')
    if count != len(joints):
        raise BagError(f'DynamicJointState has {count} interface_values for {len(joints)} '
                       'joint_names: expected as many')
    values = {}
    for joint in joints:
        names = _strings(cursor, f'interface_names of {joint!r}')
        numbers = cursor.doubles(f'values of {joint!r}')
        if len(numbers) != len(names):
            raise BagError(f'DynamicJointState has {len(numbers)} values for {len(names)} '
                           f'interfaces of {joint!r}: expected as many')
        values[joint] = dict(zip(names, numbers.tolist()))
    return _Values(stamp_ns, values)


def _strings(cursor: Cursor, what: str) -> list[str]:
    return [cursor.string(what) for _ in range(cursor.count(4, what))]


def _decode_json(data: bytes) -> _Values:
    """Decode a JointState that was written as JSON, with the names of ROS 1 or 2."""
    try:
        message = json.loads(data)
        stamp = message.get('header', {}).get('stamp', {})
        second, nanosecond = (next((stamp[key] for key in keys if key in stamp), 0) for keys in (
            ('sec', 'secs'), ('nanosec', 'nsec', 'nsecs')))
        names = [str(name) for name in message['name']]
        fields = {field: _numbers(message.get(field) or [], len(names)) for field in FIELDS}
        return _Values(int(second) * NANOSECONDS + int(nanosecond), {
            name: {field: values[i] for field, values in fields.items() if values}
            for i, name in enumerate(names)})
    except (ValueError, TypeError, KeyError, AttributeError, IndexError) as exc:
        raise BagError(f'no JointState in JSON: {exc!r}') from exc


def _numbers(values: Any, count: int) -> list[float]:
    """Return numbers; JSON has no NaN, so null stands for it."""
    numbers = [float('nan') if value is None else float(value) for value in values]
    if len(numbers) not in (0, count):
        raise ValueError(f'{len(numbers)} values for {count} names')
    return numbers
