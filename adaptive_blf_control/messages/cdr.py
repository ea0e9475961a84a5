# SPDX-License-Identifier: Apache-2.0
"""CDR codecs for the messages on the real-time path, without ROS.

XCDR1 as DDS carries it: a 4-byte encapsulation header (00 01 00 00 for little endian), then the
fields, each aligned to its size counted from the byte after the header, strings and sequences
preceded by a uint32 count. Encoders write little endian with zero padding and exact length, as a
raw subscription delivers it; decoders read both byte orders and raise BagError with the offset on
anything else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import struct
from types import MappingProxyType

import numpy as np

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr_cursor import (
    align,
    Cursor,
    ENCAPSULATION_LE,
    encode_string,
)
from adaptive_blf_control.messages.joint_state import (
    decode_joint_state,
    JointStateCodec,
    JointStateRecord,
)
from adaptive_blf_control.messages.joint_state_reader import JointStateReader

__all__ = ['DECODERS', 'Float64MultiArrayCodec', 'JointStateCodec', 'JointStateReader',
           'JointStateRecord', 'decode_float64', 'decode_float64_array', 'decode_int32',
           'decode_joint_state', 'decode_string', 'encode_float64', 'encode_int32', 'encode_text']

_FLOAT64 = struct.Struct('<4sd')
_INT32 = struct.Struct('<4si')
# layout.dim empty, layout.data_offset 0, then the count of data.
_PLAIN_ARRAY = ENCAPSULATION_LE + bytes(8)
_ARRAY_COUNT = struct.Struct('<I')
STAMP_DIGITS = 19  # of a stamp below 2**31 s in ns
_ARRAY_START = 20


class Float64MultiArrayCodec:
    """Encoder for std_msgs/msg/Float64MultiArray of fixed length.

    With a label the layout has one dimension, whose label ends in a stamp; see
    :mod:`adaptive_blf_control.messages.command`. Without one the layout is empty. It reuses one
    buffer, so an instance belongs to one thread.
    """

    def __init__(self, n: int, label: str = '') -> None:
        """Lay out a message of `n` doubles."""
        self.n = n
        self._stamp: slice | None = None
        head = bytearray(_PLAIN_ARRAY)
        if label:
            head = bytearray(ENCAPSULATION_LE + struct.pack('<I', 1))
            head += encode_string(f'{label} {0:0{STAMP_DIGITS}d}', 'label')
            self._stamp = slice(len(head) - 1 - STAMP_DIGITS, len(head) - 1)
            _pad(head, 4)
            head += struct.pack('<III', n, n, 0)
        head += _ARRAY_COUNT.pack(n)
        if n:  # an empty sequence has no alignment gap behind its count
            _pad(head, 8)
        start = len(head)
        self._buffer = head + bytes(8 * n)
        self._view = np.frombuffer(self._buffer, '<f8', n, start if n else 0)

    def encode(self, values: Sequence[float] | np.ndarray, stamp_ns: int = 0) -> bytes:
        """Return the message for values of shape (n,); BagError where the length differs.

        Args:
            values: Of any unit.
            stamp_ns: Stamp in the label [ns], not negative; not used without one.
        """
        if len(values) != self.n:
            raise BagError(f'Float64MultiArray gets {len(values)} values: expected {self.n}')
        try:
            self._view[...] = values
        except (ValueError, TypeError) as exc:
            raise BagError(f'Float64MultiArray: {exc}: expected {self.n} numbers') from exc
        if self._stamp is not None:
            self._buffer[self._stamp] = b'%0*d' % (STAMP_DIGITS, max(stamp_ns, 0))
        return bytes(self._buffer)


def _pad(head: bytearray, size: int) -> None:
    head += bytes(align(len(head), size) - len(head))


def decode_float64_array(data: bytes) -> np.ndarray:
    """Return the `data` of a Float64MultiArray, shape (count,); its layout is checked and ignored.

    Raises:
        BagError: truncated or garbage input, with the offset.
    """
    if type(data) is not bytes:
        data = bytes(data)
    if data.startswith(_PLAIN_ARRAY) and len(data) >= _ARRAY_START:
        (count,) = _ARRAY_COUNT.unpack_from(data, 12)
        if _ARRAY_START + 8 * count <= len(data):
            return np.frombuffer(data, '<f8', count, _ARRAY_START).astype(np.float64)
    cursor = Cursor(data, 'Float64MultiArray')
    for i in range(cursor.count(12, 'layout.dim')):
        cursor.string(f'layout.dim[{i}].label')
        cursor.uint32(f'layout.dim[{i}].size')
        cursor.uint32(f'layout.dim[{i}].stride')
    cursor.uint32('layout.data_offset')
    return cursor.doubles('data')


def encode_float64(value: float) -> bytes:
    """Return a std_msgs/msg/Float64."""
    return _FLOAT64.pack(ENCAPSULATION_LE, value)


def decode_float64(data: bytes) -> float:
    """Return the value of a std_msgs/msg/Float64; BagError where it is truncated."""
    return Cursor(bytes(data), 'Float64').double('data')


def encode_int32(value: int) -> bytes:
    """Return a std_msgs/msg/Int32; BagError where the value does not fit."""
    try:
        return _INT32.pack(ENCAPSULATION_LE, value)
    except struct.error as exc:
        raise BagError(f'Int32 gets {value!r}: expected -2**31 to 2**31 - 1') from exc


def decode_int32(data: bytes) -> int:
    """Return the value of a std_msgs/msg/Int32; BagError where it is truncated."""
    return Cursor(bytes(data), 'Int32').int32('data')


def encode_text(text: str) -> bytes:
    """Return a std_msgs/msg/String; BagError where the text holds a NUL."""
    return ENCAPSULATION_LE + encode_string(text, 'String')


def decode_string(data: bytes) -> str:
    """Return the text of a std_msgs/msg/String; BagError where it is truncated."""
    return Cursor(bytes(data), 'String').string('data')


DECODERS: Mapping[str, Callable[[bytes], object]] = MappingProxyType({
    'sensor_msgs/msg/JointState': decode_joint_state,
    'std_msgs/msg/Float64MultiArray': decode_float64_array,
    'std_msgs/msg/Float64': decode_float64,
    'std_msgs/msg/Int32': decode_int32,
    'std_msgs/msg/String': decode_string,
})
