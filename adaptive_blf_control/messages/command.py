# SPDX-License-Identifier: Apache-2.0
"""Commands as std_msgs/msg/Float64MultiArray whose layout says who sends them, and to which state.

The label of the one dimension is ``NODE#TOKEN STAMP``: the full name of the controller with the
token of its process, and the stamp of the state that the command answers [ns], 19 digits, 0 where
it answers none. Drivers that do not know the label, such as ros2_controllers' effort group
controller, ignore it; commands of a controller that does not know it have none. It is written by
`cdr.Float64MultiArrayCodec`.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import decode_float64_array
from adaptive_blf_control.messages.cdr_cursor import Cursor, HEADER_SIZE

__all__ = ['Command', 'answered_stamp', 'read_command']

_LABEL = re.compile(r'(.+#[0-9a-f]{8}) ([0-9]{19})')


class Command(NamedTuple):
    """A command as it was received.

    Attributes:
        torque: Of any length [N·m].
        source: What it says of its publisher, b'' where it says nothing.
        stamp_ns: Stamp of the state that it answers [ns]; None where it says none.
    """

    torque: np.ndarray
    source: bytes
    stamp_ns: int | None


def answered_stamp(data: bytes) -> int | None:
    """Return the stamp [ns] of the state that a command answers; None where it says none."""
    try:
        return read_command(data).stamp_ns
    except BagError:
        return None


def read_command(data: bytes) -> Command:
    """Read a command; BagError where it is truncated or garbage, with the offset."""
    torque = decode_float64_array(data)
    if data[HEADER_SIZE:HEADER_SIZE + 4] == bytes(4):
        return Command(torque, b'', None)
    cursor = Cursor(bytes(data), 'Float64MultiArray')
    cursor.count(12, 'layout.dim')
    label = cursor.string('layout.dim[0].label')
    known = _LABEL.fullmatch(label)
    if known is None:
        return Command(torque, label.encode(), None)
    return Command(torque, known[1].encode(), int(known[2]) or None)
