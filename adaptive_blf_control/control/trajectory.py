# SPDX-License-Identifier: Apache-2.0
"""A reference through given points, joined to the one that is being followed."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np

from adaptive_blf_control.control.reference import (
    DEEPEST,
    from_time,
    full_range,
    hull,
    Reference,
    ReferencePoint,
)
from adaptive_blf_control.errors import ParameterError

__all__ = ['DelayedReference', 'JoinedReference', 'PointReference']


def _quintics(t: np.ndarray, start: ReferencePoint, end: ReferencePoint) -> np.ndarray:
    """Coefficients c_0..c_5 of K quintics that meet their ends to C², shape (6, K, n).

    Args:
        t: Their durations, shape (K, 1) [s].
        start: Begin of each, arrays of shape (K, n).
        end: End of each, likewise.
    """
    c0, c1, c2 = start.position, start.velocity, 0.5 * start.acceleration
    dy = end.position - (c0 + c1 * t + c2 * t * t)
    dv = (end.velocity - (c1 + 2.0 * c2 * t)) * t
    da = (end.acceleration - 2.0 * c2) * t * t
    return np.array([c0, c1, c2, (10.0 * dy - 4.0 * dv + 0.5 * da) / t**3,
                     (-15.0 * dy + 7.0 * dv - da) / t**4, (6.0 * dy - 3.0 * dv + 0.5 * da) / t**5])


def _bernstein(c: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return the Bernstein coefficients of polynomials over [0, length]; they bound the values.

    Args:
        c: Coefficients of K polynomials of degree d for n joints, shape (K, d + 1, n).
        lengths: Shape (K,).
    """
    degree = c.shape[1] - 1
    scaled = c * lengths[:, None, None] ** np.arange(degree + 1)[None, :, None]
    weight = np.array([[comb(i, j) / comb(degree, j) for j in range(degree + 1)]
                       for i in range(degree + 1)])
    return np.einsum('ij,kjn->kin', weight, scaled)


def _beyond_numbers() -> ParameterError:
    return ParameterError('joint_trajectory.points', 'values too large or too small',
                          'positions, velocities, accelerations and times of a usual size')


def _roots(coefficients: np.ndarray) -> np.ndarray:
    try:
        return np.roots(coefficients)
    except np.linalg.LinAlgError:  # one is so small that dividing by it overflows
        raise _beyond_numbers() from None


class PointReference:
    """Quintic segments through points, C²; the last point is held at rest."""

    def __init__(self, times: Sequence[float], points: Sequence[ReferencePoint]) -> None:
        """Take K ≥ 2 points at strictly ascending ``times`` [s], the first at 0.

        Raises:
            ParameterError: times not ascending, values not finite or beyond what can be computed
                with, or the end not at rest.
        """
        self._times = np.array(times, dtype=float)
        if self._times.size < 2 or not np.all(np.diff(self._times) > 0.0):
            raise ParameterError('joint_trajectory.time_from_start', list(times),
                                 'strictly ascending times > 0 s')
        if not all(np.isfinite(values).all() for point in points for values in point):
            raise ParameterError('joint_trajectory.points', 'a value that is not finite',
                                 'finite positions, velocities and accelerations')
        if np.any(points[-1].velocity) or np.any(points[-1].acceleration):
            raise ParameterError('joint_trajectory.points[-1].velocities',
                                 points[-1].velocity.tolist(), 'zeros: the end at rest')
        rows = ReferencePoint(*(np.array(part) for part in zip(*points)))
        self._segments = np.moveaxis(_quintics(
            np.diff(self._times)[:, None], ReferencePoint(*(part[:-1] for part in rows)),
            ReferencePoint(*(part[1:] for part in rows))), 1, 0)
        if not np.isfinite(self._segments).all():
            raise _beyond_numbers()
        self._last = points[-1]

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s] ≥ 0."""
        if t >= self._times[-1]:
            return self._last
        k = max(int(np.searchsorted(self._times, t, side='right')) - 1, 0)
        x = t - self._times[k]
        c0, c1, c2, c3, c4, c5 = self._segments[k]
        return ReferencePoint(
            c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5)))),
            c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5))),
            2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5)))

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the exact range of every joint: ends and stationary points of each segment.

        Raises:
            ParameterError: the numbers are too large or too small for that.
        """
        return self.extremes(0)

    def extremes(self, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the exact range of a derivative: 0 [rad], 1 [rad/s], 2 [rad/s²]; arrays (n,).

        Only where the Bernstein coefficients of a segment leave the range of all ends does it
        matter where it turns.
        """
        lengths = np.diff(self._times)
        c = self._segments
        for _ in range(order):
            c = c[:, 1:] * np.arange(1.0, c.shape[1])[None, :, None]
        with np.errstate(over='ignore', invalid='ignore'):
            hull = _bernstein(c, lengths)
        if not np.isfinite(hull).all():
            raise _beyond_numbers()
        ends = np.concatenate([hull[:, 0], hull[:, -1]])
        lower, upper = ends.min(axis=0), ends.max(axis=0)
        leaves = (hull.min(axis=1) < lower) | (hull.max(axis=1) > upper)
        for k, i in np.argwhere(leaves):
            rate = c[k, 1:, i] * np.arange(1, c.shape[1])
            roots = _roots(rate[::-1])
            inside = roots[np.isreal(roots)].real
            inside = inside[(inside > 0.0) & (inside < lengths[k])]
            values = np.polynomial.polynomial.polyval(
                np.concatenate([[0.0, lengths[k]], inside]), c[k, :, i])
            lower[i], upper[i] = min(lower[i], values.min()), max(upper[i], values.max())
        return lower, upper


class DelayedReference:
    """A reference with its own time, which began at ``t`` [s]."""

    def __init__(self, reference: Reference, t: float) -> None:
        """Take the reference and when its time was 0 [s]."""
        self._reference, self._t = reference, t

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s]."""
        return self._reference.at(t - self._t)

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the range of the reference."""
        return self._reference.range()


class JoinedReference:
    """One reference until ``t`` [s], another, with its own time from 0, after it."""

    def __init__(self, before: Reference, t: float, after: Reference) -> None:
        """Join the two; ``after`` has to begin where ``before`` is.

        Raises:
            ParameterError: too many changes of the reference are under way at once.
        """
        self._before, self._t, self._after = before, t, after
        self._depth = 1 + getattr(before, '_depth', 0)
        if self._depth > DEEPEST:
            raise ParameterError('reference', f'{self._depth} changes on the way',
                                 f'at most {DEEPEST}: wait until the last ones have begun')

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s]."""
        return self._before.at(t) if t < self._t else self._after.at(t - self._t)

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the range of what is still to come."""
        return self._after.range()

    def full_range(self) -> tuple[np.ndarray, np.ndarray]:
        """See `reference.full_range`; until ``t`` the first one counts as well."""
        return hull(full_range(self._before), self._after.range())

    def from_time(self, t: float) -> Reference:
        """See `reference.from_time`."""
        if t >= self._t:
            return DelayedReference(self._after, self._t)
        return JoinedReference(from_time(self._before, t), self._t, self._after)
