# SPDX-License-Identifier: Apache-2.0
"""In which unit times are that a caller gives, and whether they are in order."""

from __future__ import annotations

import numpy as np

__all__ = ['SLOWEST', 'UNITS', 'epoch_unit', 'order_problem', 'period_unit', 'question',
           'unit_of_period']

UNITS = {'s': 1.0, 'ms': 1e3, 'us': 1e6, 'ns': 1e9}  # per second
SLOWEST = 0.5  # s: samples further apart are taken to be in another unit
_DISORDER = 0.1  # of the rows: a clock that is set back, or late messages, are far fewer


def epoch_unit(first: float) -> str | None:
    """Return the unit of a time since 1970 by its size; None where no unit fits."""
    for unit, per_second in UNITS.items():
        if 5e8 < first / per_second < 5e9:  # years 1985 to 2128
            return unit
    return None


def period_unit(t: np.ndarray, q: np.ndarray, qd: np.ndarray | None) -> tuple[str, str]:
    """Return the unit of times that count from some start, and why it is not the second, or ''.

    Velocities tell: Δq is the integral of q̇ over time. Without them a log is taken to have 2 Hz
    or more, and 10 kHz or less.

    Args:
        t: Times, shape (N,) [unit].
        q: Positions, shape (N, n) [rad].
        qd: Velocities, shape (N, n) [rad/s], or None.
    """
    period = float(np.median(np.diff(t))) if t.size > 10 else 0.0
    if period < SLOWEST:
        return 's', ''
    if qd is not None:
        moved = 0.5 * (qd[1:] + qd[:-1]) * np.diff(t)[:, None]
        stepped = np.diff(q, axis=0)
        with np.errstate(over='ignore', invalid='ignore'):
            slope = float((moved * stepped).sum() / max((moved * moved).sum(), 1e-300))
        for unit, per_second in UNITS.items():
            if 1.0 / 3.0 < slope * per_second < 3.0:
                return unit, '' if unit == 's' else f'the velocities say so, with {slope:.3g} s'
    unit = unit_of_period(period)
    return unit, '' if unit == 's' else f'the rows are {period:g} apart'


def unit_of_period(period: float) -> str:
    """Return the unit in which samples that are ``period`` apart have 2 Hz to 10 kHz, else s."""
    return next((unit for unit in ('ms', 'us', 'ns')
                 if 1e-4 <= period / UNITS[unit] < SLOWEST), 's') if period >= SLOWEST else 's'


def question(unit: str, reason: str = '') -> str:
    """Return the question whether times are in a unit, with what makes seconds of them."""
    said = f' ({reason})' if reason else ''
    return f'are its times in {unit}{said}? t / {UNITS[unit]:g} are seconds'


def order_problem(t: np.ndarray) -> str:
    """Return what is said of rows that are not in the order of their times; '' where they are.

    Args:
        t: Times, shape (N,); a few that go back are no disorder.
    """
    back = int(np.count_nonzero(t[1:] < t[:-1]))
    if back <= 1 or back <= _DISORDER * t.size:
        return ''
    return (f'the rows are not in the order of time: t goes back in {back} of {t.size} rows; '
            'order = numpy.argsort(t) sorts them: t[order], q[order], qd[order], tau[order]')
