# SPDX-License-Identifier: Apache-2.0
"""Checks of a measured log that need no model of the masses: motion, velocity, limits, rate."""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.finding import (
    even,
    Excerpt,
    Finding,
    gain_of,
    REFUSED,
    WARNING,
)
from adaptive_blf_control.identification.settings import FilterSettings
from adaptive_blf_control.spelling import argument, option, setting
from adaptive_blf_control.time_units import period_unit, question

__all__ = ['effort_findings', 'motion_findings', 'position_findings', 'rate_findings',
           'velocity_findings']

WINDOW = 0.05  # s, over which velocities are compared with positions
STILL = 1e-3  # rad (or m): a joint whose range is smaller never moves
LONGEST_DELAY = 0.2  # s
TURNS = 4.0 * math.pi  # rad; joints without limits seldom turn more often in a log
STRETCH = 20_000  # rows that delays are looked for in


class _Windows(NamedTuple):
    """Change of the position over windows, and what the velocity says it is, (K, n) [rad]."""

    stepped: np.ndarray
    integrated: np.ndarray


def moving(log: Excerpt) -> np.ndarray:
    """Return which joints move at all, shape (n,)."""
    result: np.ndarray = np.ptp(log.q, axis=0) >= STILL
    return result


def motion_findings(log: Excerpt, arm: Arm) -> Iterator[Finding]:
    """Joints that never move, and logs that mostly stand still."""
    there = moving(log)
    if not there.any():
        yield Finding('motion', None, REFUSED, float(np.ptp(log.q, axis=0).max()),
                      f'no joint moves by {STILL:g} rad in the whole log')
        return
    for joint in np.flatnonzero(~there):
        yield Finding('motion', arm.joints[joint], WARNING, float(np.ptp(log.q[:, joint])),
                      f'it never moves (by {np.ptp(log.q[:, joint]):.2g} rad), so nothing is '
                      'learned of it', argument('joints') + ' without it locks it')
    step = _windows(log).stepped
    if len(step):
        still = float((np.abs(step) < 1e-3 * np.ptp(log.q, axis=0).max()).all(axis=1).mean())
        if still > 0.5:
            yield Finding('motion', None, WARNING, still,
                          f'{still:.0%} of the log is without motion',
                          argument('train') + ' picks a span')


def velocity_findings(log: Excerpt, arm: Arm) -> Iterator[Finding]:
    """Velocities that are not the derivative of the positions: zero, sign, unit, delay."""
    windows, stretch = _windows(log), _stretch(log)
    there = moving(log)
    for joint, name in enumerate(arm.joints):
        stepped, integrated = windows.stepped[:, joint], windows.integrated[:, joint]
        size = float(np.sqrt(np.mean(stepped ** 2))) if len(stepped) else 0.0
        quantum = _quantum(log.q[:, joint])
        if not there[joint] or size < max(1e-4, 3.0 * quantum):
            continue  # too little motion to tell
        finding = _velocity_finding(name, stepped, integrated, log.period)
        if finding is None:
            finding = _delay_finding(stretch, joint, name)
        if finding is not None:
            yield finding


def _velocity_finding(name: str, stepped: np.ndarray, integrated: np.ndarray,
                      period: float) -> Finding | None:
    """Compare Δq with ∫ q̇ dt over windows, shape (K,): q̇ = slope · dq/dt, with a correlation."""
    energy, product = float(integrated @ integrated), float(stepped @ integrated)
    whole = float(stepped @ stepped)
    if energy < 1e-6 * whole:
        speed = math.sqrt(whole / len(stepped)) / max(WINDOW, period)
        return Finding('velocity', name, REFUSED, 0.0, 'the velocity is zero while the position '
                       f'changes by {speed:.2g} rad/s', _state_filter())
    correlation, slope = product / math.sqrt(energy * whole), product / whole
    if correlation < -0.5:
        return Finding('velocity', name, REFUSED, correlation, 'the velocity has the sign '
                       f'opposite to that of dq/dt (correlation {correlation:.2f})',
                       _state_filter())
    if period > WINDOW:
        return None  # the integral over so few rows is too coarse for more
    if correlation < 0.5:
        return Finding('velocity', name, REFUSED, correlation, 'the velocity is not the '
                       f'derivative of the position (correlation {correlation:.2f})',
                       _state_filter())
    if not 0.8 < slope < 1.25:
        unit = next((f', as in {unit}' for factor, unit in (
            (180.0 / math.pi, 'degrees per second'), (60.0 / (2.0 * math.pi), 'rpm'),
            (math.pi / 180.0, 'rad per second while the position is in degrees'))
            if 0.9 < slope / factor < 1.1), '')
        return Finding('velocity', name, REFUSED, slope, f'the velocity is {slope:.3g} times the '
                       f'derivative of the position{unit}', _state_filter())
    if correlation < 0.9 or not 0.93 < slope < 1.07:
        return Finding('velocity', name, WARNING, slope, f'the velocity is {slope:.3g} times the '
                       f'derivative of the position (correlation {correlation:.2f})',
                       _state_filter())
    return None


def _delay_finding(log: Excerpt, joint: int, name: str) -> Finding | None:
    """Look for the shift of the velocity that fits the position best."""
    size, most = _window_rows(log), round(LONGEST_DELAY / log.period)
    if len(log.t) < 10 * (size + most):
        return None
    q, qd = log.q[:, joint], log.qd[:, joint]
    total = np.concatenate([[0.0], np.cumsum(0.5 * (qd[1:] + qd[:-1])) * log.period])
    stepped, integrated = q[size:] - q[:-size], total[size:] - total[:-size]
    fixed = stepped[most:-most]
    lags = np.arange(-most, most + 1)
    fit = np.array([np.corrcoef(fixed, integrated[most + lag:most + lag + len(fixed)])[0, 1]
                    for lag in lags])
    best = int(np.argmax(fit))
    delay = float(lags[best] * log.period)
    if abs(delay) < max(0.01, 1.5 * log.period) or not 3.0 * (1.0 - fit[best]) < 1.0 - fit[most]:
        return None
    return Finding('velocity', name, WARNING, delay, f'the velocity is {abs(1e3 * delay):.0f} ms '
                   f'{"behind" if delay > 0.0 else "ahead of"} the position', _state_filter())


def position_findings(log: Excerpt, arm: Arm) -> Iterator[Finding]:
    """Positions beyond the limits of the URDF; without limits, those of many turns."""
    free = np.full(len(arm.joints), np.inf)
    lower, upper = getattr(arm, 'position_lower', -free), getattr(arm, 'position_upper', free)
    for joint, name in enumerate(arm.joints):
        q = log.q[:, joint]
        if np.isinf(upper[joint] - lower[joint]):
            if (most := float(np.abs(q).max())) > TURNS:
                yield Finding('position', name, WARNING, most, f'the position reaches {most:.3g} '
                              f'rad, {most / (2.0 * math.pi):.1f} turns: degrees?',
                              f'{option("degrees")} converts positions and velocities')
            continue
        beyond = np.maximum(lower[joint] - q, q - upper[joint])
        worst = float(beyond.max())
        if worst < 0.05:
            continue
        largest = float(q[np.argmax(beyond)])
        limits = f'{lower[joint]:.4g} to {upper[joint]:.4g} rad'
        part = float((beyond > 0.05).mean())
        text = f'the position of {largest:.4g} rad is beyond the limits of the URDF, {limits}'
        turned = np.deg2rad(q)
        if np.abs(q).max() > 2.0 * np.pi and (
                np.maximum(lower[joint] - turned, turned - upper[joint]).max() < 0.05):
            yield Finding('position', name, REFUSED, largest, f'{text}: degrees?',
                          f'{option("degrees")} converts positions and velocities')
        elif worst > 0.5:
            yield Finding('position', name, REFUSED, largest,
                          f'{text}, in {part:.0%} of the log: another robot, another order of '
                          'the joints, or another zero?', argument('joints') + ' names them in '
                          'order')
        else:
            yield Finding('position', name, WARNING, largest, f'{text}, in {part:.1%} of the log')


def effort_findings(log: Excerpt, arm: Arm) -> Iterator[Finding]:
    """Efforts that never change, or are far beyond what the URDF allows."""
    there = moving(log)
    limit = getattr(arm, 'torque_limit', np.full(len(arm.joints), np.inf))
    for joint, name in enumerate(arm.joints):
        tau = log.tau[:, joint]
        if np.ptp(tau) == 0.0:
            what = 'zero' if tau[0] == 0.0 else f'constant at {tau[0]:.4g} N·m'
            yield Finding('effort', name, REFUSED if there[joint] else WARNING, float(tau[0]),
                          f'the effort is {what} in the whole log'
                          + (' while the joint moves' if there[joint] else ''))
        elif np.abs(tau).max() > 3.0 * limit[joint]:
            largest = float(np.abs(tau).max())
            yield Finding('effort', name, WARNING, largest, f'the effort of {largest:.4g} N·m is '
                          f'far beyond the {limit[joint]:.4g} N·m of the URDF: another unit?',
                          gain_of(name) + ' multiplies it')


def rate_findings(log: Excerpt, settings: FilterSettings) -> Iterator[Finding]:
    """Rates that the filters cannot use, and jitter."""
    steps, rate = np.diff(log.t), 1.0 / log.period
    if log.period > settings.gap:
        help_ = setting('filter.gap', f'{3.0 * log.period:.2g}')
        if settings.time_constant < 2.0 * log.period:
            help_ += ' ' + setting('filter.time_constant', f'{3.0 * log.period:.2g}')
        yield Finding('rate', None, REFUSED, rate, f'the log has {rate:.3g} Hz, and the filters '
                      f'restart after {settings.gap:g} s without a sample{_unit(log)}', help_)
    elif log.period > settings.time_constant:
        yield Finding('rate', None, WARNING, rate, f'the log has {rate:.3g} Hz, too few for a '
                      f'filter of {settings.time_constant:g} s',
                      setting('filter.time_constant', f'{3.0 * log.period:.2g}'))
    late = float((steps > 3.0 * log.period).mean())
    if late > 0.01:
        yield Finding('rate', None, WARNING, late, f'{late:.1%} of the intervals are more than '
                      f'three times the median of {1e3 * log.period:.3g} ms')


def _unit(log: Excerpt) -> str:
    """Return the question whether the times are in another unit, where that is likely."""
    unit, reason = period_unit(log.t, log.q, log.qd)
    return f'; {question(unit, reason)}' if reason else ''


def _state_filter() -> str:
    return setting('filter.state_order', '4') + ' takes velocities from the positions'


def _windows(log: Excerpt) -> _Windows:
    """Return Δq and ∫ q̇ dt over all windows without a gap."""
    size = _window_rows(log)
    total = np.vstack([np.zeros(log.q.shape[1]), np.cumsum(
        0.5 * (log.qd[1:] + log.qd[:-1]) * np.diff(log.t)[:, None], axis=0)])
    gaps = np.concatenate([[0], np.cumsum(~log.whole)])
    begin = np.arange(0, len(log.t) - size, size)
    begin = begin[gaps[begin + size] == gaps[begin]]
    return _Windows(log.q[begin + size] - log.q[begin], total[begin + size] - total[begin])


def _window_rows(log: Excerpt) -> int:
    return max(1, round(WINDOW / log.period))


def _quantum(values: np.ndarray) -> float:
    """Return the smallest step between two values, the resolution of an encoder [rad]."""
    steps = np.abs(np.diff(values[:STRETCH]))
    return float(steps[steps > 0.0].min(initial=np.inf)) if (steps > 0.0).any() else 0.0


def _stretch(log: Excerpt) -> Excerpt:
    """Return the longest stretch without a gap, its rows at even times."""
    edges = np.concatenate([[0], np.flatnonzero(~log.whole) + 1, [len(log.t)]])
    longest = int(np.argmax(np.diff(edges)))
    rows = slice(int(edges[longest]), min(int(edges[longest + 1]), int(edges[longest]) + STRETCH))
    return even(Excerpt(log.t[rows], log.q[rows], log.qd[rows], log.tau[rows], log.period,
                        np.ones(rows.stop - rows.start - 1, dtype=bool)))
