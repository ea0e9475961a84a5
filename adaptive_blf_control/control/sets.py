# SPDX-License-Identifier: Apache-2.0
"""Safety set (7), performance set (8) and the check that one keeps the other (9)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptive_blf_control.errors import ParameterError, SetViolation

__all__ = ['JointInterval', 'check_performance_inside_safety', 'check_start']

# Equality is allowed (the paper's own examples meet (9) with it); this absorbs rounding only.
TOLERANCE = 1e-9


@dataclass(frozen=True)
class JointInterval:
    """An open interval per joint, lower < upper, each of shape (n,) [rad]."""

    lower: np.ndarray
    upper: np.ndarray
    name: str = 'set'

    def __post_init__(self) -> None:
        """Freeze the arrays; ParameterError where an interval is empty or not finite."""
        for field in ('lower', 'upper'):
            array = np.array(getattr(self, field), dtype=float)
            if not np.all(np.isfinite(array)):
                raise ParameterError(f'{self.name}.{field}', array.tolist(), 'finite values [rad]')
            array.setflags(write=False)
            object.__setattr__(self, field, array)
        if not np.all(self.lower < self.upper):
            raise ParameterError(f'{self.name}.lower', self.lower.tolist(),
                                 f'values below {self.name}.upper = {self.upper.tolist()}')

    def margin(self, value: np.ndarray) -> np.ndarray:
        """Return the distance to the nearer bound, shape (n,) [rad]; negative outside."""
        return np.minimum(value - self.lower, self.upper - value)


def check_performance_inside_safety(safety: JointInterval, performance: JointInterval,
                                    reference: tuple[np.ndarray, np.ndarray],
                                    joints: tuple[str, ...]) -> None:
    """Check 𝒫̄ ⊆ 𝒮̄ (9): reference range plus performance set inside the safety set.

    Raises:
        ParameterError: the performance set does not contain zero error.
        SetViolation: names the first joint whose 𝒫̄ pokes out, with both numbers.
    """
    if not (np.all(performance.lower < 0.0) and np.all(performance.upper > 0.0)):
        raise ParameterError('performance', [performance.lower.tolist(),
                                             performance.upper.tolist()],
                             'lower < 0 < upper for every joint [rad]')
    low, high = reference[0] + performance.lower, reference[1] + performance.upper
    for i, joint in enumerate(joints):
        if low[i] < safety.lower[i] - TOLERANCE:
            raise SetViolation(joint, low[i], safety.lower[i],
                               'reference plus performance set pokes out of the safety set below')
        if high[i] > safety.upper[i] + TOLERANCE:
            raise SetViolation(joint, high[i], safety.upper[i],
                               'reference plus performance set pokes out of the safety set above')


def check_start(safety: JointInterval, performance: JointInterval, q: np.ndarray, e1: np.ndarray,
                joints: tuple[str, ...]) -> None:
    """Check that the first state lies inside both sets; SetViolation names joint and numbers."""
    for interval, value, what in ((safety, q, 'start position outside the safety set'),
                                  (performance, e1, 'start error outside the performance set')):
        for i, joint in enumerate(joints):
            if not value[i] > interval.lower[i]:
                raise SetViolation(joint, float(value[i]), float(interval.lower[i]), what)
            if not value[i] < interval.upper[i]:
                raise SetViolation(joint, float(value[i]), float(interval.upper[i]), what)
