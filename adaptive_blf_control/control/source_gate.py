# SPDX-License-Identifier: Apache-2.0
"""One source at a time: which of several publishers of a topic is believed.

A source is known by what its messages say of it: the label of a command, the ``frame_id`` of a
state or a named vector. It is chosen when it speaks first, kept while it speaks, and changed only
after it has been silent. Sequence numbers and rates choose nobody. They show one thing: numbers
that do not continue come from two publishers that say the same of themselves. Between these
nothing is guessed: neither is believed until only one speaks.
"""

from __future__ import annotations

from collections.abc import Callable
import re

from adaptive_blf_control.control.refusal import Refusal

__all__ = ['SourceGate', 'is_unique']

LONGEST_GAP = 100  # messages that may be lost on the way
_UNIQUE = re.compile(rb'#[0-9a-f]{8}$')


def is_unique(source: bytes) -> bool:
    """Whether a source is named as the nodes of this package name themselves: NAME#8 hex digits.

    Then no other process says the same of itself.
    """
    return _UNIQUE.search(source) is not None


class SourceGate:
    """Lets the messages of one source through; times are of one monotonic clock [s].

    Attributes:
        source: The one that is believed; None before the first message.
        number: Publication number of its last message; None where there is none.
        other: The one that was refused last, b'' where it says nothing of itself.
        refused_at: When a message was refused last; minus infinity before.
    """

    def __init__(self, what: str) -> None:
        """Take what a message is called in refusals, e.g. ``command``."""
        self.source: bytes | None = None
        self.number: int | None = None
        self.other = b''
        self.refused_at = self._disputed_at = self._seen_at = float('-inf')
        self._unique = False  # whether the source is one of a kind
        self._what = what

    def refuse(self, source: bytes, number: int | None, now: float, timeout: float,
               alone: Callable[[], bool],
               listening_since: float = float('-inf')) -> Refusal | None:
        """Return why a message is not believed, None where it is.

        Args:
            source: What the message says of its source; b'' for nothing.
            number: Publication sequence number; None where the middleware has none.
            now: When it arrived.
            timeout: Silence after which another source may follow [s].
            alone: Whether the topic has one publisher only; asked where numbers do not continue.
                A publisher that was made again counts from 1, and has the topic for itself.
            listening_since: When the listener last went on after a pause of its own, in which the
                source was not silent for all it knows.
        """
        silent = now - max(self._seen_at, listening_since) > timeout
        if source != self.source:
            if self.source is not None and not silent:
                self.other, self.refused_at = source, now
                return Refusal(f'{self._what} of a second publisher',
                               f'{_named(source)} is refused while {_named(self.source)} speaks',
                               fault=True)
            self._begin(source)
        elif silent:
            self._begin(source)
        self._seen_at = now
        if not self._unique and not self._continues(number) and not alone():
            self._disputed_at = now
        self.number = number
        if now - self._disputed_at > timeout:
            return None
        self.other, self.refused_at = source, now
        return Refusal(f'{self._what} of one of two publishers',
                       f'they cannot be told apart, {_named(source)}: neither is believed '
                       f'until one has been silent for {timeout:g} s', fault=True)

    def _begin(self, source: bytes) -> None:
        self.source, self.number, self._unique = source, None, is_unique(source)

    def _continues(self, number: int | None) -> bool:
        if number is None:
            return False
        return self.number is None or 0 < number - self.number <= LONGEST_GAP


def _named(source: bytes) -> str:
    return repr(source.decode(errors='backslashreplace')) if source else 'one without a name'
