# SPDX-License-Identifier: Apache-2.0
"""Facts about the safety set (7), the performance set (8) and the check of (9)."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.control.reference import SmoothStart, SumOfSinusoids
from adaptive_blf_control.control.sets import (
    check_no_further_out,
    check_performance_inside_safety,
    GrowingBounds,
    JointInterval,
)
from adaptive_blf_control.errors import ParameterError, SetViolation

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

JOINTS = ('joint1', 'joint2')
PERFORMANCE = JointInterval(np.array([-0.17, -0.17]), np.array([0.2, 0.2]), 'performance')
SAFETY = JointInterval(np.array([-1.17, -2.17]), np.array([1.2, 2.2]), 'safety')
RANGE = np.array([-1.0, -2.0]), np.array([1.0, 2.0])


@pytest.mark.parametrize('t', [-1.0, -1e-9, 0.0, 5.0])
def test_without_a_smooth_start_the_bounds_are_those_of_the_set_at_any_time(t):
    bounds = GrowingBounds(PERFORMANCE).at(t)
    np.testing.assert_array_equal(bounds.lower, PERFORMANCE.lower)
    np.testing.assert_array_equal(bounds.upper, PERFORMANCE.upper)
    assert not bounds.lower_rate.any()
    assert not bounds.upper_rate.any()


def test_equality_of_the_papers_example_is_allowed():
    check_performance_inside_safety(SAFETY, PERFORMANCE, RANGE, JOINTS)


@pytest.mark.parametrize(('side', 'joint', 'moved', 'value', 'bound'), [
    ('below', 1, -2.001, -2.171, -2.17),
    ('above', 0, 1.001, 1.201, 1.2),
])
def test_a_reference_that_exceeds_names_joint_and_numbers(side, joint, moved, value, bound):
    lower, upper = RANGE[0].copy(), RANGE[1].copy()
    (lower if side == 'below' else upper)[joint] = moved
    with pytest.raises(SetViolation, match=f'exceeds the safety set {side}') as caught:
        check_performance_inside_safety(SAFETY, PERFORMANCE, (lower, upper), JOINTS)
    assert caught.value.joint == JOINTS[joint]
    assert caught.value.value == pytest.approx(value)
    assert caught.value.bound == bound
    for word in (JOINTS[joint], f'{value:.6g}', f'{bound:.6g}', 'rad'):
        assert word in str(caught.value)


def test_a_tenth_of_a_milliradian_outside_the_safety_set_is_refused():
    with pytest.raises(SetViolation):
        check_performance_inside_safety(SAFETY, PERFORMANCE, (RANGE[0], RANGE[1] + 1e-4), JOINTS)


@pytest.mark.parametrize(('lower', 'upper'), [(0.0, 0.2), (-0.1, 0.0), (0.1, 0.2), (-0.2, -0.1)])
def test_performance_set_has_to_contain_zero_error(lower, upper):
    performance = JointInterval(np.array([-0.1, lower]), np.array([0.1, upper]))
    with pytest.raises(ParameterError, match='lower < 0 < upper'):
        check_performance_inside_safety(SAFETY, performance, RANGE, JOINTS)


def test_margin_is_the_distance_to_the_nearer_bound():
    np.testing.assert_allclose(SAFETY.margin(np.array([1.0, -2.0])), [0.2, 0.17])
    np.testing.assert_allclose(SAFETY.margin(np.array([1.3, -2.27])), [-0.1, -0.1])


@pytest.mark.parametrize(('lower', 'upper'), [(1.0, 1.0), (2.0, 1.0)])
def test_an_empty_interval_is_refused(lower, upper):
    with pytest.raises(ParameterError, match=r'controller\.safety\.lower'):
        JointInterval(np.array([0.0, lower]), np.array([1.0, upper]), 'controller.safety')


@pytest.mark.parametrize('value', [float('nan'), float('inf'), -float('inf')])
def test_bounds_are_finite(value):
    with pytest.raises(ParameterError, match=r'safety\.upper.*finite'):
        JointInterval(np.array([0.0]), np.array([value]), 'safety')


def test_bounds_cannot_be_changed():
    with pytest.raises(ValueError, match='read-only'):
        SAFETY.lower[0] = -9.0


inside = st.floats(0.0, 1.0, exclude_min=True, exclude_max=True)
REFERENCE = SumOfSinusoids(np.zeros(2), np.array([[1.0], [2.0]]), np.array([[0.7], [2.9]]),
                           np.array([[0.3], [1.9]]))


def _posture(parts: tuple[float, float]) -> np.ndarray:
    q = SAFETY.lower + np.array(parts) * (SAFETY.upper - SAFETY.lower)
    hypothesis.assume(np.all(SAFETY.margin(q) > 0.0))
    return q


@hypothesis.given(parts=st.tuples(inside, inside), duration=st.floats(0.01, 10.0),
                  part=st.floats(0.0, 1.5))
def test_reference_and_growing_bounds_stay_inside_the_safety_set(parts, duration, part):
    q, t = _posture(parts), part * duration
    bounds = GrowingBounds(PERFORMANCE, SAFETY, q, duration).at(t)
    position = SmoothStart(REFERENCE, duration, q).at(t).position
    assert np.all(position + bounds.upper <= SAFETY.upper + 1e-12)
    assert np.all(position + bounds.lower >= SAFETY.lower - 1e-12)
    assert np.all(bounds.lower < 0.0)
    assert np.all(bounds.upper > 0.0)


@hypothesis.given(parts=st.tuples(inside, inside), times=st.tuples(inside, inside))
def test_growing_bounds_only_grow_at_the_rate_they_state(parts, times):
    grown = GrowingBounds(PERFORMANCE, SAFETY, _posture(parts), 2.0)
    early, late = sorted(2.0 * t for t in times)
    before, after, h = grown.at(early), grown.at(late), 1e-6
    assert np.all(before.upper <= after.upper + 1e-15)
    assert np.all(before.lower >= after.lower - 1e-15)
    if h < early < 2.0 - h:
        left, right = grown.at(early - h), grown.at(early + h)
        np.testing.assert_allclose(before.upper_rate, (right.upper - left.upper) / (2 * h),
                                   atol=1e-8)
        np.testing.assert_allclose(before.lower_rate, (right.lower - left.lower) / (2 * h),
                                   atol=1e-8)


def test_growing_bounds_begin_as_wide_as_fits_and_end_as_the_performance_set():
    grown = GrowingBounds(PERFORMANCE, SAFETY, np.array([1.15, -2.1]), 2.0)
    np.testing.assert_allclose(grown.at(0.0)[:2], [[-0.17, -0.07], [0.05, 0.2]])
    for t in (2.0, 99.0):
        np.testing.assert_array_equal(grown.at(t)[:2], [PERFORMANCE.lower, PERFORMANCE.upper])
        assert not np.any(grown.at(t)[2:])


def test_bounds_round_a_start_with_room_are_the_performance_set_at_once():
    plain, grown = GrowingBounds(PERFORMANCE), GrowingBounds(PERFORMANCE, SAFETY, np.zeros(2), 2.0)
    for t in np.linspace(0.0, 3.0, 31):
        np.testing.assert_array_equal(grown.at(t), plain.at(t))


def test_bounds_at_many_times_are_those_at_each():
    grown, times = GrowingBounds(PERFORMANCE, SAFETY, np.array([1.15, -2.1]), 2.0), [0.0, 1.3, 2.5]
    rows = grown.along(np.array(times))
    for k, t in enumerate(times):
        np.testing.assert_array_equal([row[k] for row in rows], grown.at(t))


def test_bounds_before_the_start_are_those_at_the_start():
    grown = GrowingBounds(PERFORMANCE, SAFETY, np.array([1.15, -2.1]), 2.0)
    np.testing.assert_array_equal(grown.at(-0.5), grown.at(0.0))


@pytest.mark.parametrize(('value', 'refused'), [
    (0.5, False),   # inside
    (1.3, False),   # as far out as before
    (1.2, False),   # nearer, and still outside
    (1.4, True),    # further out
    (-1.2, False),  # as little outside on the other side
])
def test_who_has_left_a_set_may_come_nearer_and_not_get_further_out(value, refused):
    def check():
        check_no_further_out(np.array([-1.0]), np.array([1.0]), np.array([value]),
                             np.array([1.0 - 1.3]), ('joint1',), 'outside')

    if refused:
        with pytest.raises(SetViolation, match='outside') as error:
            check()
        assert (error.value.joint, error.value.value, error.value.bound) == ('joint1', 1.4, 1.0)
    else:
        check()


@pytest.mark.parametrize('value', [1.0, 1.001, -1.0])
def test_who_is_inside_has_to_stay_strictly_inside(value):
    with pytest.raises(SetViolation):
        check_no_further_out(np.array([-1.0]), np.array([1.0]), np.array([value]),
                             np.array([0.1]), ('joint1',), 'outside')
