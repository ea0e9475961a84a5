# SPDX-License-Identifier: Apache-2.0
"""Safety set (7), performance set (8) and the check that one keeps the other (9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arrays import record, same_values
from adaptive_blf_control.compiled import jit
from adaptive_blf_control.control.reference import quintic
from adaptive_blf_control.errors import ParameterError, SetViolation

__all__ = ['Bounds', 'GrowingBounds', 'JointInterval', 'check_inside', 'check_no_further_out',
           'check_performance_inside_safety']

# Equality is allowed (the paper's own examples meet (9) with it); this absorbs rounding only.
TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
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

    def __eq__(self, other: object) -> bool:
        """Compare the bounds; the name only stands in messages."""
        return isinstance(other, JointInterval) and same_values(
            (self.lower, self.upper), (other.lower, other.upper))

    def __hash__(self) -> int:
        """Return what is equal for equal bounds."""
        return hash((*self.lower.tolist(), *self.upper.tolist()))

    def margin(self, value: np.ndarray) -> np.ndarray:
        """Return the distance to the nearer bound, shape (n,) [rad]; negative outside."""
        return np.minimum(value - self.lower, self.upper - value)


def check_performance_inside_safety(safety: JointInterval, performance: JointInterval,
                                    reference: tuple[np.ndarray, np.ndarray],
                                    joints: tuple[str, ...]) -> None:
    """Check 𝒫̄ ⊆ 𝒮̄ (9): reference range plus performance set inside the safety set.

    Raises:
        ParameterError: the performance set does not contain zero error.
        SetViolation: names the first joint whose 𝒫̄ exceeds 𝒮̄, with both numbers.
    """
    for each, word in ((safety, 'safety'), (performance, 'performance')):
        if each.lower.shape != (len(joints),):
            raise ParameterError(word, [each.lower.tolist(), each.upper.tolist()],
                                 f'bounds for each of {", ".join(joints)}')
    if not (np.all(performance.lower < 0.0) and np.all(performance.upper > 0.0)):
        raise ParameterError('performance', [performance.lower.tolist(),
                                             performance.upper.tolist()],
                             'lower < 0 < upper for every joint [rad]')
    low, high = reference[0] + performance.lower, reference[1] + performance.upper
    for i, joint in enumerate(joints):
        if low[i] < safety.lower[i] - TOLERANCE:
            raise SetViolation(joint, low[i], safety.lower[i],
                               'reference plus performance set exceeds the safety set below')
        if high[i] > safety.upper[i] + TOLERANCE:
            raise SetViolation(joint, high[i], safety.upper[i],
                               'reference plus performance set exceeds the safety set above')


def check_inside(lower: np.ndarray, upper: np.ndarray, value: np.ndarray,
                 joints: tuple[str, ...], what: str, recovery: str = '') -> None:
    """Raise SetViolation for the first joint whose value is not strictly between its bounds."""
    for i, joint in enumerate(joints):
        if not value[i] > lower[i]:
            raise SetViolation(joint, float(value[i]), float(lower[i]), what, recovery=recovery)
        if not value[i] < upper[i]:
            raise SetViolation(joint, float(value[i]), float(upper[i]), what, recovery=recovery)


def check_no_further_out(lower: np.ndarray, upper: np.ndarray, value: np.ndarray,
                         margin: np.ndarray, joints: tuple[str, ...], what: str) -> None:
    """Check a change of bounds or of what is compared with them; the arrays have shape (n,).

    As `check_inside`; but a joint that is outside already may be as far out as it is, or less:
    who has left a set must not be kept from what leads back.

    Args:
        lower: New bounds.
        upper: Likewise.
        value: What has to lie between them.
        margin: Distance to the nearer bound before the change, negative outside.
        joints: Their names.
        what: For the message.

    Raises:
        SetViolation: for the first joint that would be outside, or further out.
    """
    new = np.minimum(value - lower, upper - value)
    kept = (margin <= 0.0) & (new >= margin)
    free = np.full_like(value, np.inf)
    check_inside(np.where(kept, -free, lower), np.where(kept, free, upper), value, joints, what)


@record
class Bounds(NamedTuple):
    """Performance bounds at one instant [rad] and their rates [rad/s], each of shape (n,)."""

    lower: np.ndarray
    upper: np.ndarray
    lower_rate: np.ndarray
    upper_rate: np.ndarray


@jit
def _grown(t: float, duration: float, lower: np.ndarray, upper: np.ndarray, end_lower: np.ndarray,
           end_upper: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    s, sd, _ = quintic(t, duration)
    low, high = end_lower - lower, end_upper - upper
    return lower + s * low, upper + s * high, sd * low, sd * high


class GrowingBounds:
    """Performance bounds that begin as wide as fits round a start posture inside the safety set.

    b(t) = b_0 + s(t/T) (b_1 − b_0) with the quintic s of the smooth start, b_1 the performance set
    and b_0 = min(b_1, distance of the posture to the safety bound), on either side. With
    y_d = q_0 + s (r − q_0), y_d + b is a convex combination of q_0 + b_0 and r + b_1, both inside
    the safety set. A bound only ever grows.
    """

    def __init__(self, performance: JointInterval, safety: JointInterval | None = None,
                 start: np.ndarray | None = None, duration: float = 0.0) -> None:
        """Take the sets, and where there is a smooth start its posture (n,) [rad] and T [s]."""
        rest = np.zeros_like(performance.lower)
        # Copies that may be written to: the law is compiled once for both kinds of bounds.
        self._end = Bounds(performance.lower.copy(), performance.upper.copy(), rest, rest)
        self._duration = duration
        self._start = self._end[:2]
        if safety is not None and start is not None:
            self._start = (np.maximum(performance.lower, safety.lower - start),
                           np.minimum(performance.upper, safety.upper - start))

    def at(self, t: float) -> Bounds:
        """Evaluate at ``t`` [s] since the start of the motion."""
        t = max(t, 0.0)
        if not t < self._duration:  # always, where there is no smooth start; also where t is NaN
            return self._end
        return Bounds(*_grown(t, self._duration, *self._start, *self._end[:2]))

    def resting(self, t: float) -> Bounds | None:
        """Return the bounds that stay from ``t`` [s] on, always the same; None while they grow."""
        return self._end if t >= self._duration else None

    def along(self, times: np.ndarray) -> Bounds:
        """Evaluate at N times, (N,) [s]; the arrays have shape (N, n)."""
        rows = Bounds(*(np.tile(each, (times.size, 1)) for each in self._end))
        for k in np.flatnonzero(times < self._duration):
            for row, each in zip(rows, self.at(float(times[k]))):
                row[k] = each
        return rows
