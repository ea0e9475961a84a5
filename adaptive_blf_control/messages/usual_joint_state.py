# SPDX-License-Identifier: Apache-2.0
"""Joint states as a node reads and writes them sample after sample, in one compiled call each.

For what runs with the laws: who reads a bag loads no compiler for it. What is not the usual
message, and everything where nothing is compiled, goes the way of `JointStateReader` and
`JointStateCodec`, with the same result.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, COMPILED, entry_for, Handle, handle, jit
from adaptive_blf_control.messages.cdr_cursor import HEADER_SIZE, STAMP
from adaptive_blf_control.messages.joint_state import FIELDS, JointStateCodec, NANOSECONDS
from adaptive_blf_control.messages.joint_state_reader import JointStateReader, Layout

__all__ = ['StandingJointStateCodec', 'UsualJointStateReader']

NO_STAMP = -2**63  # of a message with another layout
_STAMPS = 2**31 * NANOSECONDS


class Pattern(NamedTuple):
    """What is compared and taken of a message; a byte where ``mask`` is 0 may be any.

    Attributes:
        template: A message of this layout, shape (size,), uint8.
        mask: 255 where a message has to be the same, else 0, likewise.
        places: Offsets of our numbers, those of one array after those of the other, shape (k,);
            -1 for one that the message does not have.
        numbers: Our numbers as bytes, to be filled, shape (8 k,), uint8.
    """

    template: np.ndarray
    mask: np.ndarray
    places: np.ndarray
    numbers: np.ndarray


class Frame(NamedTuple):
    """A message whose numbers are taken from arrays, and where in it they are written.

    Attributes:
        stamp: Seconds and nanoseconds, int32, shape (2,).
        first: First array of the message, float64, shape (k,); k is 0 where it is empty.
        second: Likewise.
        third: Likewise.
        positions: Where the first is written, shape (k,).
        velocities: The second, likewise.
        efforts: The third, likewise.
    """

    stamp: np.ndarray
    first: np.ndarray
    second: np.ndarray
    third: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    efforts: np.ndarray


@jit
def read_usual(pattern: Handle, data: bytes) -> int:
    """Take our numbers out of a message of a `Pattern`.

    Returns:
        Its stamp [ns]; NO_STAMP where the message has another layout.
    """
    usual = pattern.value
    template, mask, places, numbers = usual.template, usual.mask, usual.places, usual.numbers
    message = borrowed(data)
    if len(message) != template.size:
        return NO_STAMP
    differ = np.uint8(0)
    for i in range(template.size):  # to the end: several bytes at a time
        differ |= (message[i] ^ template[i]) & mask[i]
    if differ:
        return NO_STAMP
    for i in range(places.size):
        for k in range(8 if places[i] >= 0 else 0):
            numbers[8 * i + k] = message[places[i] + k]
    seconds, nanoseconds = np.int64(0), np.int64(0)
    for i in range(4):
        seconds |= np.int64(message[HEADER_SIZE + i]) << (8 * i)
        nanoseconds |= np.int64(message[HEADER_SIZE + 4 + i]) << (8 * i)
    if seconds >= 2**31:
        seconds -= 2**32
    return int(seconds * NANOSECONDS + nanoseconds)


@jit
def write_usual(frame: Handle, stamp: int) -> None:
    """Write stamp [ns] and numbers of a `Frame` into its message."""
    message = frame.value
    seconds = stamp // NANOSECONDS
    message.stamp[0], message.stamp[1] = seconds, stamp - seconds * NANOSECONDS
    first, second, third = message.first, message.second, message.third
    positions, velocities, efforts = message.positions, message.velocities, message.efforts
    for i in range(first.size):
        positions[i] = first[i]
    for i in range(second.size):
        velocities[i] = second[i]
    for i in range(third.size):
        efforts[i] = third[i]


class _Usual(NamedTuple):
    """What reads messages of a layout, and where position, velocity and effort then are."""

    pattern: Handle
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    frame: bytes


class UsualJointStateReader(JointStateReader):
    """`JointStateReader` that takes messages of layouts it knows in one compiled call."""

    def __init__(self, joints: Sequence[str]) -> None:
        """Take the joints; BagError if one is listed twice."""
        super().__init__(joints)
        self._usual: list[_Usual] = []
        if COMPILED:  # here, not between two samples
            nothing = np.zeros(1, np.uint8)
            self._read_usual: Any = entry_for(
                read_usual, handle(Pattern(nothing, nothing, np.zeros(0, np.int64), nothing)),
                b'')

    def __reduce__(self) -> Any:
        """Return what a copy or a pickle makes: a reader that has met no message yet."""
        return type(self), (self.joints,)

    def read(self, data: bytes) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
        """Return stamp [ns], position, velocity and effort, see `JointStateReader.read`."""
        if type(data) is not bytes:
            data = bytes(data)
        for pattern, position, velocity, effort, frame in self._usual:
            stamp = self._read_usual(pattern, data)
            if stamp != NO_STAMP:
                self.source = frame
                return stamp, position.copy(), velocity.copy(), effort.copy()
        return super().read(data)

    def _keep(self, layout: Layout, data: bytes) -> None:
        super()._keep(layout, data)
        if not COMPILED:
            return
        template = np.frombuffer(data, np.uint8, layout.end).copy()
        mask = np.zeros(layout.end, np.uint8)
        mask[:2] = mask[HEADER_SIZE + STAMP.size:] = 255
        for start in layout.starts:
            mask[start:start + 8 * max(layout.counts)] = 0
        numbers, places = np.full((3, len(self.joints)), np.nan), layout.places()
        self._usual.insert(0, _Usual(handle(Pattern(
            template, mask, places, numbers.reshape(-1).view(np.uint8))),
            numbers[0], numbers[1], numbers[2], layout.frame))
        del self._usual[len(self._layouts):]


class StandingJointStateCodec(JointStateCodec):
    """`JointStateCodec` for numbers that mostly lie in the same arrays as in the last message.

    Those are written in one compiled call.
    """

    def __init__(self, names: Sequence[str], frame_id: str = '',
                 fields: Sequence[str] = FIELDS) -> None:
        """Lay out the message, see `JointStateCodec`."""
        super().__init__(names, frame_id, fields)
        self._first: Any = None
        self._second: Any = None
        self._third: Any = None
        self._frame: Handle | None = None
        # The message with its numbers on words of the memory.
        self._message = np.frombuffer(bytes(HEADER_SIZE) + self._buffer,
                                      np.uint8).copy()[HEADER_SIZE:]
        if COMPILED:  # here, not between two samples
            empty = np.zeros(0)
            self._write_usual: Any = entry_for(
                write_usual, handle(Frame(np.zeros(2, np.int32), *6 * (empty,))), 0)

    def encode(self, stamp_ns: int, position: Sequence[float] | np.ndarray = (),
               velocity: Sequence[float] | np.ndarray = (),
               effort: Sequence[float] | np.ndarray = ()) -> bytes:
        """Return the message, see `JointStateCodec.encode`."""
        if (position is self._first and velocity is self._second and effort is self._third
                and self._frame is not None and type(stamp_ns) is int
                and 0 <= stamp_ns < _STAMPS):
            self._write_usual(self._frame, stamp_ns)
            return self._message.tobytes()
        message = super().encode(stamp_ns, position, velocity, effort)
        self._stand(position, velocity, effort)
        return message

    def _stand(self, *given: Any) -> None:
        """Note arrays, and write from them once they come again."""
        again = all(a is b for a, b in zip(given, (self._first, self._second, self._third)))
        self._first, self._second, self._third = given
        self._frame = None
        if COMPILED and again and all(map(_may_stand, given)):
            room, size, empty = self._message, 8 * len(self.names), np.zeros(0)
            self._frame = handle(Frame(
                room[HEADER_SIZE:HEADER_SIZE + STAMP.size].view(np.int32),
                *(each if len(each) else empty for each in given),
                *(empty if at is None else room[at:at + size].view(np.float64)
                  for at in self._offsets)))


def _may_stand(value: Any) -> bool:
    return value == () if type(value) is tuple else (
        type(value) is np.ndarray and value.dtype == np.float64 and value.ndim == 1
        and value.flags.c_contiguous and value.flags.aligned)
