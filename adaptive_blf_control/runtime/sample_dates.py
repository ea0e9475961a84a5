# SPDX-License-Identifier: Apache-2.0
"""The sample a message belongs to, for a bag of a run in lockstep, whatever the machine's load."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

__all__ = ['Dated', 'SampleDates', 'has_sample_time']

LONGEST_DELIVERY = 10 * 10**9  # ns after which a message is no longer on its way
# Other times at the beginning, as of /parameter_events and /rosout, are those of a node's start.
TIMES = (('header', 'std_msgs/Header'), ('clock', 'builtin_interfaces/Time'))


def has_sample_time(message_type: Any) -> bool:
    """Whether such a message begins with the time of its sample."""
    fields = list(message_type.get_fields_and_field_types().items())
    return bool(fields) and fields[0] in TIMES


class Dated(NamedTuple):
    """A message and the time it is dated with.

    Attributes:
        topic: Its topic.
        type_name: Full name of its type.
        data: CDR bytes.
        stamp_ns: Stamp of its sample [ns].
    """

    topic: str
    type_name: str
    data: bytes
    stamp_ns: int


class SampleDates:
    """Dates messages without a stamp by the newest state that was published before them.

    What counts is when messages were sent, not when they arrived: an answer may overtake its
    state on the way to a third. So a message waits until a state sent later has been seen.
    """

    def __init__(self) -> None:
        """Start without states."""
        self._states: deque[tuple[int, int]] = deque()  # sent, stamp [ns]
        self._waiting: deque[tuple[int, str, str, bytes]] = deque()

    def state(self, sent_ns: int, stamp_ns: int) -> None:
        """Note a state, sent at ``sent_ns``; states come in the order in which they were sent."""
        self._states.append((sent_ns, stamp_ns))

    def add(self, sent_ns: int, topic: str, type_name: str, data: bytes) -> None:
        """Let a message without a stamp wait for its date."""
        self._waiting.append((sent_ns, topic, type_name, data))

    def take(self, now_ns: int | None = None) -> Iterator[Dated]:
        """Yield the messages whose date is known by now, by topic in the order they came.

        Args:
            now_ns: Present time on the clock of ``sent_ns``; None at the end: yields all.
        """
        newest = self._states[-1][0] if self._states else 0
        for _ in range(len(self._waiting)):
            sent, topic, type_name, data = self._waiting.popleft()
            if now_ns is None or sent < newest or sent < now_ns - LONGEST_DELIVERY:
                yield Dated(topic, type_name, data, self._date(sent))
            else:
                self._waiting.append((sent, topic, type_name, data))
        oldest = min((entry[0] for entry in self._waiting), default=newest)
        while len(self._states) > 1 and self._states[1][0] <= oldest:
            self._states.popleft()

    def _date(self, sent_ns: int) -> int:
        """Return the stamp of the newest state sent before; of the first where there is none."""
        return next((stamp for sent, stamp in reversed(self._states) if sent <= sent_ns),
                    self._states[0][1] if self._states else 0)
