# SPDX-License-Identifier: Apache-2.0
"""How well a node keeps its rate: periods, missed ones, time in callbacks, age of the data."""

from __future__ import annotations

from array import array

import numpy as np

__all__ = ['Histogram', 'LoopStatistics', 'START_UP']

# Fine bins up to 2 ms and coarse ones up to 50 ms: so few that reading them takes microseconds. A
# longer duration counts in the last bin and as the largest value.
FINE_NS, FINE = 2_000, 1_000
COARSE_NS, COARSE = 50_000, 960
LIMIT_NS = FINE_NS * FINE
BINS = FINE + COARSE
EDGES = np.concatenate([np.arange(1, FINE + 1) * FINE_NS,  # upper ones [ms]
                        LIMIT_NS + np.arange(1, COARSE + 1) * COARSE_NS]) * 1e-6
# s that statistics leave out after a node's first sample and after `restart`: discovery and first
# requests are over then.
START_UP = 2.0
NEVER = 2**63  # ns
LONGEST_INTERVAL = 60 * 10**9  # ns between two samples of one motion


class Histogram:
    """Durations counted in bins: adding one takes no memory and little time.

    Attributes:
        largest_ns: The largest duration since the start or the last :meth:`forget` [ns].
    """

    def __init__(self) -> None:
        """Start empty."""
        self._bins = array('q', bytes(8 * BINS))
        self._before = np.zeros(BINS, dtype=np.int64)
        self._forgotten = np.zeros(BINS, dtype=np.int64)
        self.largest_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count one duration [ns]."""
        if duration_ns < LIMIT_NS:
            number = max(duration_ns, 0) // FINE_NS
        else:
            number = min(FINE + (duration_ns - LIMIT_NS) // COARSE_NS, BINS - 1)
        self._bins[number] += 1
        if duration_ns > self.largest_ns:
            self.largest_ns = duration_ns

    def forget(self) -> None:
        """Leave everything counted so far out of the quantiles and the largest value."""
        self._forgotten = np.frombuffer(self._bins, dtype=np.int64).copy()
        self.largest_ns = 0

    def within(self, limit_ns: int) -> int:
        """Return how many durations lie in the bins up to ``limit_ns``."""
        counts = np.frombuffer(self._bins, dtype=np.int64) - self._forgotten
        bins = int(np.searchsorted(EDGES, limit_ns * 1e-6, side='right'))
        if self.largest_ns > limit_ns:
            bins = min(bins, BINS - 1)  # the last one has no upper edge
        return int(counts[:bins].sum())

    def quantiles(self, parts: tuple[float, ...], recent: bool = False) -> tuple[float, ...]:
        """Return quantiles [ms], as the upper edges of their bins; NaN where nothing was counted.

        Args:
            parts: Each in 0..1.
            recent: Only what was counted since the last call with ``recent``.
        """
        counts = np.frombuffer(self._bins, dtype=np.int64).copy()
        if recent:
            counts, self._before = counts - self._before, counts
        else:
            counts = counts - self._forgotten
        total = np.cumsum(counts)
        if total[-1] == 0:
            return tuple(float('nan') for _ in parts)
        ranks = np.maximum(np.array(parts) * total[-1], 1)
        return tuple(EDGES[np.searchsorted(total, ranks)].tolist())


class LoopStatistics:
    """Statistics of one node's loop; the caller passes the times, all of one clock.

    Attributes:
        samples: Samples processed.
        missed: Samples that were due by their stamps and not processed.
        superseded: Messages not handled, because a newer one of the topic was there already.
        callback: Time spent in the handlers of a sample.
        age: Time from a message's publication to its being handled.
        histograms: Those that forget what was before :data:`START_UP`, so that the start of the
            graph does not hide what the loop holds.
    """

    def __init__(self) -> None:
        """Start without samples."""
        self.samples = 0
        self.missed = 0
        self.superseded = 0
        self.callback = Histogram()
        self.age = Histogram()
        self.histograms = [self.callback, self.age]
        self._start_up_ends_ns = 0
        self._since_ns = 0
        self._stamp_ns = 0
        self._interval_ns = 0.0
        self._at_ns = 0
        self._sums = [0, 0.0, 0.0]  # periods in the window, their sum and sum of squares [ms]

    def sample(self, now_ns: int, stamp_ns: int = 0) -> None:
        """Count one sample, processed at ``now_ns`` and measured at ``stamp_ns`` (0: unknown)."""
        self.samples += 1
        if self._at_ns:
            period = (now_ns - self._at_ns) * 1e-6
            sums = self._sums
            sums[0] += 1
            sums[1] += period
            sums[2] += period * period
        self._at_ns = now_ns
        if now_ns >= self._start_up_ends_ns:
            self._forget_start_up(now_ns)
        if stamp_ns:
            if self._stamp_ns:
                self._count_missed(stamp_ns - self._stamp_ns)
            self._stamp_ns = stamp_ns

    def _forget_start_up(self, now_ns: int) -> None:
        self._start_up_ends_ns = NEVER if self._start_up_ends_ns else now_ns + int(START_UP * 1e9)
        self._since_ns = now_ns
        for histogram in self.histograms:
            histogram.forget()

    def restart(self) -> None:
        """Leave out another START_UP from the next sample on: a new motion, or another rate."""
        self._start_up_ends_ns = 0

    @property
    def span_ns(self) -> int:
        """Time from the first to the last sample that the histograms have counted [ns]."""
        return self._at_ns - self._since_ns

    def _count_missed(self, interval_ns: int) -> None:
        if interval_ns <= 0:
            return
        if interval_ns > LONGEST_INTERVAL:  # another clock, or another motion: nothing was missed
            return
        if self._interval_ns > 0.0 and interval_ns > 1.5 * self._interval_ns:
            self.missed += round(interval_ns / self._interval_ns) - 1
        # A running median: one long gap moves it by one step only.
        self._interval_ns = self._interval_ns or float(interval_ns)
        self._interval_ns *= 1.01 if interval_ns > self._interval_ns else 0.99

    def break_off(self) -> None:
        """Forget the last stamp: the next one begins a new motion, so nothing was missed."""
        self._stamp_ns = 0

    def take(self) -> dict[str, str]:
        """Return the figures since the last call, for the diagnostics."""
        count, total, squares = self._sums
        self._sums = [0, 0.0, 0.0]
        figures = {'missed periods': str(self.missed)}
        if count:
            mean = total / count
            jitter = max(squares / count - mean * mean, 0.0) ** 0.5
            figures['period mean [ms]'] = f'{mean:.4f}'
            figures['period jitter, standard deviation [ms]'] = f'{jitter:.4f}'
        for name, histogram in (('callback', self.callback), ('message age', self.age)):
            middle, tail = histogram.quantiles((0.5, 0.99), recent=True)
            if middle == middle:  # not NaN: something was counted
                figures[f'{name} p50, p99, largest so far [ms]'] = (
                    f'{middle:.3f}, {tail:.3f}, {histogram.largest_ns * 1e-6:.3f}')
        parts = self.callback.quantiles((0.5, 0.99, 0.999))
        if parts[0] == parts[0]:
            figures['callback so far p50, p99, p99.9, largest [ms]'] = ', '.join(
                f'{value:.3f}' for value in (*parts, self.callback.largest_ns * 1e-6))
        return figures
