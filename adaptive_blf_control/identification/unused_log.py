# SPDX-License-Identifier: Apache-2.0
"""Why nothing, or nothing right, can be learned from samples: their times, order or values."""

from __future__ import annotations

import math
from typing import Any
import warnings

import numpy as np

from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.time_units import (
    order_problem,
    period_unit,
    question,
    unit_of_period,
)

__all__ = ['Intervals', 'check_order', 'no_sample_used']

_SEVERAL = 5  # intervals in a row that are too long: one alone is a pause


def check_order(t: Any) -> None:
    """Raise ParameterError where a log has no two samples, or they are not in order of time.

    Args:
        t: Times, shape (N,) [s].
    """
    times = checked_array('t', t, (-1,))
    if times.size < 2:
        raise ParameterError('t', t, f'a log of at least two samples, not {times.size}; '
                             'update(t, q, qd, tau) takes one sample')
    if problem := order_problem(times):
        raise ParameterError('t', t, f'times in s that rise: {problem}')


def no_sample_used(t: Any, gap: float, **samples: Any) -> ParameterError:
    """Return the error for a log of which no sample could be used.

    Args:
        t: Times, shape (N,) [s].
        gap: Longest interval that the filters pass over [s].
        samples: q, qd and tau by name, shape (N, n) each.
    """
    arrays = {name: np.asarray(value, dtype=float).reshape(len(t), -1)
              for name, value in samples.items()}
    for name, array in arrays.items():
        if not np.isfinite(array).all(axis=1).any():
            return ParameterError(name, samples[name], f'finite numbers: in none of its '
                                  f'{len(array)} rows are all of them')
    times = np.asarray(t, dtype=float)
    unit, reason = period_unit(times, arrays['q'], arrays['qd'])
    if not reason:
        unit = unit_of_period(float(np.median(np.diff(times))))
    asked = '' if unit == 's' else f'; {question(unit, reason)}'
    return ParameterError('t', f'{times.size} times from {times[0]:g} to {times[-1]:g}',
                          f'times in s that rise by less than filter.gap = {gap:g} s: no sample '
                          f'could be used{asked}')


class Intervals:
    """Watches the intervals of samples that come one by one.

    Attributes:
        note: What is odd about them, in a sentence; '' where nothing is.
    """

    def __init__(self) -> None:
        """Begin without a sample."""
        self.note = ''
        self._last, self._long = math.nan, 0

    def take(self, t: float, gap: float) -> None:
        """Take the time of a sample; warn once where several in a row are too far apart.

        Args:
            t: Time [s].
            gap: Longest interval that the filters pass over [s].
        """
        interval, self._last = t - self._last, t
        if not interval > gap:  # NaN at the first sample
            self._long = 0
            return
        self._long += 1
        if self._long < _SEVERAL or self.note:
            return
        unit = unit_of_period(interval)
        self.note = (f'samples come {interval:.4g} s apart, more than filter.gap = {gap:g} s, '
                     'after which the filters restart: nothing is learned'
                     + (f'; {question(unit)}' if unit != 's' else
                        f"; retune(filter={{'gap': {3.0 * interval:.2g}}}) passes over it"))
        warnings.warn(self.note, stacklevel=5)  # where `update` of an identifier is called
