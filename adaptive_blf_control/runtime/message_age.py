# SPDX-License-Identifier: Apache-2.0
"""How old a message is when it is handled, also where its sender's clock is another one."""

from __future__ import annotations

import math

__all__ = ['MessageAge']

DRIFT = 1e-3  # of the sender's clock against ours, more than any quartz has


class MessageAge:
    """Ages of the messages of one topic, against the one that took least time so far."""

    def __init__(self) -> None:
        """Start without messages."""
        self._least = math.inf
        self._last_ns = 0

    def of(self, sent_ns: int, now_ns: int) -> float:
        """Return the age [s] of a message sent at ``sent_ns`` by the sender's system clock.

        Args:
            sent_ns: ``source_timestamp`` [ns].
            now_ns: Our system clock [ns].
        """
        delay = float(now_ns - sent_ns)
        self._least = min(delay, self._least + DRIFT * max(now_ns - self._last_ns, 0))
        self._last_ns = now_ns
        return (delay - self._least) * 1e-9
