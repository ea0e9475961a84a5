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

__all__ = ['JointStateReader', 'Layout']

_DOUBLE = np.dtype('<f8')
_LITTLE_ENDIAN = b'\0\1'
_FRAME_OFFSET = HEADER_SIZE + STAMP.size
# Layouts kept. A topic has one for each publisher; more than this many show a fault.
_MAX_LAYOUTS = 8


class Layout(NamedTuple):
    """What the messages of one publisher have in common, where its arrays keep their lengths.

    A word is 8 bytes. From the first number on all numbers lie on words.

    Attributes:
        key: Bytes of frame_id and names; they fix where the counts begin.
        end: Offset behind the message.
        head: Format of stamp and the three counts.
        counts: Those that the message has to have.
        starts: Offsets of the first numbers of the arrays that are not empty.
        words: Number of words from the first number to the last.
        order: Where our numbers are among the words, shape (k, n) for k arrays that are not
            empty; None where the names are our joints in our order.
        rows: Where position, velocity and effort are among the words, or which row of ``order``
            they are; None for an empty one.
        frame: frame_id.
    """

    key: bytes
    end: int
    head: str
    counts: tuple[int, ...]
    starts: tuple[int, ...]
    words: int
    order: np.ndarray | None
    rows: tuple[slice | int | None, ...]
    frame: bytes

    def places(self) -> np.ndarray:
        """Return the offsets of our numbers, row by row, shape (3 n,); -1 for an empty array."""
        ours = np.arange(self.words) if self.order is None else self.order
        found = [None if row is None else self.starts[0] + 8 * ours[row] for row in self.rows]
        n = next(each.size for each in found if each is not None)
        return np.concatenate([np.full(n, -1) if each is None else each for each in found])


def _layout(frame: bytes, key: bytes, counts: tuple[int, ...], order: np.ndarray) -> Layout:
    """Lay out messages with an array that is not empty.

    Args:
        frame: frame_id.
        key: Bytes of frame_id and names.
        counts: Lengths of the three arrays.
        order: Index of each of our joints among the names, shape (n,).
    """
    head, place, end, starts = STAMP.format, _FRAME_OFFSET, _FRAME_OFFSET + len(key), []
    for count in counts:
        after = align(end, 4)
        head += f'{after - place}xI'
        place = end = after + 4
        if count:
            starts.append(align(end, 8))
            end = starts[-1] + 8 * count
    size, n = max(counts), len(order)
    words = [(start - starts[0]) // 8 for start in starts]
    ours = order.tolist() == list(range(size))
    places = [slice(word, word + n) if ours else row for row, word in enumerate(words)]
    rows = iter(places)
    return Layout(key, end, head, counts, tuple(starts),
                   words[-1] + size, None if ours else np.add.outer(words, order),
                   tuple(next(rows) if count else None for count in counts), frame)


class JointStateReader:
    """Decoder that returns the numbers in the order of given joints, matched by name.

    Each layout (frame_id and names as bytes, lengths of the arrays) is kept, so that only the
    first message of a publisher is parsed name by name.

    Attributes:
        source: frame_id of the message read last: what it says of its publisher.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        """Take the joints; BagError if one is listed twice."""
        self.joints = tuple(joints)
        self.source = b''
        refuse_duplicates(self.joints, 'reader')
        self._layouts: list[Layout] = []
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
            if (data.startswith(layout.key, _FRAME_OFFSET) and len(data) >= layout.end
                    and data.startswith(_LITTLE_ENDIAN)):
                sec, nanosec, a, b, c = struct.unpack_from(layout.head, data, HEADER_SIZE)
                if (a, b, c) == layout.counts:
                    self.source = layout.frame
                    stamp = sec * NANOSECONDS + nanosec
                    words = np.frombuffer(data, _DOUBLE, layout.words, layout.starts[0])
                    rows = words.copy() if layout.order is None else words.take(layout.order)
                    a, b, c = layout.rows
                    return (stamp, self._nothing.copy() if a is None else rows[a],
                            self._nothing.copy() if b is None else rows[b],
                            self._nothing.copy() if c is None else rows[c])
        return self._read_slowly(data)  # it also finds out what is wrong

    def _keep(self, layout: Layout, data: bytes) -> None:
        """Keep the layout of a message."""
        self._layouts.insert(0, layout)
        del self._layouts[_MAX_LAYOUTS:]

    def _read_slowly(self, data: bytes) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        cursor = Cursor(data, 'JointState')
        stamp_ns, frame_id, names = decode_head(cursor)
        frame = frame_id.encode()
        order = self._match(names)
        layout_end = cursor.pos
        arrays, counts = [], []
        for field in FIELDS:
            values = cursor.doubles(field)
            counts.append(len(values))
            if len(values) == 0:
                arrays.append(self._nothing.copy())
            elif len(values) == len(names):
                arrays.append(values[order])
            else:
                raise BagError(f'JointState.{field} has {len(values)} values for {len(names)} '
                               'names: expected as many, or none')
        if cursor.order == '<' and self.joints and any(counts):
            self._keep(_layout(frame, data[_FRAME_OFFSET:layout_end], tuple(counts), order), data)
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
