# SPDX-License-Identifier: Apache-2.0
"""The stamp of a message, read without decoding the rest of it."""

from __future__ import annotations

import struct

from adaptive_blf_control.messages.cdr_cursor import BYTE_ORDERS, HEADER_SIZE

__all__ = ['STAMP_LIMIT', 'stamp_of']

STAMP_LIMIT = 2**31 * 10**9  # ns, the first time that builtin_interfaces/Time cannot hold


def stamp_of(data: bytes) -> int | None:
    """Return the time [ns] with which a message begins: of ``header.stamp``, or of a Time.

    None where the bytes are too few or not plain CDR.
    """
    order = BYTE_ORDERS.get(data[:2])
    if order is None or len(data) < HEADER_SIZE + 8:
        return None
    sec, nanosec = struct.unpack_from(f'{order}iI', data, HEADER_SIZE)
    return int(sec) * 10**9 + int(nanosec)
