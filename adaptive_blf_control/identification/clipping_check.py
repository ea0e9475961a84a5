# SPDX-License-Identifier: Apache-2.0
"""Is the effort of a measured log cut off at its largest values, by a sensor or by a drive?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.finding import Excerpt, Finding, WARNING
from adaptive_blf_control.identification.kinematic_checks import moving, WINDOW
from adaptive_blf_control.spelling import argument

__all__ = ['clipping_findings']

LEAST_ROWS = 3  # in a row at one value, from which the effort is cut off there
LEAST_TIMES = 3  # that it is; any motion may have its largest effort once
RARE = 0.2  # rows at the value next to it: of coarse values it has more
ALMOST_STILL = 1e-3  # of the range of the position, which a joint at rest may change by


def clipping_findings(log: Excerpt, arm: Arm) -> Iterator[Finding]:
    """Efforts that stay at their largest value again and again while the joint moves."""
    for joint in np.flatnonzero(moving(log)):
        tau, moves = log.tau[:, joint], _moves(log, int(joint))
        ends = [float(end) for end in (tau.max(), tau.min())]
        cut = {end: times for end in ends if (times := _times(tau, end, moves, log.whole))}
        if sum(cut.values()) < LEAST_TIMES:
            continue
        part = float(np.isin(tau, list(cut)).mean())
        values = ' or '.join(f'{end:.4g}' for end in cut)
        yield Finding('effort', arm.joints[joint], WARNING, part, f'the effort stays at exactly '
                      f'{values} N·m, the end of its range, {sum(cut.values())} times while the '
                      f'joint moves, in {part:.1%} of the rows: cut off by a sensor, or a drive '
                      'at its limit? What was beyond is not in the log',
                      argument('train') + ' picks a span without it')


def _moves(log: Excerpt, joint: int) -> np.ndarray:
    """Return in which rows a joint moves, shape (N,)."""
    rows = max(1, round(0.5 * WINDOW / log.period))
    q = np.pad(log.q[:, joint], rows, mode='edge')
    result: np.ndarray = np.abs(q[2 * rows:] - q[:-2 * rows]) > ALMOST_STILL * np.ptp(q)
    return result


def _times(tau: np.ndarray, end: float, moves: np.ndarray, whole: np.ndarray) -> int:
    """Return how often an effort stays at one of its ends; 0 where that is not a cut."""
    at = tau == end
    rows = np.count_nonzero(at)
    others = tau[~at]
    nearest = others[np.argmin(np.abs(others - end))] if len(others) else end
    if np.count_nonzero(tau == nearest) > RARE * rows or 2 * np.count_nonzero(at & moves) < rows:
        return 0
    begins = at & np.concatenate([[True], ~(at[:-1] & whole)])
    moving_rows = np.bincount(np.cumsum(begins)[at & moves])
    return int(np.count_nonzero(moving_rows >= LEAST_ROWS))
