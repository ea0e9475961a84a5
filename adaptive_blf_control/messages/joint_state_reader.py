# SPDX-License-Identifier: Apache-2.0
"""Decoder for sensor_msgs/msg/JointState that matches joints by name, fast for known layouts."""

from __future__ import annotations

from collections.abc import Sequence
import struct
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr_cursor import align, Cursor, HEADER_SIZE, STAMP
from adaptive_blf_control.messages.joint_state import (
    decode_head,
    FIELDS,
    NANOSECONDS,
    refuse_duplicates,
)

__all__ = ['JointStateReader']

_COUNT = struct.Struct('<I')
_DOUBLE = np.dtype('<f8')
_FRAME_OFFSET = HEADER_SIZE + STAMP.size
# Layouts kept. A topic has one for each publisher; more than this many show a fault.
_MAX_LAYOUTS = 8


class _Layout(NamedTuple):
    """What one publisher's messages have in common.

    Attributes:
        frame: frame_id.
        key: Bytes of frame_id and names; they fix where the arrays begin.
        first: Offset of the count of `position`.
        size: Number of names.
        order: Index of each of our joints among the names, shape (n,).
        ours: Whether the names are our joints in our order.
        head: Format of stamp and counts of a message whose arrays are all as long as the names.
        begin: Offset of the first number of such a message.
        end: Offset behind its last one.
    """

    frame: bytes
    key: bytes
    first: int
    size: int
    order: np.ndarray
    ours: bool
    head: str
    begin: int
    end: int


def _layout(frame: bytes, key: bytes, size: int, order: np.ndarray) -> _Layout:
    first = align(_FRAME_OFFSET + len(key), 4)
    begin = first + 4
    begin += (HEADER_SIZE - begin) % 8
    before, between = first - HEADER_SIZE - STAMP.size, begin - first - 4 + 8 * size
    # Behind each array the count of the next one takes a whole word.
    head = f'{STAMP.format}{before}xI{between}xI{4 + 8 * size}xI'
    return _Layout(frame, key, first, size, order, order.tolist() == list(range(size)), head,
                   begin, begin + 8 * (3 * size + 2))


class JointStateReader:
    """Decoder that returns the numbers in the order of given joints, matched by name.

    The permutation is kept for each layout (frame_id and names as bytes), so that only the first
    message of a publisher is parsed name by name.

    Attributes:
        source: frame_id of the message read last: what it says of its publisher.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        """Take the joints; BagError if one is listed twice."""
        self.joints = tuple(joints)
        self.source = b''
        refuse_duplicates(self.joints, 'reader')
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
        size, order = layout.size, layout.order
        if len(data) >= layout.end:
            sec, nanosec, a, b, c = struct.unpack_from(layout.head, data, HEADER_SIZE)
            if a == b == c == size:
                rows = np.ndarray((3, size), _DOUBLE, data, layout.begin, (8 * (size + 1), 8))
                rows = rows.copy() if layout.ours else rows.take(order, 1)
                self.source = layout.frame
                return sec * NANOSECONDS + nanosec, rows[0], rows[1], rows[2]
        place, arrays = layout.first, []
        for _ in FIELDS:
            (count,) = _COUNT.unpack_from(data, place)
            place += 4
            if count == 0:
                arrays.append(self._nothing.copy())
                continue
            if count != size:
                raise ValueError
            place += (HEADER_SIZE - place) % 8
            arrays.append(np.frombuffer(data, _DOUBLE, size, place).take(order))
            place += 8 * size
        sec, nanosec = STAMP.unpack_from(data, HEADER_SIZE)
        self.source = layout.frame
        return sec * NANOSECONDS + nanosec, arrays[0], arrays[1], arrays[2]

    def _read_slowly(self, data: bytes) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        cursor = Cursor(data, 'JointState')
        stamp_ns, frame_id, names = decode_head(cursor)
        frame = frame_id.encode()
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
            self._remember(frame, data[_FRAME_OFFSET:layout_end], names, order)
        self.source = frame
        return stamp_ns, arrays[0], arrays[1], arrays[2]

    def _match(self, names: tuple[str, ...]) -> np.ndarray:
        """Return the index of each of our joints in `names`, shape (n,)."""
        refuse_duplicates(names, 'message')
        where = {name: i for i, name in enumerate(names)}
        if missing := [joint for joint in self.joints if joint not in where]:
            raise BagError(f'JointState lacks joint {", ".join(map(repr, missing))}: '
                           f'it has {list(names)}')
        return np.array([where[joint] for joint in self.joints], dtype=np.intp)

    def _remember(self, frame: bytes, key: bytes, names: tuple[str, ...],
                  order: np.ndarray) -> None:
        if any(layout.key == key for layout in self._layouts):
            return
        self._layouts.insert(0, _layout(frame, key, len(names), order))
        del self._layouts[_MAX_LAYOUTS:]
