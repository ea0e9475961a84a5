# SPDX-License-Identifier: Apache-2.0
"""Checks of a measured log for single rows that stand out from both of their neighbours."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.finding import Excerpt, Finding, WARNING

__all__ = ['spike_findings']

TIMES = 20.0  # the usual step between two rows, to and fro, from which a row stands out
USUAL = 95.0  # percentile of the steps: of those that are not zero, as at rest
PART = 0.1  # of the range of the values, from which it does; a motion may begin with a small one
BACK = 0.1  # of its size by which the rows around it differ; more where a controller starts hard
OUTER = 1.0  # percent of the values at either end that are not counted to their range


def spike_findings(log: Excerpt, arm: Arm) -> Iterator[Finding]:
    """Values that leave those before them by far and are back at them in the next row."""
    for quantity, unit, values in (('position', 'rad', log.q), ('velocity', 'rad/s', log.qd),
                                   ('effort', 'N·m', log.tau)):
        steps = np.diff(values, axis=0) * log.whole[:, None]
        for joint, name in enumerate(arm.joints):
            low, high = np.percentile(values[:, joint], [OUTER, 100.0 - OUTER])
            size = _sizes(steps[:, joint], PART * float(high - low))
            if size.any():
                first = int(np.argmax(size > 0.0))
                yield Finding(
                    quantity, name, WARNING, float(size.max()),
                    f'{np.count_nonzero(size)} of {len(log.t)} rows stand out from the rows '
                    f'around them, by up to {size.max():.3g} {unit}, the first at '
                    f'{log.t[first + 1]:.6g} s: spikes, or values that were lost? Leave them out')


def _sizes(steps: np.ndarray, least: float) -> np.ndarray:
    """Return by how much rows stand out, zero where they do not, (N − 1,) → (N − 2,)."""
    size = np.abs(steps)
    if not size.any():
        return size[1:]
    usual = float(np.percentile(size[size > 0.0], USUAL))
    stands_out = np.minimum(size[1:], size[:-1])
    back = np.abs(steps[1:] + steps[:-1]) <= BACK * stands_out
    return np.where(back & (stands_out > max(TIMES * usual, least)), stands_out, 0.0)
