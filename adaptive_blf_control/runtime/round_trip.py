# SPDX-License-Identifier: Apache-2.0
"""Round trips: from the publication of a state to the arrival of the command that answers it."""

from __future__ import annotations

from collections import deque

from adaptive_blf_control.runtime.loop_statistics import Histogram

__all__ = ['RoundTrips']

# A command cannot answer a state that is younger than this: decoding and the law take longer.
SHORTEST_ANSWER = 50_000  # ns
KEPT = 50  # states that may still be answered


class RoundTrips:
    """Counts round trips on one host; times in ns of its system clock.

    Attributes:
        histogram: The round trips.
    """

    def __init__(self) -> None:
        """Start with nothing sent."""
        self.histogram = Histogram()
        self._sent: deque[tuple[int, int]] = deque(maxlen=KEPT)  # stamp, when it went out

    def sent(self, stamp_ns: int, now_ns: int) -> None:
        """Note that the state of a stamp goes out."""
        self._sent.append((stamp_ns, now_ns))

    def answered(self, stamp_ns: int | None, published_ns: int, now_ns: int) -> None:
        """Count the round trip of the state that this command answers.

        Args:
            stamp_ns: Stamp of that state; None where the command does not say it. Then it is the
                newest one that it can answer.
            published_ns: When the command was published; 0 where that is not known.
            now_ns: When it arrived.
        """
        found = 0
        while self._sent and (self._sent[0][1] <= published_ns - SHORTEST_ANSWER
                              if stamp_ns is None else self._sent[0][0] <= stamp_ns):
            stamp, sent_ns = self._sent.popleft()
            found = sent_ns if stamp_ns is None or stamp == stamp_ns else 0
        if found:
            self.histogram.add(now_ns - found)

    def figures(self, period_ns: int, span_ns: int) -> dict[str, object]:
        """Return the figures for the diagnostics.

        Args:
            period_ns: Period of the states.
            span_ns: Time that the histogram covers.
        """
        trip = ', '.join(f'{value:.3f}' for value in self.histogram.quantiles((0.5, 0.99, 0.999)))
        due = max(span_ns / period_ns, 1.0)
        in_time = min(self.histogram.within(period_ns) / due, 1.0)
        return {'round trip p50, p99, p99.9, largest so far [ms]':
                f'{trip}, {self.histogram.largest_ns * 1e-6:.3f}',
                'answered within their period so far [%]': f'{100.0 * in_time:.3f}'}
