# SPDX-License-Identifier: Apache-2.0
"""Clocks of measured logs: single wild stamps, and clocks that were set back."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.bags.row_store import new_table, row_blocks

__all__ = ['LogClock', 'log_clock']

JUMP = 1.0  # s: a smaller step back is a message out of order
PAUSE = 60.0  # s: a longer one before the last or after the first few rows is no pause
FEW = 5  # rows in a row that may be wild; more of them are a clock that was set


class LogClock(NamedTuple):
    """What the clock of a log says.

    Attributes:
        keep: Which rows can be used, shape (N,).
        t: Their times, strictly increasing from 0, shape (K,) [s].
        breaks: Rows among those kept at which a clock that was set back goes on.
        notes: What is wrong with the clock, in sentences.
    """

    keep: np.ndarray
    t: np.ndarray
    breaks: tuple[int, ...]
    notes: tuple[str, ...]


def log_clock(clock: np.ndarray, usable: np.ndarray, per_second: float) -> LogClock:
    """Return which rows have a time that can be used, and that time.

    A few stamps far ahead of or behind both neighbours are left out. Where a clock is set back
    the log goes on one median period later, and filters have to restart. Any other row that
    does not come after the rows before it is left out; after more than a few of them filters
    have to restart, too, since the arm has moved on meanwhile.

    Args:
        clock: Times of the rows, shape (N,), integers or floats.
        usable: Rows whose other values can be used, shape (N,); not changed.
        per_second: How much the clock advances in a second.
    """
    keep = usable & np.isfinite(clock)
    if keep.all() and clock.size and (sound := _sound_times(clock, per_second)) is not None:
        return LogClock(keep, sound, (), ())
    rows = np.flatnonzero(keep)
    if rows.size == 0:
        return LogClock(keep, np.empty(0), (), ())
    # Subtracted first: seconds since 1970 as a double would be good to 0.2 µs only.
    t = ((clock[rows] - clock[rows[0]]) / per_second).astype(np.float64)
    wild, starts = _wild_and_starts(t)
    good = ~wild
    notes = [f'{wild.sum()} stamps far from their neighbours are left out, the first in row '
             f'{rows[wild.argmax()] + 1}'] if wild.any() else []
    edges = [0, *starts, t.size]
    behind: list[tuple[int, int]] = []
    for begin, end in zip(edges, edges[1:]):
        rising = _rising(t[begin:end], good[begin:end])
        behind += _long_runs(good[begin:end] & ~rising, begin)
        good[begin:end] &= rising
    keep[rows[~good]] = False
    for start in starts:
        notes.append(f'the clock goes back by {t[:start].max() - t[start]:.4g} s in row '
                     f'{rows[start] + 1}: the filters restart there')
    for begin, end in behind:
        notes.append(f'the clock goes back by {t[:begin].max() - t[begin]:.4g} s in row '
                     f'{rows[begin] + 1}: the {end - begin} rows up to the time before are left '
                     'out, and the filters restart')
    kept = np.concatenate([[0], np.cumsum(good)])
    breaks = sorted({int(kept[row]) for row in (*starts, *(end for _, end in behind))})
    t = _joined([t[begin:end][good[begin:end]] for begin, end in zip(edges, edges[1:])])
    return LogClock(keep, t, tuple(row for row in breaks if 0 < row < t.size), tuple(notes))


def _sound_times(clock: np.ndarray, per_second: float) -> np.ndarray | None:
    """Return the times of a clock of which nothing has to be said, shape (N,), else None.

    Nearly all are, and those of a long log may not fit the memory: block by block.
    """
    t = new_table(len(clock), 1)[:, 0]
    for some in row_blocks(t):
        t[some] = (clock[some] - clock[0]) / per_second  # subtracted first, see above
        steps = np.diff(t[max(some.start - 1, 0):some.stop])
        if not ((steps > 0.0) & (steps <= PAUSE)).all():
            return None
    return t


def _wild_and_starts(t: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """Return which times are wild, shape (N,), and where a clock that was set back goes on."""
    wild = np.zeros(t.size, dtype=bool)
    starts: list[int] = []
    steps = np.diff(t)
    far = np.flatnonzero(steps > PAUSE)
    if far.size and far[0] < FEW < t.size - FEW:
        wild[:far[0] + 1] = True
    if far.size and t.size - 1 - far[-1] <= FEW < far[-1]:
        wild[far[-1] + 1:] = True
    for last in np.flatnonzero(steps < -JUMP):
        before, after = t[max(last - FEW, 0):last + 1], t[last + 1:last + 2 + FEW]
        lower = np.flatnonzero(before < after[0])
        higher = np.flatnonzero(after > t[last])
        begun = starts[-1] if starts else 0
        if lower.size or last - begun < FEW:  # those ahead, up to here, are wild
            wild[last - (before.size - 2 - lower[-1] if lower.size else last - begun):
                 last + 1] = True
        elif higher.size or t.size - 1 - last <= FEW:  # those behind, from here on, are
            wild[last + 1:last + 1 + (higher[0] if higher.size else FEW)] = True
        elif not wild[last]:
            starts.append(int(last) + 1)
    return wild, starts


def _rising(t: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return which times come after all good ones before them, shape (N,)."""
    if good.all() and (t[1:] > t[:-1]).all():
        return good  # as nearly always; a long log has no memory to waste
    latest = np.maximum.accumulate(np.where(good, t, -np.inf))
    return good & np.concatenate(([True], t[1:] > latest[:-1]))


def _long_runs(left_out: np.ndarray, first: int) -> list[tuple[int, int]]:
    """Return begin and end of more than `FEW` rows in a row, counted from ``first`` on."""
    if not left_out.any():
        return []
    edges = np.flatnonzero(np.diff(np.concatenate([[0], left_out, [0]]))).reshape(-1, 2)
    return [(int(first + begin), int(first + end)) for begin, end in edges if end - begin > FEW]


def _joined(sections: list[np.ndarray]) -> np.ndarray:
    """Put sections behind each other at the distance of a median period, from 0 on."""
    if len(sections) == 1:
        return sections[0] - sections[0][:1]
    periods = np.concatenate([np.diff(section) for section in sections])
    period = float(np.median(periods)) if periods.size else 1.0
    joined: list[np.ndarray] = []
    for section in sections:
        if section.size:
            begin = joined[-1][-1] + period if joined else 0.0
            joined.append(section - section[0] + begin)
    return np.concatenate(joined) if joined else np.empty(0)
