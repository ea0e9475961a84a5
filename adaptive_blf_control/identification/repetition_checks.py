# SPDX-License-Identifier: Apache-2.0
"""Checks of a measured log for what stands in it twice: a column, or a row."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.finding import Excerpt, Finding, REFUSED, WARNING
from adaptive_blf_control.identification.kinematic_checks import moving, STILL
from adaptive_blf_control.spelling import argument, setting

__all__ = ['column_findings', 'row_findings', 'section_findings']

MOSTLY = 0.2  # of the rows in motion that may be like the row before
TWICE, LEAST_ROWS = 0.01, 20  # of the rows in motion that may be there at another time, too
SLOW = 0.01  # of the largest velocity, below which an arm may show the same twice


def column_findings(log: Excerpt, arm: Arm, velocities: bool = True) -> Iterator[Finding]:
    """Quantities of two joints that are the same in every row.

    Two joints that are coupled, such as the fingers of a gripper, may be alike in all of them. An
    effort alone may not, nor may a velocity whose position is another; the same position with
    another effort may be either.

    Args:
        log: The log.
        arm: The arm.
        velocities: Whether those of the log mean anything.
    """
    there = moving(log)
    for one, other in combinations(range(len(arm.joints)), 2):
        name, first = arm.joints[other], f'that of joint {arm.joints[one]!r} in every row'
        q, qd, tau = (_same(values, one, other) for values in (log.q, log.qd, log.tau))
        apart = np.ptp(log.q[:, other] - log.q[:, one])
        if tau and not q and np.ptp(log.tau[:, other]) > 0.0:
            yield Finding('effort', name, REFUSED, 1.0,
                          f'the effort is {first}: one column for both?')
        if velocities and qd and apart >= STILL and np.ptp(log.qd[:, other]) > 0.0:
            yield Finding('velocity', name, REFUSED, 1.0, f'the velocity is {first}, and their '
                          f'positions change by up to {apart:.3g} rad against each other: one '
                          'column for both?', setting('filter.state_order', '4')
                          + ' takes velocities from the positions')
        if q and there[other]:
            yield Finding('position', name, WARNING, 1.0, f'the position is {first}: one column '
                          'for both? Nothing tells them apart, even if they are coupled',
                          argument('joints') + ' without one of them locks it')


def _same(values: np.ndarray, one: int, other: int) -> bool:
    return np.array_equal(values[:, one], values[:, other])


def row_findings(log: Excerpt, arm: Arm) -> Iterator[Finding]:
    """Rows that repeat the one before under a new time, while the arm moves."""
    if len(log.t) < 2 or not moving(log).any():
        return
    speed = np.abs(log.qd).max(axis=1)
    moves = (speed[1:] > SLOW * speed.max()) & log.whole
    rows = np.hstack([log.q, log.qd, log.tau])
    again = (rows[1:] == rows[:-1]).all(axis=1)
    part = float(again[moves].mean()) if moves.any() else 0.0
    if part > MOSTLY:
        yield Finding('rate', None, WARNING, part, f'{part:.0%} of the rows repeat the row before '
                      'under a new time: a slower log that was filled up? Leave the repeated rows '
                      'out; what is said of delays is not to be trusted')


def section_findings(log: Excerpt) -> Iterator[Finding]:
    """Rows in motion that are there a second time, bit by bit, at another time."""
    speed = np.abs(log.qd).max(axis=1)
    moves = np.flatnonzero(speed > SLOW * speed.max())
    rows = np.hstack([log.q, log.qd, log.tau])[moves]
    # One number for each row, which takes less memory to sort than all of it.
    mixed = rows @ np.sqrt(np.arange(2.0, 2.0 + rows.shape[1]))
    _, first, which = np.unique(mixed, return_index=True, return_inverse=True)
    earlier = first[which.reshape(-1)]
    later = np.flatnonzero(np.diff(moves[earlier], prepend=-1) == 1)  # not a row that is held
    later = later[earlier[later] < later - 1]
    later = later[(rows[later] == rows[earlier[later]]).all(axis=1)]
    if len(later) >= max(LEAST_ROWS, TWICE * len(moves)):
        begin, copied = (float(log.t[moves[row]]) for row in (earlier[later[0]], later[0]))
        part = len(later) / len(moves)
        yield Finding('rate', None, WARNING, part, f'{part:.0%} of the rows in motion are there '
                      f'twice, as those from {begin:.4g} s on are at {copied:.4g} s: a section '
                      'that was copied? A test with rows that were learned from tells nothing',
                      argument('train') + ' and ' + argument('test') + ' pick spans without it')
