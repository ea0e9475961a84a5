# SPDX-License-Identifier: Apache-2.0
"""Decoder for visualization_msgs/msg/MarkerArray of bounded length: what obstacles need of it.

rclpy's own conversion holds the interpreter, and with it the control loop, until it is done.
"""

from __future__ import annotations

from typing import NamedTuple

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr_cursor import Cursor, STAMP

__all__ = ['LARGEST_ARRAY', 'Marker', 'read_markers']

LARGEST_ARRAY = 200  # markers
_SMALLEST = 180  # bytes of a marker without any string
_WHAT = 'MarkerArray'


class Marker(NamedTuple):
    """A marker, as far as it says where something is.

    Attributes:
        stamp_ns: Of its header [ns].
        frame: Of its header.
        ns: Namespace.
        id: Number within it.
        type: Shape, `visualization_msgs/Marker`: 1 cube, 2 sphere, 3 cylinder.
        action: 0 add or modify, 2 delete, 3 delete all.
        position: x, y, z [m].
        orientation: Quaternion x, y, z, w.
        scale: Sides or diameters [m].
    """

    stamp_ns: int
    frame: str
    ns: str
    id: int
    type: int
    action: int
    position: tuple[float, ...]
    orientation: tuple[float, ...]
    scale: tuple[float, ...]


def read_markers(data: bytes) -> tuple[Marker, ...]:
    """Decode an array of markers.

    Raises:
        BagError: truncated or garbage input, with the offset, or more markers than
            ``LARGEST_ARRAY``.
    """
    cursor = Cursor(bytes(data), _WHAT)
    count = cursor.count(_SMALLEST, 'markers')
    if count > LARGEST_ARRAY:
        raise BagError(f'{_WHAT} has {count} markers: expected at most {LARGEST_ARRAY}')
    return tuple(_marker(cursor, f'markers[{i}]') for i in range(count))


def _marker(cursor: Cursor, what: str) -> Marker:
    stamp = 1_000_000_000 * cursor.int32(f'{what}.header.stamp') + cursor.uint32(what)
    frame, ns = cursor.string(f'{what}.header.frame_id'), cursor.string(f'{what}.ns')
    number, kind, action = (cursor.int32(f'{what}.{name}') for name in ('id', 'type', 'action'))
    numbers = tuple(cursor.double(f'{what}.pose and scale') for _ in range(10))
    cursor.take(4 * 4, 4, f'{what}.color')
    cursor.take(STAMP.size, 4, f'{what}.lifetime')
    cursor.take(1, 1, f'{what}.frame_locked')
    for name, size, alignment in (('points', 24, 8), ('colors', 16, 4)):
        _skip(cursor, f'{what}.{name}', size, alignment)
    cursor.string(f'{what}.texture_resource')
    cursor.take(STAMP.size, 4, f'{what}.texture.header')
    cursor.string(f'{what}.texture.header.frame_id')
    cursor.string(f'{what}.texture.format')
    _skip(cursor, f'{what}.texture.data', 1, 1)
    _skip(cursor, f'{what}.uv_coordinates', 8, 4)
    cursor.string(f'{what}.text')
    cursor.string(f'{what}.mesh_resource')
    cursor.string(f'{what}.mesh_file.filename')
    _skip(cursor, f'{what}.mesh_file.data', 1, 1)
    cursor.take(1, 1, f'{what}.mesh_use_embedded_materials')
    return Marker(stamp, frame, ns, number, kind, action, numbers[:3], numbers[3:7], numbers[7:])


def _skip(cursor: Cursor, what: str, size: int, alignment: int) -> None:
    """Step over a sequence of items of ``size`` bytes."""
    count = cursor.count(size, what)
    if count:
        cursor.take(count * size, alignment, what)
