# SPDX-License-Identifier: Apache-2.0
"""Checks of a measured log for what stands in it twice: a column, or a row."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.finding import Excerpt, Finding, REFUSED, WARNING
from adaptive_blf_control.identification.kinematic_checks import moving

__all__ = ['column_findings', 'row_findings']

MOSTLY = 0.2  # of the rows in motion that may be like the row before
SLOW = 0.01  # of the largest velocity, below which an arm may show the same twice


def column_findings(log: Excerpt, arm: Arm) -> Iterator[Finding]:
    """Efforts of two joints that are the same in every row, while their positions differ."""
    for one, other in combinations(range(len(arm.joints)), 2):
        tau = log.tau[:, other]
        if (np.ptp(tau) > 0.0 and np.array_equal(log.tau[:, one], tau)
                and not np.array_equal(log.q[:, one], log.q[:, other])):
            yield Finding('effort', arm.joints[other], REFUSED, 1.0, 'the effort is that of joint '
                          f'{arm.joints[one]!r} in every row: one column for both?')


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
