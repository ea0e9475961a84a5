# SPDX-License-Identifier: Apache-2.0
"""Facts about reference trajectories: exact derivatives, their range, the smooth start."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.control.reference import (
    along,
    Crossfade,
    DEEPEST,
    from_time,
    full_range,
    Posture,
    Reference,
    ReferencePoint,
    SmoothStart,
    SumOfSinusoids,
)
from adaptive_blf_control.errors import ParameterError

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

T = 2.0
START = np.array([0.2, -1.0])


def sinusoids() -> SumOfSinusoids:
    return SumOfSinusoids(np.array([0.1, -0.5]), np.array([[0.5, 0.3], [0.4, -0.2]]),
                          np.array([[0.9, 2.1], [1.3, 3.7]]), np.array([[0.0, 1.0], [0.5, 4.0]]))


def slow() -> SumOfSinusoids:
    return SumOfSinusoids(np.array([0.3, -0.2]), np.array([[0.2], [0.9]]), np.full((2, 1), 0.4),
                          np.array([[1.0], [2.0]]))


REFERENCES = {'sinusoids': sinusoids(), 'smooth start': SmoothStart(sinusoids(), T, START),
              'crossfade': Crossfade(slow(), sinusoids(), 1.25, T),
              'crossfade of a smooth start': Crossfade(SmoothStart(sinusoids(), T, START), slow(),
                                                       0.7, 3.0)}


@pytest.mark.parametrize('reference', REFERENCES.values(), ids=REFERENCES)
def test_derivatives_equal_finite_differences(reference: Reference):
    step = 1e-6
    for t in np.linspace(0.01, 6.0, 83):
        point, before, after = (reference.at(t + s * step) for s in (0, -1, 1))
        np.testing.assert_allclose(point.velocity, (after.position - before.position) / (2 * step),
                                   atol=1e-7)
        np.testing.assert_allclose(point.acceleration,
                                   (after.velocity - before.velocity) / (2 * step), atol=1e-7)


class Line:
    """A reference of the user's, which knows one time at once."""

    def at(self, t):
        return ReferencePoint(np.array([t, -t]), np.array([1.0, -1.0]), np.zeros(2))

    def range(self):
        return np.full(2, -9.0), np.full(2, 9.0)


@pytest.mark.parametrize('reference', [*REFERENCES.values(), Line(), Posture(START)],
                         ids=[*REFERENCES, 'line', 'posture'])
def test_many_times_at_once_give_the_bits_of_one_after_the_other(reference: Reference):
    times = np.concatenate([[0.0, 0.7, 1.25, T], np.linspace(0.0, 6.0, 61)])
    rows = along(reference, np.sort(times))
    for k, t in enumerate(np.sort(times)):
        np.testing.assert_array_equal([row[k] for row in rows], reference.at(float(t)))
    assert all(row.flags.c_contiguous and row.flags.writeable for row in rows)


@pytest.mark.parametrize('reference', REFERENCES.values(), ids=REFERENCES)
@hypothesis.given(t=st.floats(0.0, 1e4))
def test_range_is_never_left(reference: Reference, t):
    lower, upper = reference.range()
    position = reference.at(t).position
    assert np.all(position >= lower - 1e-12)
    assert np.all(position <= upper + 1e-12)


def test_range_is_reached_by_one_sinusoid():
    reference = SumOfSinusoids(np.array([0.5]), np.array([[-2.0]]), np.array([[1.0]]),
                               np.array([[0.0]]))
    assert [end[0] for end in reference.range()] == [-1.5, 2.5]
    assert reference.at(np.pi / 2).position[0] == pytest.approx(-1.5)
    assert reference.at(-np.pi / 2).position[0] == pytest.approx(2.5)


def test_the_papers_reference_is_a_sine_and_a_cosine():
    reference = SumOfSinusoids(np.zeros(2), np.array([[1.0], [2.0]]), np.full((2, 1), 0.5),
                               np.array([[0.0], [np.pi / 2]]))
    for t in (0.0, 1.0, 17.3):
        np.testing.assert_allclose(reference.at(t).position,
                                   [np.sin(0.5 * t), 2 * np.cos(0.5 * t)], atol=1e-14)


def test_smooth_start_begins_at_rest_in_the_start_posture():
    point = SmoothStart(sinusoids(), T, START).at(0.0)
    np.testing.assert_array_equal(point.position, START)
    np.testing.assert_array_equal(point.velocity, np.zeros(2))
    np.testing.assert_array_equal(point.acceleration, np.zeros(2))


def test_smooth_start_joins_the_reference_with_two_derivatives():
    smooth, reference = SmoothStart(sinusoids(), T, START), sinusoids()
    np.testing.assert_allclose(smooth.at(T * (1 - 1e-9)), reference.at(T), atol=1e-7)
    np.testing.assert_array_equal(smooth.at(T), reference.at(T))
    np.testing.assert_array_equal(smooth.at(7.7), reference.at(7.7))


def test_before_the_start_the_posture_is_held():
    point = SmoothStart(sinusoids(), T, START).at(-1.0)
    np.testing.assert_array_equal(point.position, START)
    np.testing.assert_array_equal(point.velocity, np.zeros(2))


def test_range_of_a_smooth_start_contains_the_start_posture_and_the_reference():
    lower, upper = SmoothStart(sinusoids(), T, np.array([-5.0, 5.0])).range()
    low, high = sinusoids().range()
    np.testing.assert_array_equal(lower, [-5.0, low[1]])
    np.testing.assert_array_equal(upper, [high[0], 5.0])


def test_smooth_start_keeps_its_own_posture():
    start = START.copy()
    smooth = SmoothStart(sinusoids(), T, start)
    start[:] = 9.0
    np.testing.assert_array_equal(smooth.at(0.0).position, START)


@pytest.mark.parametrize('duration', [0.0, -1.0, 1e-175, float('nan'), float('inf')])
def test_a_blend_needs_time(duration):
    with pytest.raises(ParameterError, match='smooth_start'):
        SmoothStart(sinusoids(), duration, START)


@pytest.mark.parametrize('wrong', ['frequency', 'phase'])
def test_a_wrong_shape_is_named(wrong):
    arrays = {name: np.ones((2, 3)) for name in ('amplitude', 'frequency', 'phase')}
    arrays[wrong] = np.ones((2, 2))
    with pytest.raises(ParameterError, match=rf'reference\.{wrong}.*\(2, 3\)'):
        SumOfSinusoids(np.zeros(2), **arrays)


def test_a_smooth_start_has_the_bits_of_its_formula():
    smooth, reference = SmoothStart(sinusoids(), T, START), sinusoids()
    for t in np.linspace(0.0, 3.0, 301):
        y, yd, ydd = reference.at(t)
        x, z = t / T, y - START
        s = x * x * x * (10.0 + x * (6.0 * x - 15.0))
        sd = 30.0 * x * x * (x * (x - 2.0) + 1.0) / T
        sdd = 60.0 * x * (x * (2.0 * x - 3.0) + 1.0) / (T * T)
        expected = (START + s * z, sd * z + s * yd, sdd * z + 2.0 * sd * yd + s * ydd)
        np.testing.assert_array_equal(smooth.at(t), expected if t < T else (y, yd, ydd))


def test_a_crossfade_leaves_one_reference_and_joins_the_other_with_two_derivatives():
    fade, before, after = Crossfade(slow(), sinusoids(), 1.25, T), slow(), sinusoids()
    for t in (0.0, 1.25):
        np.testing.assert_array_equal(fade.at(t), before.at(t))
    np.testing.assert_allclose(fade.at(1.25 + 1e-9), before.at(1.25), atol=1e-7)
    np.testing.assert_allclose(fade.at(1.25 + T - 1e-9), after.at(1.25 + T), atol=1e-7)
    for t in (1.25 + T, 9.9):
        np.testing.assert_array_equal(fade.at(t), after.at(t))


@pytest.mark.parametrize('reference', REFERENCES.values(), ids=REFERENCES)
@pytest.mark.parametrize('now', [0.0, 0.5, 1.0, 2.0, 2.5, 3.5, 4.0])
def test_what_is_settled_equals_the_reference_from_then_on(reference: Reference, now):
    rest = from_time(reference, now)
    for t in np.linspace(now, 6.0, 41):
        np.testing.assert_array_equal(rest.at(t), reference.at(t))


def test_a_crossfade_that_is_over_keeps_no_old_reference_alive():
    reference: Reference = SmoothStart(sinusoids(), T, START)
    for k in range(1000):
        after = SumOfSinusoids(np.array([0.1, 0.01 * k]), np.ones((2, 1)), np.ones((2, 1)),
                               np.ones((2, 1)))
        reference = Crossfade(from_time(reference, 3.0 * k), after, 3.0 * k, T)
        if k:
            assert isinstance(reference.before, SumOfSinusoids)
    assert from_time(reference, 3.0 * k + T) is after


def test_no_more_changes_than_can_be_followed_are_under_way_at_once():
    reference: Reference = sinusoids()
    for k in range(DEEPEST):
        reference = Crossfade(from_time(reference, 0.01 * k), sinusoids(), 0.01 * k, T)
    reference.at(1.0)
    with pytest.raises(ParameterError, match=f'{DEEPEST + 1} changes within their blend time'):
        Crossfade(from_time(reference, 1.0), sinusoids(), 1.0, T)


def test_full_range_leaves_out_only_the_posture_of_a_smooth_start():
    far = np.array([-5.0, 5.0])
    start = SmoothStart(sinusoids(), T, far)
    np.testing.assert_array_equal(full_range(start), sinusoids().range())
    low, high = full_range(Crossfade(start, slow(), 1.0, T))
    expected = [sinusoids().range(), slow().range()]
    np.testing.assert_array_equal(low, np.min([lower for lower, _ in expected], axis=0))
    np.testing.assert_array_equal(high, np.max([upper for _, upper in expected], axis=0))
    np.testing.assert_array_equal(full_range(Posture(far)), [far, far])


@pytest.mark.parametrize('duration', [0.0, -1.0, 1e-175, float('nan'), float('inf')])
def test_a_crossfade_needs_time(duration):
    with pytest.raises(ParameterError, match='blend_time'):
        Crossfade(slow(), sinusoids(), 1.0, duration)
