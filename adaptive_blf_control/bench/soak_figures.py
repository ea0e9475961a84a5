# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of a soak run: growth of memory, drift of latency, account of messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import re
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.errors import BagError

__all__ = ['Account', 'Growth', 'Latency', 'Part', 'account_of', 'growth_of', 'latency_of']

_REPORT = re.compile(r'(/\S+): received (\d+), written (\d+)(?:, dropped (\d+))?'
                     r'(?:, lost (\d+))?')


class Growth(NamedTuple):
    """Resident memory of one process [MB], after the start-up and at the end."""

    first: float
    last: float

    @property
    def percent(self) -> float:
        """How much it grew, in percent of `first`."""
        return 100.0 * (self.last - self.first) / self.first


def growth_of(t: Sequence[float], memory: Sequence[float], start_up: float) -> Growth:
    """Compare medians: the tenth of the samples that follows ``start_up`` with the last tenth.

    Args:
        t: Times of the samples, in seconds or in whatever ``start_up`` is given.
        memory: Resident memory [MB].
        start_up: Time before which samples are left out.

    Raises:
        BagError: fewer than two samples after ``start_up``.
    """
    kept = np.asarray(memory, dtype=float)[np.asarray(t) >= start_up]
    if kept.size < 2:
        raise BagError(f'{kept.size} samples of the memory after {start_up:g}: '
                       'expected 2 or more')
    share = max(kept.size // 10, 1)
    return Growth(float(np.median(kept[:share])), float(np.median(kept[-share:])))


class Part(NamedTuple):
    """Latencies of one part of the run [ms]."""

    p50: float
    p99: float
    largest: float
    answers: int


class Latency(NamedTuple):
    """Latency of the first and the last third after the start-up."""

    first: Part
    last: Part

    @property
    def drifts(self) -> bool:
        """Whether the median rose by more than a tenth and more than 0.02 ms."""
        return self.last.p50 > max(1.1 * self.first.p50, self.first.p50 + 0.02)


def latency_of(sent: np.ndarray, latency: np.ndarray, start_up: float) -> Latency:
    """Return the latency of the first and the last third of what follows ``start_up``.

    Args:
        sent: When the states were sent, shape (N,) [s].
        latency: From a state to its answer, shape (N,) [s].
        start_up: Time after the first state that is left out [s].

    Raises:
        BagError: fewer than three answers after ``start_up``.
    """
    if sent.size == 0:
        raise BagError('no state was answered')
    kept = 1e3 * latency[sent - sent[0] >= start_up]
    if kept.size < 3:
        raise BagError(f'{kept.size} answers after {start_up:g} s: expected 3 or more')
    third = kept.size // 3
    return Latency(*(Part(float(np.median(part)), float(np.percentile(part, 99)),
                          float(part.max()), part.size)
                     for part in (kept[:third], kept[-third:])))


class Account(NamedTuple):
    """What became of the messages of one topic."""

    topic: str
    received: int
    written: int
    in_bag: int
    dropped: int
    lost: int

    @property
    def complete(self) -> bool:
        """Whether every message that was received is in the bag or counted as dropped."""
        return self.received == self.written + self.dropped and self.written == self.in_bag


def account_of(log: str, in_bag: Mapping[str, int]) -> list[Account]:
    """Compare what the recorder reports with what is in the bag.

    Args:
        log: Output of the recorder with its closing lines.
        in_bag: Messages in the bag by topic.

    Raises:
        BagError: the recorder did not report a topic that is in the bag.
    """
    rows = {match[1]: Account(match[1], int(match[2]), int(match[3]), in_bag.get(match[1], 0),
                              int(match[4] or 0), int(match[5] or 0))
            for match in _REPORT.finditer(log)}
    missing = sorted(set(in_bag) - set(rows))
    if missing:
        raise BagError(f'the recorder did not report {", ".join(missing)}: did it end by itself?')
    return list(rows.values())
