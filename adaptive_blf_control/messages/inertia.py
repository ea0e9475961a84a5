# SPDX-License-Identifier: Apache-2.0
"""geometry_msgs/msg/InertiaStamped as CDR bytes: encoder and decoder."""

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
from adaptive_blf_control.messages.joint_state import NANOSECONDS

__all__ = ['InertiaCodec', 'InertiaRecord', 'decode_inertia']

_VALUES = ('m', 'com.x', 'com.y', 'com.z', 'ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')


class InertiaRecord(NamedTuple):
    """One decoded message.

    Attributes:
        stamp_ns: ``header.stamp`` [ns].
        frame_id: ``header.frame_id``.
        mass: [kg].
        com: Centre of mass, shape (3,) [m].
        inertia: ixx, ixy, ixz, iyy, iyz, izz, shape (6,) [kg·m²].
    """

    stamp_ns: int
    frame_id: str
    mass: float
    com: np.ndarray
    inertia: np.ndarray


class InertiaCodec:
    """Encoder for messages in one frame. It reuses one buffer: an instance belongs to a thread."""

    def __init__(self, frame_id: str) -> None:
        """Lay out the message; BagError where the frame cannot be encoded."""
        head = bytearray(ENCAPSULATION_LE + bytes(STAMP.size))
        head += encode_string(frame_id, 'frame_id')
        head += bytes(align(len(head), 8) - len(head))
        self._start = len(head)
        self._buffer = head + bytes(8 * len(_VALUES))

    def encode(self, stamp_ns: int, mass: float, com: Sequence[float] | np.ndarray,
               inertia: Sequence[float] | np.ndarray) -> bytes:
        """Return the message.

        Args:
            stamp_ns: Time of the sample [ns]; seconds must fit a signed 32-bit integer.
            mass: [kg].
            com: Shape (3,) [m].
            inertia: In the order of the message, ixx, ixy, ixz, iyy, iyz, izz, shape (6,)
                [kg·m²].

        Raises:
            BagError: a wrong length, or a stamp that does not fit.
        """
        values = [mass, *com, *inertia]
        if len(values) != len(_VALUES):
            raise BagError(f'Inertia gets {len(values)} values: expected {", ".join(_VALUES)}')
        try:
            STAMP.pack_into(self._buffer, HEADER_SIZE, *divmod(stamp_ns, NANOSECONDS))
        except struct.error as exc:
            raise BagError(f'stamp {stamp_ns!r} ns: expected whole nanoseconds below 2**31 s'
                           ) from exc
        struct.pack_into('<10d', self._buffer, self._start, *values)
        return bytes(self._buffer)


def decode_inertia(data: bytes) -> InertiaRecord:
    """Decode an InertiaStamped of either byte order.

    Raises:
        BagError: truncated or garbage input, with the offset; nothing else is ever raised.
    """
    cursor = Cursor(bytes(data), 'InertiaStamped')
    stamp = cursor.int32('header.stamp.sec') * NANOSECONDS
    stamp += cursor.uint32('header.stamp.nanosec')
    frame = cursor.string('header.frame_id')
    values = np.array([cursor.double(name) for name in _VALUES])
    return InertiaRecord(stamp, frame, float(values[0]), values[1:4], values[4:])
