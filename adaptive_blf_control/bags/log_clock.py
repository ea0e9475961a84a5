# SPDX-License-Identifier: Apache-2.0
"""Clocks of measured logs: single wild stamps, and clocks that were set back."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.bags.row_store import keep_rows, new_table, row_blocks

__all__ = ['LogClock', 'log_clock']

JUMP = 1.0  # s: a smaller step back is a message out of order
PAUSE = 60.0  # s: a longer one before the last or after the first few rows is no pause
FEW = 5  # rows in a row that may be wild; more of them are a clock that was set
ENOUGH = 1 << 16  # rows that tell the median period


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
    t = _seconds(clock, keep, per_second)
    if t.size == 0:
        return LogClock(keep, t, (), ())
    wild, starts = _wild_and_starts(t)
    notes = [f'{np.count_nonzero(wild)} stamps far from their neighbours are left out, the first '
             f'in row {_row(keep, int(wild.argmax()))}'] if wild.any() else []
    good = np.logical_not(wild, out=wild)
    edges = [0, *starts, t.size]
    behind: list[tuple[int, int]] = []
    for begin, end in pairwise(edges):
        late = _late(t[begin:end], good[begin:end])
        behind += _long_runs(late, begin)
        good[begin:end] &= ~late
    for start, latest in zip(starts, _latest(t, starts), strict=True):
        notes.append(f'the clock goes back by {latest - t[start]:.4g} s in row '
                     f'{_row(keep, start)}: the filters restart there')
    for (begin, end), latest in zip(behind, _latest(t, [begin for begin, _ in behind]),
                                    strict=True):
        notes.append(f'the clock goes back by {latest - t[begin]:.4g} s in row '
                     f'{_row(keep, begin)}: the {end - begin} rows up to the time before are left '
                     'out, and the filters restart')
    keep[keep.copy()] = good
    breaks = sorted({*starts, *(end for _, end in behind)})
    kept = _counts(good, [*breaks, *edges])
    t = keep_rows(t[:, None], good)[:, 0]
    _join(t, [kept[edge] for edge in edges])
    return LogClock(keep, t, tuple(sorted({kept[row] for row in breaks} - {0, t.size})),
                    tuple(notes))


def _seconds(clock: np.ndarray, keep: np.ndarray, per_second: float) -> np.ndarray:
    """Return the times of the rows that are kept, since the first of them, shape (K,) [s].

    Like all that this module makes of a whole log: not in memory where it is long.
    """
    t, end = new_table(int(np.count_nonzero(keep)), 1)[:, 0], 0
    first = clock[int(keep.argmax())] if t.size else 0
    for some in row_blocks(keep, t):
        # Subtracted first: seconds since 1970 as a double would be good to 0.2 µs only.
        block = (clock[some][keep[some]] - first) / per_second
        t[end:end + len(block)] = block
        end += len(block)
    return t


def _row(keep: np.ndarray, place: int) -> int:
    """Return the number of the row that is at a place among those kept, counted from 1."""
    for some in row_blocks(keep):
        count = int(np.count_nonzero(keep[some]))
        if place < count:
            return some.start + int(np.flatnonzero(keep[some])[place]) + 1
        place -= count
    raise IndexError(place)


def _counts(good: np.ndarray, rows: list[int]) -> dict[int, int]:
    """Return how many good rows are before each of some rows."""
    counts, last, count = {}, 0, 0
    for row in sorted(rows):
        count += int(np.count_nonzero(good[last:row]))
        counts[row], last = count, row
    return counts


def _latest(t: np.ndarray, rows: list[int]) -> Iterator[float]:
    """Yield the latest time before each of some rows, which rise [s]."""
    last, latest = 0, -np.inf
    for row in rows:
        for some in row_blocks(t[last:row]):
            latest = max(latest, float(t[last:row][some].max()))
        last = row
        yield latest


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
    far, back = _jumps(t)
    if far.size and far[0] < FEW < t.size - FEW:
        wild[:far[0] + 1] = True
    if far.size and t.size - 1 - far[-1] <= FEW < far[-1]:
        wild[far[-1] + 1:] = True
    for last in back:
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


def _jumps(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows after which the time is far ahead, and those after which it is back."""
    far, back = [], []
    for some in row_blocks(t):
        steps = np.diff(t[some.start:some.stop + 1])
        far.append(some.start + np.flatnonzero(steps > PAUSE))
        back.append(some.start + np.flatnonzero(steps < -JUMP))
    return np.concatenate(far), np.concatenate(back)


def _late(t: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return which good times do not come after all good ones before them, shape (N,)."""
    late, latest = np.zeros(t.size, dtype=bool), -np.inf
    for some in row_blocks(t):
        before = np.maximum.accumulate(np.append(latest, np.where(good[some], t[some], -np.inf)))
        late[some] = good[some] & (t[some] <= before[:-1])
        latest = before[-1]
    return late


def _long_runs(left_out: np.ndarray, first: int) -> list[tuple[int, int]]:
    """Return begin and end of more than `FEW` rows in a row, counted from ``first`` on."""
    if not left_out.any():
        return []
    padded = np.concatenate([[False], left_out, [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2)
    return [(int(first + begin), int(first + end)) for begin, end in edges if end - begin > FEW]


def _join(t: np.ndarray, edges: list[int]) -> None:
    """Move sections of times behind each other at the distance of a median period, from 0 on."""
    sections = [t[begin:end] for begin, end in pairwise(edges) if begin < end]
    begin, period = 0.0, _period(sections)
    for section in sections:
        first = float(section[0])
        for some in row_blocks(section):
            section[some] = section[some] - first + begin
        begin = float(section[-1]) + period


def _period(sections: list[np.ndarray]) -> float:
    """Return the median period of at least the first `ENOUGH` rows [s]."""
    steps, count = [], 0
    for section in sections:
        steps.append(np.diff(section[:ENOUGH]))
        count += len(steps[-1])
        if count >= ENOUGH:
            break
    return float(np.median(np.concatenate(steps))) if count else 1.0
