# SPDX-License-Identifier: Apache-2.0
"""What the nodes themselves counted as dropped or lost, from recorded ``/diagnostics``."""

from __future__ import annotations

from collections.abc import Iterable

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr_cursor import Cursor

__all__ = ['drop_counters', 'decode_diagnostics']


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
