# SPDX-License-Identifier: Apache-2.0
"""One pass of an identifier over a measured log: learn in one span, predict in a later one."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.bags.logs import MeasuredLog
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.runs.batch_fit import BatchFit

__all__ = ['NO_TEST', 'LogPass', 'Span', 'choose_spans', 'learn']

NO_TEST = 'none'


class Span(NamedTuple):
    """Samples with start ≤ t < end, and t = end where the log ends there [s]."""

    start: float
    end: float


class LogPass(NamedTuple):
    """What one pass over a log gave.

    Attributes:
        train: The filtered pairs θ̂ was learned from.
        test: The filtered pairs it never saw.
        seconds: Time each update took, shape (number of samples in the training span,) [s].
    """

    train: BatchFit
    test: BatchFit
    seconds: np.ndarray


def choose_spans(t: np.ndarray, train: str | None, test: str | None,
                 settle: float) -> tuple[Span, Span]:
    """Return the training span and the test span of a log.

    Args:
        t: Times of the log, increasing, shape (N,) [s].
        train: ``T0:T1`` [s], where an end that is left out is the log's; None takes the first
            half from ``settle`` after the start on.
        test: Likewise; None takes what follows the training span, ``none`` leaves it empty.
        settle: How long a filter takes to forget its start [s].

    Raises:
        ParameterError: a span is malformed, reaches out of the log or holds no sample, or the
            test does not come after the training.
    """
    first, last = float(t[0]), float(t[-1])
    known = f'the log goes from {first:.6g} to {last:.6g} s'
    middle = first + 0.5 * (last - first)
    learned = (Span(min(first + settle, middle), middle) if train is None
               else _parse('--train', train, first, last))
    tested = (Span(learned.end, learned.end if test == NO_TEST else last)
              if test in (None, NO_TEST) else _parse('--test', test or '', first, last))
    given = [('--train', train, learned), ('--test', test, tested)]
    for name, text, span in given[:1] if test == NO_TEST else given:
        if not first <= span.start < span.end <= last:
            raise ParameterError(name, text, f'T0:T1 with T0 < T1 inside the log: {known}; '
                                 f'this is {span.start:.6g} to {span.end:.6g} s')
        if not _inside(span, t, last).any():
            raise ParameterError(name, text, f'a span with samples in it: {known}')
    if tested.start < learned.end:
        raise ParameterError('--test', f'{tested.start:g}:{tested.end:g}',
                             f'a span after the training, which ends at {learned.end:.6g} s: '
                             f'{known}')
    return learned, tested


def _parse(option: str, text: str, first: float, last: float) -> Span:
    start, colon, end = text.partition(':')
    try:
        span = Span(float(start) if start.strip() else first, float(end) if end.strip() else last)
    except ValueError:
        colon = ''
    if not colon:
        raise ParameterError(option, text, f'T0:T1 in seconds: the log goes from {first:.6g} to '
                             f'{last:.6g} s')
    # Ends as they are printed count as the log's own.
    return Span(*(limit if abs(value - limit) <= 1e-5 * max(abs(limit), 1.0) else value
                  for value, limit in zip(span, (first, last))))


def _inside(span: Span, t: np.ndarray, last: float) -> np.ndarray:
    """Return which times belong to a span, shape of ``t``."""
    result: np.ndarray = (t >= span.start) & ((t < span.end) | (span.end >= last))
    return result


def learn(identifier: Identifier, log: MeasuredLog, train: Span, test: Span) -> LogPass:
    """Stream a log through ``identifier`` up to the end of the test span.

    θ̂ and the history stack change in the training span only; elsewhere samples are filtered.
    Pairs count once the filter has settled.
    """
    last = float(log.t[-1])
    learning, testing = (_inside(span, log.t, last) for span in (train, test))
    n, m = identifier.arm.n, identifier.arm.m
    fits = BatchFit(n, m), BatchFit(n, m)
    identifier.warm_up()
    seconds = []
    for i in np.flatnonzero(log.t <= test.end):
        sample = float(log.t[i]), log.q[i], log.qd[i], log.tau[i]
        before, restarts = identifier.pair, identifier.restarts
        if learning[i]:
            begin = time.perf_counter()  # how long the work takes, not a time of the logic
            identifier.update(*sample)
            seconds.append(time.perf_counter() - begin)
        else:
            identifier.observe(*sample)
        advanced = identifier.pair is not before and identifier.restarts == restarts
        if advanced and identifier.settled and (learning[i] or testing[i]):
            fits[0 if learning[i] else 1].add(*identifier.pair)
    return LogPass(*fits, np.array(seconds))
