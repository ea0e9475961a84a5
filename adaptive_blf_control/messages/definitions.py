# SPDX-License-Identifier: Apache-2.0
"""Message definitions as a bag stores them: ros2msg text and RIHS01 type hash."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
import json
import os
from pathlib import Path
import re
import sys

from adaptive_blf_control.errors import BagError

__all__ = ['MessageDefinition', 'embedded_definition', 'message_definition']

_SEPARATOR = '\n' + '=' * 80 + '\nMSG: '
_TYPE_NAME = re.compile(r'([a-zA-Z]\w*)/(?:msg/)?([a-zA-Z]\w*)', re.ASCII)
_FIELD_TYPE = re.compile(r'(?:^|\n)\s*([a-zA-Z0-9_/]+)(?:\[[^\]]*\])?\s+')
_PRIMITIVES = frozenset((
    'bool', 'byte', 'char', 'float32', 'float64', 'int8', 'uint8', 'int16', 'uint16', 'int32',
    'uint32', 'int64', 'uint64', 'string', 'wstring'))

# Used where no ROS is installed: the types this package sends, and what they contain.
_TEXTS = {
    'builtin_interfaces/Duration': 'int32 sec\nuint32 nanosec\n',
    'builtin_interfaces/Time': 'int32 sec\nuint32 nanosec\n',
    'diagnostic_msgs/DiagnosticArray': 'std_msgs/Header header\nDiagnosticStatus[] status\n',
    'diagnostic_msgs/DiagnosticStatus': (
        'byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\n'
        'string message\nstring hardware_id\nKeyValue[] values\n'),
    'diagnostic_msgs/KeyValue': 'string key\nstring value\n',
    'geometry_msgs/Inertia': (
        'float64 m\ngeometry_msgs/Vector3 com\nfloat64 ixx\nfloat64 ixy\nfloat64 ixz\n'
        'float64 iyy\nfloat64 iyz\nfloat64 izz\n'),
    'geometry_msgs/InertiaStamped': 'std_msgs/Header header\nInertia inertia\n',
    'geometry_msgs/Vector3': 'float64 x\nfloat64 y\nfloat64 z\n',
    'rcl_interfaces/Parameter': 'string name\nParameterValue value\n',
    'rcl_interfaces/ParameterEvent': (
        'builtin_interfaces/Time stamp\nstring node\nParameter[] new_parameters\n'
        'Parameter[] changed_parameters\nParameter[] deleted_parameters\n'),
    'rcl_interfaces/ParameterValue': (
        'uint8 type\nbool bool_value\nint64 integer_value\nfloat64 double_value\n'
        'string string_value\nbyte[] byte_array_value\nbool[] bool_array_value\n'
        'int64[] integer_array_value\nfloat64[] double_array_value\n'
        'string[] string_array_value\n'),
    'rosgraph_msgs/Clock': 'builtin_interfaces/Time clock\n',
    'sensor_msgs/JointState': (
        'std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n'
        'float64[] effort\n'),
    'std_msgs/Float64': 'float64 data\n',
    'std_msgs/Float64MultiArray': 'MultiArrayLayout layout\nfloat64[] data\n',
    'std_msgs/Header': 'builtin_interfaces/Time stamp\nstring frame_id\n',
    'std_msgs/Int32': 'int32 data\n',
    'std_msgs/MultiArrayDimension': 'string label\nuint32 size\nuint32 stride\n',
    'std_msgs/MultiArrayLayout': 'MultiArrayDimension[] dim\nuint32 data_offset\n',
    'std_msgs/String': 'string data\n',
    'trajectory_msgs/JointTrajectory': (
        'std_msgs/Header header\nstring[] joint_names\nJointTrajectoryPoint[] points\n'),
    'trajectory_msgs/JointTrajectoryPoint': (
        'float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\n'
        'float64[] effort\nbuiltin_interfaces/Duration time_from_start\n'),
}
_HASHES = {
    'diagnostic_msgs/DiagnosticArray':
        'RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e',
    'geometry_msgs/InertiaStamped':
        'RIHS01_766be45976252babf7f9d8ac4ae7c912a7ceccf71035622529f27518b695aa09',
    'rcl_interfaces/ParameterEvent':
        'RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204',
    'rosgraph_msgs/Clock':
        'RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564',
    'sensor_msgs/JointState':
        'RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e',
    'std_msgs/Float64':
        'RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a',
    'std_msgs/Float64MultiArray':
        'RIHS01_1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f',
    'std_msgs/Int32':
        'RIHS01_b6578ded3c58c626cfe8d1a6fb6e04f706f97e9f03d2727c9ff4e74b1cef0deb',
    'std_msgs/String':
        'RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18',
    'trajectory_msgs/JointTrajectory':
        'RIHS01_179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e',
}


@dataclass(frozen=True)
class MessageDefinition:
    """Definition of one message type.

    Attributes:
        name: Full type name, e.g. ``sensor_msgs/msg/JointState``.
        text: ros2msg text of the type and everything it contains.
        type_hash: ``RIHS01_…``, or '' where unknown; rclpy's ``INVALID`` becomes ''.
    """

    name: str
    text: str
    type_hash: str = ''

    def __post_init__(self) -> None:
        """Keep only what readers understand as a hash."""
        if not self.type_hash.startswith('RIHS'):
            object.__setattr__(self, 'type_hash', '')


def message_definition(type_name: str) -> MessageDefinition:
    """Return the definition of a type, from the installed ROS or else from this module.

    Looks in ``<prefix>/share/<package>/msg`` of each AMENT_PREFIX_PATH entry, then of the Python
    environment (where the PyPI wheels put them).

    Raises:
        BagError: not a message type name, or no definition anywhere.
    """
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    folders = tuple(dict.fromkeys([*filter(None, prefixes), sys.prefix]))
    return _installed_definition(type_name, folders) or embedded_definition(type_name)


def embedded_definition(type_name: str) -> MessageDefinition:
    """Return the definition kept in this module, free of comments.

    Raises:
        BagError: not a message type name, or a type that is not kept here.
    """
    name = _resource_name(type_name)
    text = _full_text(name, _TEXTS.get)
    if text is None:
        raise BagError(f'no definition of message type {type_name!r}: it is neither in '
                       'AMENT_PREFIX_PATH nor known to this package')
    return MessageDefinition(_type_name(name), text, _HASHES.get(name, ''))


@cache
def _installed_definition(type_name: str, prefixes: tuple[str, ...]) -> MessageDefinition | None:
    name = _resource_name(type_name)
    text = _full_text(name, lambda resource: _read_share(prefixes, resource, '.msg'))
    if text is None:
        return None
    known = _HASHES.get(name, '')
    return MessageDefinition(_type_name(name), text, _installed_hash(prefixes, name) or known)


def _resource_name(type_name: str) -> str:
    match = _TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise BagError(f'{type_name!r} is not a message type: expected "package/msg/Name"')
    return f'{match[1]}/{match[2]}'


def _type_name(resource: str) -> str:
    return resource.replace('/', '/msg/')


def _read_share(prefixes: tuple[str, ...], resource: str, suffix: str) -> str | None:
    package, name = _resource_name(resource).split('/')
    for prefix in prefixes:
        try:
            # Bytes, since the text has to be stored verbatim, line ends included.
            return (Path(prefix) / 'share' / package / 'msg' / (name + suffix)
                    ).read_bytes().decode()
        except (OSError, UnicodeDecodeError):
            continue
    return None


def _installed_hash(prefixes: tuple[str, ...], resource: str) -> str:
    try:
        hashes = json.loads(_read_share(prefixes, resource, '.json') or '{}')['type_hashes']
        return next(str(entry['hash_string']) for entry in hashes
                    if entry['type_name'] == _type_name(resource))
    except (ValueError, KeyError, TypeError, StopIteration):
        return ''


def _dependencies(text: str, package: str) -> list[str]:
    """Return the message types named by the fields of one .msg text, sorted."""
    found = set(_FIELD_TYPE.findall(text)) - _PRIMITIVES
    return sorted(name if '/' in name else f'{package}/{name}' for name in found)


def _full_text(root: str, load: Callable[[str], str | None]) -> str | None:
    """Concatenate as rosbag2 does: depth first, dependencies sorted, each once.

    Returns None where a text is missing.
    """
    seen: set[str] = set()

    def append(resource: str) -> str | None:
        text = load(resource)
        if text is None:
            return None
        for dependency in _dependencies(text, resource.split('/')[0]):
            if dependency not in seen:
                seen.add(dependency)
                inner = append(dependency)
                if inner is None:
                    return None
                text += f'{_SEPARATOR}{dependency}\n{inner}'
        return text

    return append(root)
