# SPDX-License-Identifier: Apache-2.0
"""diagnostic_msgs/msg/DiagnosticArray as CDR bytes: encoder, decoder, the counters in it.

Equal content gives equal bytes: ROS's own serialiser fills gaps with what was in memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import struct

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr_cursor import (
    align,
    Cursor,
    ENCAPSULATION_LE,
    encode_string,
    STAMP,
)

__all__ = ['decode_diagnostics', 'drop_counters', 'encode_diagnostics']


def encode_diagnostics(stamp_ns: int, level: bytes, name: str, message: str, hardware_id: str,
                       values: Mapping[str, object]) -> bytes:
    """Return an array of one status as CDR.

    Args:
        stamp_ns: ``header.stamp`` [ns], from 0 to below 2³¹ s.
        level: A constant of diagnostic_msgs/DiagnosticStatus.
        name: ``status.name``, the node that reports.
        message: ``status.message``, its state in words.
        hardware_id: ``status.hardware_id``, the arm.
        values: Written as text, each under its key.
    """
    out = bytearray(ENCAPSULATION_LE + STAMP.pack(*divmod(stamp_ns, 10**9)))
    _string(out, '')  # header.frame_id
    _count(out, 1)
    out += level
    for text in (name, message, hardware_id):
        _string(out, text)
    _count(out, len(values))
    for key, value in values.items():
        _string(out, key)
        _string(out, str(value))
    return bytes(out)


def _count(out: bytearray, count: int) -> None:
    out += bytes(align(len(out), 4) - len(out)) + struct.pack('<I', count)


def _string(out: bytearray, text: str) -> None:
    # Texts quote what others sent: nothing in them may keep a fault from being reported.
    text = text.replace('\0', '\\0').encode('utf-8', 'backslashreplace').decode()
    out += bytes(align(len(out), 4) - len(out)) + encode_string(text, 'diagnostics')


def decode_diagnostics(data: bytes) -> dict[str, dict[str, str]]:
    """Decode a diagnostic_msgs/DiagnosticArray to key-value pairs by status name.

    Raises:
        BagError: truncated or garbage input.
    """
    cursor = Cursor(bytes(data), 'DiagnosticArray')
    cursor.int32('header.stamp.sec')
    cursor.uint32('header.stamp.nanosec')
    cursor.string('header.frame_id')
    statuses: dict[str, dict[str, str]] = {}
    for _ in range(cursor.count(1, 'status')):
        cursor.take(1, 1, 'level')
        name = cursor.string('name')
        cursor.string('message')
        cursor.string('hardware_id')
        values = {}
        for _ in range(cursor.count(8, 'values')):
            key = cursor.string('key')
            values[key] = cursor.string('value')
        statuses[name] = values
    return statuses


def drop_counters(messages: Iterable[bytes]) -> list[dict[str, str | int]]:
    """Return the last value of every counter of dropped or lost messages that is not zero.

    Args:
        messages: DiagnosticArray messages in recorded order; damaged ones are skipped.

    Returns:
        One entry per counter: ``node``, ``what`` and ``count``.
    """
    last: dict[tuple[str, str], int] = {}
    for data in messages:
        try:
            statuses = decode_diagnostics(data)
        except BagError:
            continue
        for status, values in statuses.items():
            node = status.partition(':')[0]
            for key, value in values.items():
                if (key.startswith('dropped') or key.endswith(' lost')) and value.isdigit():
                    last[node, key] = int(value)
    return [{'node': node, 'what': what, 'count': count}
            for (node, what), count in sorted(last.items()) if count]
