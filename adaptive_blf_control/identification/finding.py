# SPDX-License-Identifier: Apache-2.0
"""What a check of a measured log has found, and the part of a log that is looked at."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import itertools
from typing import NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.spelling import option

__all__ = ['Excerpt', 'Finding', 'LogRows', 'REFUSED', 'WARNING', 'even', 'excerpt', 'gain_of',
           'listed']

REFUSED, WARNING = 'refused', 'warning'
ROWS = 200_000  # looked at of a longer log
BLOCKS = 40


class Finding(NamedTuple):
    """Something about a log that cannot be right, or may not be.

    Attributes:
        check: Which check: velocity, position, motion, effort, effort kind, rate, delay, gravity,
            order or unit.
        joint: The joint, or None where it concerns all.
        level: `REFUSED` or `WARNING`.
        value: The figure that tells, in the unit that ``text`` names.
        text: What is odd, with the figure.
        hint: The option that would help; may be empty.
    """

    check: str
    joint: str | None
    level: str
    value: float
    text: str
    hint: str = ''

    def __str__(self) -> str:
        """Return one sentence."""
        where = f'joint {self.joint!r}: ' if self.joint else ''
        return f'{where}{self.text}' + (f': {self.hint}' if self.hint else '')


class Excerpt(NamedTuple):
    """Rows of a log, all of them or evenly spaced blocks.

    Attributes:
        t: Times, shape (N,) [s].
        q: Positions, shape (N, n) [rad].
        qd: Velocities, shape (N, n) [rad/s].
        tau: Torques, shape (N, n) [N·m].
        period: Median period [s].
        whole: Whether a row follows the one before without a gap, shape (N − 1,).
    """

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    tau: np.ndarray
    period: float
    whole: np.ndarray


class LogRows(Protocol):
    """The rows of a log, all finite and in the order of time; see `MeasuredLog`."""

    @property
    def t(self) -> np.ndarray:
        """Times, shape (N,) [s]."""
        ...

    @property
    def q(self) -> np.ndarray:
        """Positions, shape (N, n) [rad]."""
        ...

    @property
    def qd(self) -> np.ndarray:
        """Velocities, shape (N, n) [rad/s]."""
        ...

    @property
    def tau(self) -> np.ndarray:
        """Torques, shape (N, n) [N·m]."""
        ...

    @property
    def breaks(self) -> tuple[int, ...]:
        """Rows at which the clock was set back."""
        ...

    @property
    def measured_velocity(self) -> bool:
        """Whether the velocities mean anything."""
        ...


def gain_of(joint: str) -> str:
    """Return the option that multiplies the effort of a joint by K, as the caller writes it."""
    return option('gain', f'{{{joint!r}: K}}', f'{joint}:K')


def excerpt(log: LogRows, rows: int = ROWS, blocks: int = BLOCKS) -> Excerpt:
    """Return at most about ``rows`` rows of a log, in ``blocks`` blocks where it is longer."""
    size = len(log.t)
    chosen = np.arange(size)
    if size > rows:
        starts = np.linspace(0, size - rows // blocks, blocks).astype(int)
        chosen = np.unique(starts[:, None] + np.arange(rows // blocks))
    t, q, qd, tau = (np.asarray(values[chosen]) for values in (log.t, log.q, log.qd, log.tau))
    steps = np.diff(t)
    period = float(np.median(steps))
    whole = (steps < 5.0 * period) & (np.diff(chosen) == 1)
    whole[np.isin(chosen[1:], log.breaks)] = False
    return Excerpt(t, q, qd, tau, period, whole)


def even(log: Excerpt) -> Excerpt:
    """Return a log with rows at even times, interpolated between gaps.

    Else jitter of the stamps is an error of all that is compared with rows some time later, and is
    none where nothing is shifted.
    """
    edges = [0, *(np.flatnonzero(~log.whole) + 1), len(log.t)]
    parts = []
    for begin, end in itertools.pairwise(edges):
        t = log.t[begin:end]
        times = t[0] + log.period * np.arange(1 + round((t[-1] - t[0]) / log.period))
        parts.append([times, *(np.column_stack([
            np.interp(times, t, column) for column in values[begin:end].T])
            for values in (log.q, log.qd, log.tau))])
    whole = np.ones(sum(len(part[0]) for part in parts) - 1, dtype=bool)
    whole[np.cumsum([len(part[0]) for part in parts])[:-1] - 1] = False
    t, q, qd, tau = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Excerpt(t, q, qd, tau, log.period, whole)


def listed(findings: Iterable[Finding], joints: Sequence[str]) -> dict[str, str]:
    """Return the verdict on each joint: ``sound``, or all that was found about it."""
    verdicts: dict[str, list[str]] = {joint: [] for joint in joints}
    for finding in findings:
        if finding.joint is not None:
            verdicts[finding.joint].append(f'{finding.level}: {finding.text}')
    return {joint: '; '.join(found) or 'sound' for joint, found in verdicts.items()}
