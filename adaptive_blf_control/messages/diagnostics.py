# SPDX-License-Identifier: Apache-2.0
"""Encoder for diagnostic_msgs/DiagnosticArray: equal content gives equal bytes.

ROS's own serialiser leaves whatever was in memory between the strings.
"""

from __future__ import annotations

from collections.abc import Mapping
import struct

from adaptive_blf_control.messages.cdr_cursor import align, ENCAPSULATION_LE, encode_string

__all__ = ['encode_diagnostics']


def encode_diagnostics(stamp_ns: int, level: bytes, name: str, message: str, hardware_id: str,
                       values: Mapping[str, object]) -> bytes:
    """Return an array of one status as CDR.

    Args:
        stamp_ns: ``header.stamp`` [ns], from 0 to below 2³¹ s.
        level: A constant of diagnostic_msgs/DiagnosticStatus.
        name: Who reports.
        message: What the matter is.
        hardware_id: Of what.
        values: What is written as text under each key.
    """
    out = bytearray(ENCAPSULATION_LE + struct.pack('<iI', *divmod(stamp_ns, 10**9)))
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
