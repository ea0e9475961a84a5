# SPDX-License-Identifier: Apache-2.0
"""One pass of an identifier over measured logs: learn in one span, predict in a later one."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
import functools
import itertools
import time
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arrays import checked_number, record
from adaptive_blf_control.bags.measured_log import MeasuredLog
from adaptive_blf_control.bags.row_store import row_blocks, RowStore
from adaptive_blf_control.errors import LogError, ParameterError, with_hints
from adaptive_blf_control.identification.identifier import Identifier, LearnedBlock
from adaptive_blf_control.identification.pair_times import PairTimes
from adaptive_blf_control.identification.uncertainty import estimate_uncertainty, Uncertainty
from adaptive_blf_control.runs.batch_fit import BatchFit
from adaptive_blf_control.spelling import option, setting, spelled

__all__ = ['NO_TEST', 'Given', 'Growth', 'LogPass', 'Prediction', 'Progress', 'Section', 'Span',
           'check_rest', 'choose_spans', 'learn']

NO_TEST = 'none'
Given = str | Sequence[float | None] | None
"""A span as a caller gives it, see `choose_spans`."""
Progress = Callable[[int, int], None]
"""Called with the number of samples that are done and that of all."""
LOOKS = 100
"""Times at which the growth of the history is looked at, in each log."""
TIMED = 16
"""Samples that are taken, and timed, together."""


class Span(NamedTuple):
    """Samples with start ≤ t < end, and t = end where the log ends there [s]."""

    start: float
    end: float


@record
@functools.partial(with_hints, instead=dict.fromkeys(
    ('residual', 'residuals', 'error', 'errors'), 'measured - predicted'))
class Prediction(NamedTuple):
    """The filtered torque of samples that θ̂ was not learned from, K of them.

    Attributes:
        t: Times, shape (K,) [s].
        measured: τ_f, shape (K, n) [N·m].
        predicted: Y_f θ̂, shape (K, n) [N·m].
        half_width: Of the 95 % interval around it, shape (K, n) [N·m].
        q: Measured positions, shape (K, n) [rad].
        qd: Measured velocities, shape (K, n) [rad/s].
    """

    t: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    half_width: np.ndarray
    q: np.ndarray
    qd: np.ndarray


class Growth(NamedTuple):
    """The history while it was learned from, at K times.

    Attributes:
        t: Times, shape (K,) [s].
        rank: Shape (K,).
        singular: Largest, median and smallest singular value of the recorded regressors with
            columns of length one, shape (K, 3).
    """

    t: np.ndarray
    rank: np.ndarray
    singular: np.ndarray


class LogPass(NamedTuple):
    """What one pass over a log gave.

    Attributes:
        train: The filtered pairs θ̂ was learned from.
        test: The filtered pairs it never saw.
        seconds: Time an update took, a mean over each `TIMED` samples of the training span [s].
        prediction: The torque of the test span.
        uncertainty: How sure θ̂ is after the training span; None where no pair was recorded.
        growth: How the history grew.
    """

    train: BatchFit
    test: BatchFit
    seconds: np.ndarray
    prediction: Prediction
    uncertainty: Uncertainty | None
    growth: Growth


class Section(NamedTuple):
    """A log, what of it is learned from, and what of it is predicted; either may be empty.

    Attributes:
        log: The log.
        train: Span to learn from.
        test: Span to predict with θ̂ frozen.
        notes: How spans that were given differ from these, in sentences.
    """

    log: MeasuredLog
    train: Span
    test: Span
    notes: tuple[str, ...] = ()


def choose_spans(log: MeasuredLog, train: Given, test: Given, settle: float) -> Section:
    """Return the training span and the test span of a log.

    Args:
        log: The log.
        train: ``(T0, T1)`` or ``'T0:T1'`` [s], where an end that is None or left out is the
            log's; None takes the first half from ``settle`` after the start on. An end beyond
            the log is that of the log, with a note.
        test: Likewise; None takes what follows the training span, ``'none'`` leaves it empty.
        settle: How long a filter takes to forget its start [s].

    Raises:
        LogError: the log is too short for a half after ``settle``.
        ParameterError: a span is malformed, reaches out of the log or holds no sample, or the
            test does not come after the training.
    """
    t = log.t
    first, last = float(t[0]), float(t[-1])
    known = f'the log goes from {first:.6g} to {last:.6g} s'
    untested = isinstance(test, str) and test == NO_TEST
    middle = first + 0.5 * (last - first)
    if train is None and middle <= first + settle:
        raise LogError(f'the log of {last - first:.3g} s is too short: the filters take '
                       f'{settle:.3g} s to forget their start, so expected more than '
                       f'{2.0 * settle:.3g} s, or ' + setting('filter.time_constant', '...')
                       + ' with less')
    notes: list[str] = []
    learned = (Span(first + settle, middle) if train is None
               else _span('train', train, first, last, notes))
    _check_span('train', train, learned, t, known)
    if test is None and learned.end >= last:
        raise ParameterError('test', None, f'{_without_rest()}; {known}')
    tested = (Span(learned.end, learned.end if untested else last)
              if test is None or untested else _span('test', test, first, last, notes))
    if not untested:
        _check_span('test', test, tested, t, known)
    if tested.start < learned.end:
        raise ParameterError('test', f'{tested.start:g}:{tested.end:g}',
                             f'a span after the training, which ends at {learned.end:.6g} s: '
                             f'{known}')
    return Section(log, learned, tested, tuple(notes))


def check_rest(train: Given, test: Given) -> None:
    """Raise ParameterError where, whatever the log, nothing of it is left to be predicted."""
    open_end = (train.rstrip().endswith(':') if isinstance(train, str) else
                isinstance(train, (list, tuple)) and len(train) == 2 and train[1] is None)
    if open_end and test is None:
        raise ParameterError('test', None, _without_rest())


def _without_rest() -> str:
    return ('T0:T1 after the training, and nothing of the log is left for it: '
            + option('test', "'none'", 'none') + ' learns without a test')


def _check_span(name: str, given: Given, span: Span, t: np.ndarray, known: str) -> None:
    if not t[0] <= span.start < span.end <= t[-1]:
        raise ParameterError(name, given, f'T0:T1 with T0 < T1 inside the log: {known}; '
                             f'this is {span.start:.6g} to {span.end:.6g} s')
    if not _inside(span, t, float(t[-1])).any():
        raise ParameterError(name, given, f'a span with samples in it: {known}')


def _span(name: str, given: str | Sequence[float | None], first: float, last: float,
          notes: list[str]) -> Span:
    ends = given.split(':') if isinstance(given, str) else given
    try:
        start, end = (_end(name, value) for value in ends)
        span = Span(first if start is None else start, last if end is None else end)
    except (TypeError, ValueError):
        raise ParameterError(
            name, given, f'{spelled("(T0, T1)", "T0:T1")} in s: the log goes from {first:.6g} to '
            f'{last:.6g} s') from None
    # Ends as they are printed count as the log's own.
    span = Span(*(limit if abs(value - limit) <= 1e-5 * max(abs(limit), 1.0) else value
                  for value, limit in zip(span, (first, last))))
    if span.start < last < span.end:
        notes.append(f'the {name} span up to {span.end:.6g} s is cut where the log ends, at '
                     f'{last:.6g} s')
        span = Span(span.start, last)
    return span


def _end(name: str, value: str | float | None) -> float | None:
    if isinstance(value, str):
        return float(value) if value.strip() else None
    return None if value is None else checked_number(name, value)


def _inside(span: Span, t: np.ndarray, last: float) -> np.ndarray:
    """Return which times belong to a span, shape of ``t``."""
    result: np.ndarray = (t >= span.start) & ((t < span.end) | (span.end >= last))
    return result & (span.start < span.end)


def learn(identifier: Identifier, sections: Sequence[Section],
          progress: Progress | None = None) -> LogPass:
    """Stream logs through ``identifier``, each up to the end of its test span.

    θ̂ and the history stack change in the training spans only; elsewhere samples are filtered.
    Pairs count once the filter has settled. With several logs, all are learned from before any is
    predicted; time goes on from one to the next, with a pause that restarts the filters.
    """
    again = [section for section in sections[:-1] if section.test.start < section.test.end]
    passing = _Pass(identifier, progress, sum(map(_last_row, (*sections, *again))))
    identifier.warm_up(log=True)
    for section in sections[:-1]:
        passing.stream(section, learning=True, testing=False)
    passing.stream(sections[-1], learning=True, testing=True)
    for section in again:
        passing.stream(section, learning=False, testing=True)
    return passing.result()


def _last_row(section: Section) -> int:
    """Return about how many rows of a log are streamed."""
    end = max(section.train.end, section.test.end)
    return int(np.searchsorted(section.log.t, end, side='right'))


class _Pass:
    """What is gathered while logs are streamed."""

    def __init__(self, identifier: Identifier, progress: Progress | None, total: int) -> None:
        self._progress, self._done, self._total = progress, 0, total
        n, m = identifier.arm.n, identifier.arm.m
        self._identifier = identifier
        self._train, self._test = BatchFit(n, m), BatchFit(n, m)
        self._seen = PairTimes()
        self._seconds = array('d')
        self._tested = RowStore(1 + 5 * n)
        self._judged: Uncertainty | None = None
        self._begin = 0.0
        self._looked = -np.inf  # when the history was looked at last
        self._growth: list[tuple[float, ...]] = []
        self._look = 0.0

    def stream(self, section: Section, *, learning: bool, testing: bool) -> None:
        """Stream one log as far as it is needed."""
        log, last = section.log, float(section.log.t[-1])
        until = int(np.searchsorted(log.t, section.test.end if testing else section.train.end,
                                    side='right'))
        breaks = [i for i in log.breaks if i < until]
        self._look = (section.train.end - section.train.start) / LOOKS
        for begin, end in itertools.pairwise((0, *breaks, until)):
            if begin in breaks:
                self._identifier.restart()
            t, *values = (each[begin:end] for each in (log.t, log.q, log.qd, log.tau))
            for some in row_blocks(t, *values):  # the whole log may not fit the memory
                times = t[some]
                self._take((self._begin + times, *(each[some] for each in values)),
                           _inside(section.train, times, last) & learning,
                           _inside(section.test, times, last) & testing)
        self._begin = self._begin + float(log.t[until - 1]) if until else 0.0
        self._begin += 10.0 * max(self._identifier.settings.filter.gap, 1.0)

    def _take(self, samples: tuple[np.ndarray, ...],
              learned: np.ndarray, tested: np.ndarray) -> None:
        begin = time.perf_counter()  # how long the work takes, not a time of the logic
        t, q, qd, tau = samples
        for block in self._identifier.learn_in_blocks(t, q, qd, tau, learned, TIMED):
            some = block.samples
            if learned[some].any():
                self._seconds.append((time.perf_counter() - begin) / block.usable.size)
            self._gather(block, tuple(part[some] for part in samples[:3]), learned[some],
                         tested[some])
            self._done += block.usable.size
            if self._progress is not None:
                self._progress(min(self._done, self._total), self._total)
            begin = time.perf_counter()

    def _gather(self, block: LearnedBlock, states: tuple[np.ndarray, ...], learned: np.ndarray,
                tested: np.ndarray) -> None:
        identifier, rows = self._identifier, block.rows
        t, q, qd = states
        for k in np.flatnonzero(block.recorded):
            self._seen.note(float(t[k]), rows[k, :, -1], identifier.stack)
        if block.recorded.any() and t[-1] - self._looked >= self._look:
            self._note_growth(float(t[-1]))
        self._train.add(rows[block.usable & learned])
        self._test.add(rows[block.usable & tested & ~learned])
        tested = block.usable & tested
        if tested.any():
            self._judged = self._judged or estimate_uncertainty(identifier, self._seen)
            regressors, torques = rows[tested][:, :, :-1], rows[tested][:, :, -1]
            half = (np.full(torques.shape, np.inf) if self._judged is None else
                    self._judged.half_width(regressors))
            predicted = regressors @ identifier.theta
            for row in np.column_stack([t[tested], torques, predicted, half, q[tested],
                                        qd[tested]]):
                self._tested.append(row)

    def result(self) -> LogPass:
        """Return what was gathered."""
        n, rows = self._identifier.arm.n, self._tested.table()
        prediction = Prediction(rows[:, 0], *(rows[:, 1 + k * n:1 + (k + 1) * n]
                                              for k in range(5)))
        judged = self._judged or estimate_uncertainty(self._identifier, self._seen)
        grown = np.array(self._growth).reshape(-1, 5)
        return LogPass(self._train, self._test, np.array(self._seconds), prediction, judged,
                       Growth(grown[:, 0], grown[:, 1], grown[:, 2:]))

    def _note_growth(self, t: float) -> None:
        gram = self._identifier.stack.gram
        size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        values = np.sqrt(np.maximum(np.linalg.eigvalsh(gram / np.outer(size, size)), 0.0))
        self._growth.append((t, float(self._identifier.stack.rank), float(values[-1]),
                             float(np.median(values)), float(values[0])))
        self._looked = t
