# SPDX-License-Identifier: Apache-2.0
"""A bounds-checked walk over one CDR message (XCDR1, plain, either byte order)."""

from __future__ import annotations

import struct

import numpy as np

from adaptive_blf_control.errors import BagError

__all__ = ['BYTE_ORDERS', 'ENCAPSULATION_LE', 'HEADER_SIZE', 'STAMP', 'Cursor', 'align',
           'encode_string', 'is_cdr']

HEADER_SIZE = 4
STAMP = struct.Struct('<iI')  # builtin_interfaces/Time, little endian
ENCAPSULATION_LE = b'\x00\x01\x00\x00'
BYTE_ORDERS = {b'\x00\x01': '<', b'\x00\x00': '>'}  # of struct, by representation


def align(offset: int, size: int) -> int:
    """Return the next offset that is a multiple of `size` counted after the header."""
    return offset + (HEADER_SIZE - offset) % size



def is_cdr(data: bytes) -> bool:
    """Return whether data begin with the encapsulation header of some CDR representation.

    Those of DDS-XTypes 1.3, 7.6.2.1.2, are 0x0000 to 0x000b.
    """
    return len(data) >= HEADER_SIZE and data[0] == 0 and data[1] <= 0x0b


def encode_string(text: str, what: str) -> bytes:
    """Return length, UTF-8 bytes and terminator of a CDR string, without padding.

    Raises:
        BagError: the text holds a NUL or cannot be written as UTF-8.
    """
    try:
        raw = text.encode()
    except UnicodeEncodeError as exc:
        raise BagError(f'{what} {text!r} cannot be written as UTF-8: {exc.reason}') from exc
    if b'\0' in raw:
        raise BagError(f'{what} {text!r} holds a NUL character: expected none')
    return struct.pack('<I', len(raw) + 1) + raw + b'\0'


class Cursor:
    """Position in a CDR message; every read checks the bytes that are left first.

    Attributes:
        data: The whole message with its 4-byte encapsulation header.
        order: struct's byte order mark, ``<`` or ``>``.
        pos: Offset of the next byte, counted from the start of `data`.
    """

    __slots__ = ('data', 'order', 'pos')

    def __init__(self, data: bytes, what: str) -> None:
        """Read the encapsulation header; BagError where it is short or not plain CDR."""
        if len(data) < HEADER_SIZE:
            raise BagError(f'{what} of {len(data)} bytes is truncated at offset 0: expected '
                           'the 4-byte encapsulation header')
        order = BYTE_ORDERS.get(data[:2])
        if order is None:
            raise BagError(f'{what} at offset 0 has representation 0x{data[:2].hex()}: expected '
                           '0x0001 (CDR little endian) or 0x0000 (big endian)')
        self.data, self.order, self.pos = data, order, HEADER_SIZE

    def take(self, size: int, alignment: int, what: str) -> int:
        """Step over `size` aligned bytes and return where they start; BagError if too few."""
        start = align(self.pos, alignment)
        if start + size > len(self.data):
            raise BagError(f'{what} at offset {start} needs {size} bytes, '
                           f'{max(len(self.data) - start, 0)} are left: message is truncated')
        self.pos = start + size
        return start

    def int32(self, what: str) -> int:
        """Read a signed 32-bit integer."""
        start = self.take(4, 4, what)
        return int(struct.unpack_from(self.order + 'i', self.data, start)[0])

    def uint32(self, what: str) -> int:
        """Read an unsigned 32-bit integer."""
        start = self.take(4, 4, what)
        return int(struct.unpack_from(self.order + 'I', self.data, start)[0])

    def double(self, what: str) -> float:
        """Read a 64-bit float."""
        start = self.take(8, 8, what)
        return float(struct.unpack_from(self.order + 'd', self.data, start)[0])

    def count(self, smallest: int, what: str) -> int:
        """Read a sequence's length; BagError where the rest cannot hold that many items."""
        number = self.uint32(what)
        if number * smallest > len(self.data) - self.pos:
            raise BagError(f'{what} at offset {self.pos - 4} claims {number} items, '
                           f'{len(self.data) - self.pos} bytes are left: message is truncated')
        return number

    def string(self, what: str) -> str:
        """Read a string; bytes that are not UTF-8 become hex escapes, so names stay distinct."""
        length = self.count(1, what)
        if length == 0:  # not valid CDR, but some writers do it
            return ''
        start = self.take(length, 1, what)
        if self.data[start + length - 1] != 0:
            raise BagError(f'{what} at offset {start} of {length} bytes: expected a final NUL')
        return self.data[start:start + length - 1].decode(errors='backslashreplace')

    def doubles(self, what: str) -> np.ndarray:
        """Read a sequence of float64 as a fresh native array, shape (count,)."""
        number = self.count(8, what)
        # An empty sequence has no alignment gap behind its count.
        start = self.take(8 * number, 8, what) if number else self.pos
        return np.frombuffer(self.data, self.order + 'f8', number, start).astype(np.float64)
