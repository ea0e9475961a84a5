# SPDX-License-Identifier: Apache-2.0
"""A reference through points is smooth, meets them, and knows its range."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.control.reference import (
    from_time,
    full_range,
    ReferencePoint,
    SumOfSinusoids,
)
from adaptive_blf_control.control.trajectory import (
    DelayedReference,
    JoinedReference,
    PointReference,
)
from adaptive_blf_control.errors import ParameterError


def _point(position, velocity=(0.0, 0.0), acceleration=(0.0, 0.0)) -> ReferencePoint:
    return ReferencePoint(*(np.array(v, dtype=float)
                            for v in (position, velocity, acceleration)))


POINTS = [_point([0.1, 2.0], [0.5, -0.2], [0.3, 0.1]), _point([0.8, 1.0], [0.0, -0.7]),
          _point([-0.4, 1.5])]
TIMES = [0.0, 0.7, 2.0]


def test_every_point_is_met_with_its_velocity_and_acceleration() -> None:
    way = PointReference(TIMES, POINTS)
    for t, wanted in zip(TIMES, POINTS):
        for got, want in zip(way.at(t), wanted):
            np.testing.assert_allclose(got, want, atol=1e-9)
        for got, want in zip(way.at(max(t - 1e-9, 0.0)), wanted):
            np.testing.assert_allclose(got, want, atol=1e-6)


def test_velocity_and_acceleration_are_the_derivatives() -> None:
    way, h = PointReference(TIMES, POINTS), 1e-5
    for t in (0.1, 0.4, 0.9, 1.7):
        before, here, after = way.at(t - h), way.at(t), way.at(t + h)
        np.testing.assert_allclose((after.position - before.position) / (2 * h), here.velocity,
                                   atol=1e-7)
        np.testing.assert_allclose((after.velocity - before.velocity) / (2 * h),
                                   here.acceleration, atol=1e-6)


def test_range_is_reached_and_never_left() -> None:
    way = PointReference(TIMES, POINTS)
    lower, upper = way.range()
    q = np.array([way.at(t).position for t in np.linspace(0.0, 3.0, 30001)])
    np.testing.assert_allclose(q.min(axis=0), lower, atol=1e-6)
    np.testing.assert_allclose(q.max(axis=0), upper, atol=1e-6)


@pytest.mark.parametrize('order', [1, 2])
def test_the_largest_velocity_and_acceleration_are_reached_and_never_exceeded(order) -> None:
    way = PointReference(TIMES, POINTS)
    lower, upper = way.extremes(order)
    values = np.array([way.at(t)[order] for t in np.linspace(0.0, 2.0, 40001)])
    np.testing.assert_allclose(values.min(axis=0), lower, atol=2e-3)
    np.testing.assert_allclose(values.max(axis=0), upper, atol=2e-3)


def test_the_end_is_held() -> None:
    for part, want in zip(PointReference(TIMES, POINTS).at(100.0), POINTS[-1]):
        np.testing.assert_array_equal(part, want)


def test_a_joined_reference_is_smooth_where_it_changes_over() -> None:
    before = SumOfSinusoids(np.zeros(2), np.ones((2, 1)), np.full((2, 1), 0.5), np.zeros((2, 1)))
    way = JoinedReference(before, 3.0, PointReference([0.0, 1.0], [before.at(3.0), POINTS[-1]]))
    for left, right in zip(way.at(3.0 - 1e-9), way.at(3.0)):
        np.testing.assert_allclose(left, right, atol=1e-8)
    np.testing.assert_allclose(way.at(4.0).position, POINTS[-1].position)


def test_a_joined_reference_that_has_begun_forgets_what_was_before() -> None:
    before = SumOfSinusoids(np.zeros(2), np.ones((2, 1)), np.full((2, 1), 0.5), np.zeros((2, 1)))
    first = JoinedReference(before, 3.0, PointReference(TIMES, POINTS))
    second = JoinedReference(first, 6.0, PointReference(TIMES, POINTS))
    for now in (2.0, 3.0, 4.0, 6.0):
        rest = from_time(second, now)
        for t in np.linspace(now, 9.0, 29):
            np.testing.assert_array_equal(rest.at(t), second.at(t))
    assert isinstance(from_time(first, 3.0), DelayedReference)
    assert isinstance(from_time(second, 6.0), DelayedReference)


def test_full_range_of_a_joined_reference_counts_the_first_one_until_it_is_left() -> None:
    before = SumOfSinusoids(np.zeros(2), np.full((2, 1), 9.0), np.ones((2, 1)), np.zeros((2, 1)))
    way = JoinedReference(before, 3.0, PointReference(TIMES, POINTS))
    np.testing.assert_array_equal(full_range(way), before.range())
    np.testing.assert_array_equal(full_range(from_time(way, 3.0)), way.range())


@pytest.mark.parametrize(('times', 'points', 'what'), [
    ([0.0, 1.0, 1.0], POINTS, 'ascending'),
    ([0.0], POINTS[:1], 'ascending'),
    ([0.0, 1.0], POINTS[:2], 'at rest'),
    ([0.0, 1.0], [POINTS[0], _point([np.nan, 0.0])], 'finite'),
])
def test_points_that_cannot_be_followed_are_refused(times, points, what) -> None:
    with pytest.raises(ParameterError, match=what):
        PointReference(times, points)
