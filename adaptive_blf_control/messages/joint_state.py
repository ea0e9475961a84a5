# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/msg/JointState as CDR bytes: encoder, general decoder, decoder by joint name."""

from __future__ import annotations

from collections.abc import Sequence
import struct
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr_cursor import (
    align,
    Cursor,
    ENCAPSULATION_LE,
    encode_string,
    HEADER_SIZE,
)

__all__ = ['JointStateCodec', 'JointStateReader', 'JointStateRecord', 'decode_joint_state']

FIELDS = ('position', 'velocity', 'effort')
NANOSECONDS = 1_000_000_000

_WHAT = 'JointState'
_STAMP = struct.Struct('<iI')
_COUNT = struct.Struct('<I')
_DOUBLE = np.dtype('<f8')
_STAMP_OFFSET = HEADER_SIZE
_FRAME_OFFSET = HEADER_SIZE + 8
# There is one layout per publisher of the topic; more than this many are a fault.
_MAX_LAYOUTS = 8


class JointStateRecord(NamedTuple):
    """One decoded message; arrays are as long as in the message, possibly empty.

    Attributes:
        stamp_ns: ``header.stamp`` [ns].
        frame_id: ``header.frame_id``.
        names: Joint (or parameter) names.
        position: [rad].
        velocity: [rad/s].
        effort: [N·m].
    """

    stamp_ns: int
    frame_id: str
    names: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


def _decode_head(cursor: Cursor) -> tuple[int, str, tuple[str, ...]]:
    sec = cursor.int32('header.stamp.sec')
    stamp_ns = sec * NANOSECONDS + cursor.uint32('header.stamp.nanosec')
    frame_id = cursor.string('header.frame_id')
    count = cursor.count(4, 'name')
    return stamp_ns, frame_id, tuple(cursor.string(f'name[{i}]') for i in range(count))


def decode_joint_state(data: bytes) -> JointStateRecord:
    """Decode a JointState of either byte order; bytes behind the message are ignored.

    Raises:
        BagError: truncated or garbage input, with the offset; nothing else is ever raised.
    """
    cursor = Cursor(bytes(data), _WHAT)
    return JointStateRecord(*_decode_head(cursor), *(cursor.doubles(field) for field in FIELDS))


class JointStateCodec:
    """Encoder for JointState messages with fixed names, of which only stamp and numbers change.

    It reuses one buffer, so an instance belongs to one thread.
    """

    def __init__(self, names: Sequence[str], frame_id: str = '',
                 fields: Sequence[str] = FIELDS) -> None:
        """Lay out the message.

        Args:
            names: Joint or parameter names, each once.
            frame_id: ``header.frame_id``.
            fields: Those of position, velocity and effort that carry values; the others are
                empty sequences.

        Raises:
            BagError: a name occurs twice or cannot be encoded; an unknown field.
        """
        self.names = tuple(names)
        self.fields = tuple(field for field in FIELDS if field in fields)
        _refuse_duplicates(self.names, 'codec')
        if unknown := sorted(set(fields) - set(FIELDS)):
            raise BagError(f'JointState has no field {unknown}: expected some of {FIELDS}')
        head = bytearray(ENCAPSULATION_LE + bytes(_STAMP.size))
        head += encode_string(frame_id, 'frame_id')
        head += bytes(align(len(head), 4) - len(head)) + struct.pack('<I', len(self.names))
        for name in self.names:
            head += bytes(align(len(head), 4) - len(head)) + encode_string(name, 'joint name')
        self._buffer, offsets = self._append_arrays(head)
        self._views = [np.frombuffer(self._buffer, '<f8', len(self.names), offset)
                       if offset is not None else None for offset in offsets]

    def _append_arrays(self, head: bytearray) -> tuple[bytearray, list[int | None]]:
        """Append counts and room for the numbers; return where each field's numbers start."""
        count = len(self.names)
        offsets: list[int | None] = []
        for field in FIELDS:
            size = count if field in self.fields else 0
            head += bytes(align(len(head), 4) - len(head)) + struct.pack('<I', size)
            if size:
                head += bytes(align(len(head), 8) - len(head))
            offsets.append(len(head) if field in self.fields else None)
            head += bytes(8 * size)
        return head, offsets

    def encode(self, stamp_ns: int, position: Sequence[float] | np.ndarray = (),
               velocity: Sequence[float] | np.ndarray = (),
               effort: Sequence[float] | np.ndarray = ()) -> bytes:
        """Return the message: exact length, zero padding.

        Args:
            stamp_ns: Time of the sample [ns]; seconds must fit a signed 32-bit integer.
            position: Shape (n,) [rad], or empty where not among `fields`.
            velocity: Shape (n,) [rad/s], likewise.
            effort: Shape (n,) [N·m], likewise.

        Raises:
            BagError: wrong length of an array, or a stamp that does not fit.
        """
        seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
        try:
            _STAMP.pack_into(self._buffer, _STAMP_OFFSET, seconds, nanoseconds)
        except struct.error as exc:
            raise BagError(f'stamp {stamp_ns!r} ns: expected whole nanoseconds below 2**31 s'
                           ) from exc
        position_view, velocity_view, effort_view = self._views
        self._patch(position_view, position, 'position')
        self._patch(velocity_view, velocity, 'velocity')
        self._patch(effort_view, effort, 'effort')
        return bytes(self._buffer)

    def _patch(self, view: np.ndarray | None, values: Sequence[float] | np.ndarray,
               field: str) -> None:
        expected = 0 if view is None else len(self.names)
        if len(values) != expected:
            raise BagError(f'JointState.{field} has {len(values)} values: expected {expected}')
        if view is not None:
            try:
                view[:] = values
            except (ValueError, TypeError) as exc:
                raise BagError(f'JointState.{field}: {exc}: expected {expected} numbers') from exc


class _Layout(NamedTuple):
    """What one publisher's messages have in common.

    Attributes:
        key: Bytes of frame_id and names; they fix where the arrays begin.
        first: Offset of the count of `position`.
        size: Number of names.
        order: Index of each of our joints among the names, shape (n,).
    """

    key: bytes
    first: int
    size: int
    order: np.ndarray


class JointStateReader:
    """Decoder that returns the numbers in the order of given joints, matched by name.

    The permutation is kept for each layout (frame_id and names as bytes), so that only the first
    message of a publisher is parsed name by name.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        """Take the joints; BagError if one is listed twice."""
        self.joints = tuple(joints)
        _refuse_duplicates(self.joints, 'reader')
        self._layouts: list[_Layout] = []
        self._nothing = np.full(len(self.joints), np.nan)

    def read(self, data: bytes) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        """Return stamp [ns], position [rad], velocity [rad/s], effort [N·m].

        Each array is fresh, float64, of shape (n,) in the order of `joints`; all NaN where the
        message leaves it empty. Other joints of the message are skipped.

        Raises:
            BagError: a joint is missing, a name occurs twice, an array is neither empty nor as
                long as the names, or the message is truncated.
        """
        if type(data) is not bytes:
            data = bytes(data)
        for layout in self._layouts:
            if data.startswith(layout.key, _FRAME_OFFSET) and data.startswith(b'\0\1'):
                try:
                    return self._read_arrays(data, layout)
                except (struct.error, ValueError):  # the slow decoder finds out what is wrong
                    break
        return self._read_slowly(data)

    def _read_arrays(self, data: bytes, layout: _Layout
                     ) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        """Read a message of known layout; struct.error or ValueError where it is not sound."""
        _, _, size, order = layout
        position, arrays = layout.first, []
        for _ in FIELDS:
            (count,) = _COUNT.unpack_from(data, position)
            position += 4
            if count == 0:
                arrays.append(self._nothing.copy())
                continue
            if count != size:
                raise ValueError
            position += (HEADER_SIZE - position) % 8
            arrays.append(np.frombuffer(data, _DOUBLE, size, position).take(order))
            position += 8 * size
        sec, nanosec = _STAMP.unpack_from(data, _STAMP_OFFSET)
        return sec * NANOSECONDS + nanosec, arrays[0], arrays[1], arrays[2]

    def _read_slowly(self, data: bytes) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        cursor = Cursor(data, _WHAT)
        stamp_ns, _, names = _decode_head(cursor)
        order = self._match(names)
        layout_end = cursor.pos
        arrays = []
        for field in FIELDS:
            values = cursor.doubles(field)
            if len(values) == 0:
                arrays.append(self._nothing.copy())
            elif len(values) == len(names):
                arrays.append(values[order])
            else:
                raise BagError(f'JointState.{field} has {len(values)} values for {len(names)} '
                               'names: expected as many, or none')
        if cursor.order == '<' and self.joints:
            self._remember(data[_FRAME_OFFSET:layout_end], names, order)
        return stamp_ns, arrays[0], arrays[1], arrays[2]

    def _match(self, names: tuple[str, ...]) -> np.ndarray:
        """Return the index of each of our joints in `names`, shape (n,)."""
        _refuse_duplicates(names, 'message')
        where = {name: i for i, name in enumerate(names)}
        if missing := [joint for joint in self.joints if joint not in where]:
            raise BagError(f'JointState lacks joint {", ".join(map(repr, missing))}: '
                           f'it has {list(names)}')
        return np.array([where[joint] for joint in self.joints], dtype=np.intp)

    def _remember(self, key: bytes, names: tuple[str, ...], order: np.ndarray) -> None:
        if any(layout.key == key for layout in self._layouts):
            return
        first = align(_FRAME_OFFSET + len(key), 4)
        self._layouts.insert(0, _Layout(key, first, len(names), order))
        del self._layouts[_MAX_LAYOUTS:]


def _refuse_duplicates(names: tuple[str, ...], where: str) -> None:
    if len(set(names)) != len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise BagError(f'JointState {where} names {", ".join(map(repr, twice))} more than once: '
                       'expected each name once')
