# SPDX-License-Identifier: Apache-2.0
"""The sample that a message belongs to, so that bags of equal lockstep runs are equal."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

__all__ = ['Dated', 'SampleDates', 'has_sample_time']

LONGEST_DELIVERY = 10 * 10**9  # ns after which a message is no longer on its way
# Other times with which messages begin, as on /parameter_events and /rosout, are wall time.
TIMES = (('header', 'std_msgs/Header'), ('clock', 'builtin_interfaces/Time'))


def has_sample_time(message_type: Any) -> bool:
    """Whether such a message begins with the time of its sample."""
    fields = list(message_type.get_fields_and_field_types().items())
    return bool(fields) and fields[0] in TIMES


class Dated(NamedTuple):
    """A message and its date.

    Attributes:
        topic: Its topic.
        type_name: Its type.
        data: CDR bytes.
        stamp_ns: Stamp of its sample [ns].
    """

    topic: str
    type_name: str
    data: bytes
    stamp_ns: int


class SampleDates:
    """Dates messages without a stamp by the newest state that was published before them.

    The time of sending counts, not that of arrival: an answer may arrive at the recorder before
    the state that it answers. So a message waits until a state sent later has arrived, however
    long the first one takes: what a driver says of itself comes before it.
    """

    def __init__(self) -> None:
        """Start without states and messages."""
        self._states: deque[tuple[int, int]] = deque()  # sent, stamp [ns]
        self._waiting: deque[tuple[int, str, str, bytes]] = deque()

    def state(self, sent_ns: int, stamp_ns: int) -> None:
        """Note a state sent at ``sent_ns``; states have to come in the order of sending."""
        self._states.append((sent_ns, stamp_ns))

    def add(self, sent_ns: int, topic: str, type_name: str, data: bytes) -> None:
        """Keep a message without a stamp until its date is known."""
        self._waiting.append((sent_ns, topic, type_name, data))

    def take(self, now_ns: int | None = None) -> Iterator[Dated]:
        """Yield the messages whose date is known, those of a topic in the order of arrival.

        Args:
            now_ns: Present time on the clock of ``sent_ns``; None at the end, to yield all.
        """
        newest = self._states[-1][0] if self._states else 0
        for _ in range(len(self._waiting)):
            sent, topic, type_name, data = self._waiting.popleft()
            late = now_ns is None or (newest > 0 and sent < now_ns - LONGEST_DELIVERY)
            if late or sent < newest:
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
