# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/msg/JointState as CDR bytes: encoder and general decoder."""

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
    STAMP,
)

__all__ = ['FIELDS', 'NANOSECONDS', 'JointStateCodec', 'JointStateRecord', 'decode_head',
           'decode_joint_state', 'refuse_duplicates']

FIELDS = ('position', 'velocity', 'effort')
NANOSECONDS = 1_000_000_000

_WHAT = 'JointState'


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


def decode_head(cursor: Cursor) -> tuple[int, str, tuple[str, ...]]:
    """Read the first fields of a JointState: stamp [ns], frame_id and names."""
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
    return JointStateRecord(*decode_head(cursor), *(cursor.doubles(field) for field in FIELDS))


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
        refuse_duplicates(self.names, 'codec')
        if unknown := sorted(set(fields) - set(FIELDS)):
            raise BagError(f'JointState has no field {unknown}: expected some of {FIELDS}')
        head = bytearray(ENCAPSULATION_LE + bytes(STAMP.size))
        head += encode_string(frame_id, 'frame_id')
        head += bytes(align(len(head), 4) - len(head)) + struct.pack('<I', len(self.names))
        for name in self.names:
            head += bytes(align(len(head), 4) - len(head)) + encode_string(name, 'joint name')
        self._buffer, self._offsets = self._append_arrays(head)
        self._lengths = tuple(0 if offset is None else len(self.names)
                              for offset in self._offsets)
        self._views = [None if offset is None else
                       np.frombuffer(self._buffer, '<f8', len(self.names), offset)
                       for offset in self._offsets]

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
        try:
            STAMP.pack_into(self._buffer, HEADER_SIZE, *divmod(stamp_ns, NANOSECONDS))
        except struct.error as exc:
            raise BagError(f'stamp {stamp_ns!r} ns: expected whole nanoseconds below 2**31 s'
                           ) from exc
        if (len(position), len(velocity), len(effort)) != self._lengths:
            raise self._wrong_length(position, velocity, effort)
        first, second, third = self._views
        try:
            if first is not None:
                first[...] = position
            if second is not None:
                second[...] = velocity
            if third is not None:
                third[...] = effort
        except (ValueError, TypeError) as exc:
            raise BagError(f'JointState: {exc}: expected {len(self.names)} numbers for each of '
                           f'{", ".join(self.fields)}') from exc
        return bytes(self._buffer)

    def _wrong_length(self, *values: Sequence[float] | np.ndarray) -> BagError:
        field, given, expected = next(
            (field, len(given), expected)
            for field, given, expected in zip(FIELDS, values, self._lengths)
            if len(given) != expected)
        return BagError(f'JointState.{field} has {given} values: expected {expected}')


def refuse_duplicates(names: tuple[str, ...], where: str) -> None:
    """Raise BagError if ``names`` has a name twice; ``where`` says whose names they are."""
    if len(set(names)) != len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise BagError(f'JointState {where} names {", ".join(map(repr, twice))} more than once: '
                       'expected each name once')
