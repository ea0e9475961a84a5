# SPDX-License-Identifier: Apache-2.0
"""One pass of an identifier over a measured log: learn in one span, predict in a later one."""

from __future__ import annotations

from collections.abc import Sequence
import time
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arrays import checked_number
from adaptive_blf_control.bags.logs import MeasuredLog
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.residuals import Residuals
from adaptive_blf_control.identification.uncertainty import estimate_uncertainty, Uncertainty
from adaptive_blf_control.runs.batch_fit import BatchFit

__all__ = ['NO_TEST', 'Given', 'LogPass', 'Prediction', 'Span', 'choose_spans', 'learn']

NO_TEST = 'none'
Given = str | Sequence[float | None] | None
"""A span as a caller gives it, see `choose_spans`."""


class Span(NamedTuple):
    """Samples with start ≤ t < end, and t = end where the log ends there [s]."""

    start: float
    end: float


class Prediction(NamedTuple):
    """The filtered torque of samples that θ̂ was not learned from, K of them.

    Attributes:
        t: Times, shape (K,) [s].
        measured: τ_f, shape (K, n) [N·m].
        predicted: Y_f θ̂, shape (K, n) [N·m].
        half_width: Of the 95 % interval around it, shape (K, n) [N·m].
    """

    t: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    half_width: np.ndarray


class LogPass(NamedTuple):
    """What one pass over a log gave.

    Attributes:
        train: The filtered pairs θ̂ was learned from.
        test: The filtered pairs it never saw.
        seconds: Time each update took, shape (number of samples in the training span,) [s].
        prediction: The torque of the test span.
        uncertainty: How sure θ̂ is after the training span; None where no pair was recorded.
    """

    train: BatchFit
    test: BatchFit
    seconds: np.ndarray
    prediction: Prediction
    uncertainty: Uncertainty | None


def choose_spans(t: np.ndarray, train: Given, test: Given, settle: float) -> tuple[Span, Span]:
    """Return the training span and the test span of a log.

    Args:
        t: Times of the log, increasing, shape (N,) [s].
        train: ``(T0, T1)`` or ``'T0:T1'`` [s], where an end that is None or left out is the
            log's; None takes the first half from ``settle`` after the start on.
        test: Likewise; None takes what follows the training span, ``'none'`` leaves it empty.
        settle: How long a filter takes to forget its start [s].

    Raises:
        ParameterError: a span is malformed, reaches out of the log or holds no sample, or the
            test does not come after the training.
    """
    first, last = float(t[0]), float(t[-1])
    known = f'the log goes from {first:.6g} to {last:.6g} s'
    untested = isinstance(test, str) and test == NO_TEST
    middle = first + 0.5 * (last - first)
    learned = (Span(min(first + settle, middle), middle) if train is None
               else _span('train', train, first, last))
    tested = (Span(learned.end, learned.end if untested else last)
              if test is None or untested else _span('test', test, first, last))
    given = [('train', train, learned), ('test', test, tested)]
    for name, value, span in given[:1] if untested else given:
        if not first <= span.start < span.end <= last:
            raise ParameterError(name, value, f'T0:T1 with T0 < T1 inside the log: {known}; '
                                 f'this is {span.start:.6g} to {span.end:.6g} s')
        if not _inside(span, t, last).any():
            raise ParameterError(name, value, f'a span with samples in it: {known}')
    if tested.start < learned.end:
        raise ParameterError('test', f'{tested.start:g}:{tested.end:g}',
                             f'a span after the training, which ends at {learned.end:.6g} s: '
                             f'{known}')
    return learned, tested


def _span(name: str, given: str | Sequence[float | None], first: float, last: float) -> Span:
    ends = given.split(':') if isinstance(given, str) else given
    try:
        start, end = (_end(name, value) for value in ends)
        span = Span(first if start is None else start, last if end is None else end)
    except (TypeError, ValueError):
        raise ParameterError(name, given, f'T0:T1 in seconds: the log goes from {first:.6g} to '
                             f'{last:.6g} s') from None
    # Ends as they are printed count as the log's own.
    return Span(*(limit if abs(value - limit) <= 1e-5 * max(abs(limit), 1.0) else value
                  for value, limit in zip(span, (first, last))))


def _end(name: str, value: str | float | None) -> float | None:
    if isinstance(value, str):
        return float(value) if value.strip() else None
    return None if value is None else checked_number(name, value)


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
    fits, residuals = (BatchFit(n, m), BatchFit(n, m)), Residuals(n)
    identifier.warm_up()
    seconds, tested = [], []
    judged: Uncertainty | None = None
    for i in np.flatnonzero(log.t <= test.end):
        sample = float(log.t[i]), log.q[i], log.qd[i], log.tau[i]
        before, restarts = identifier.pair, identifier.restarts
        if learning[i]:
            begin = time.perf_counter()  # how long the work takes, not a time of the logic
            identifier.update(*sample)
            seconds.append(time.perf_counter() - begin)
            residuals.observe(sample[0], identifier)
        else:
            identifier.observe(*sample)
        advanced = identifier.pair is not before and identifier.restarts == restarts
        if advanced and identifier.settled and (learning[i] or testing[i]):
            fits[0 if learning[i] else 1].add(*identifier.pair)
            if testing[i]:
                judged = judged or estimate_uncertainty(identifier.stack, residuals)
                tested.append((log.t[i], *_predicted(identifier, judged)))
    prediction = (Prediction(*(np.array(column) for column in zip(*tested))) if tested else
                  Prediction(np.empty(0), *np.empty((3, 0, n))))
    return LogPass(*fits, np.array(seconds), prediction,
                   judged or estimate_uncertainty(identifier.stack, residuals))


def _predicted(identifier: Identifier,
               judged: Uncertainty | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return filtered torque, the predicted one and its half width, each (n,) [N·m]."""
    regressor, torque = identifier.pair
    half = np.full(torque.shape, np.inf) if judged is None else judged.half_width(regressor)
    return torque, regressor @ identifier.theta, half
