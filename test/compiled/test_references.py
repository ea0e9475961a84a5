# SPDX-License-Identifier: Apache-2.0
"""Facts about arrays in tuples that a compiled function borrows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from adaptive_blf_control.compiled import borrowed, COMPILED, Handle, handle, jit


class Box(NamedTuple):
    """An array in a tuple, as the steps take them."""

    values: np.ndarray


@jit
def _sum_and_count_up(box: Box) -> float:
    box = borrowed(box)
    total = 0.0
    for _ in range(3):
        total += box.values[0]
        box.values[0] += 1.0
    return total


def test_borrowed_arrays_are_the_same_arrays():
    box = Box(np.zeros(2))
    assert _sum_and_count_up(box) == 3.0
    assert box.values.tolist() == [3.0, 0.0]
    assert borrowed(box) is box  # in Python it is what is given


class Inner(NamedTuple):
    """A tuple in a tuple."""

    column: np.ndarray
    count: int
    up: bool


class Outer(NamedTuple):
    """One field of each kind that the steps have."""

    scale: float
    inner: Inner
    random: np.random.Generator
    matrix: np.ndarray


@jit
def _of_inner(inner: Inner) -> float:
    inner = borrowed(inner)
    return inner.column[1] * inner.count + (1.0 if inner.up else 0.0)


@jit
def _of_outer(outer: Outer) -> float:
    outer = borrowed(outer)
    outer.matrix[0, 1] += outer.scale
    return _of_inner(outer.inner) + outer.scale * outer.random.standard_normal()


@jit
def _of_handle(held: Handle) -> float:
    return _of_outer(held.value)


def _outer() -> Outer:
    matrix = np.zeros((3, 4))[:, ::2]  # a view whose rows are not next to each other
    return Outer(0.5, Inner(np.arange(6.0)[::2], -3, True), np.random.default_rng(1), matrix)


def test_every_kind_of_field_is_read_through_a_reference():
    random, given, held = np.random.default_rng(1), _outer(), _outer()
    opened = handle(held)
    for k in range(3):
        expected = 2.0 * -3 + 1.0 + 0.5 * random.standard_normal()
        assert _of_outer(given) == expected
        assert _of_handle(opened) == expected
        assert given.matrix[0].tolist() == held.matrix[0].tolist() == [0.0, 0.5 * (k + 1)]


class Odd(NamedTuple):
    """A field between two that every reference can point to."""

    first: float
    odd: Any
    last: float


@pytest.mark.skipif(not COMPILED, reason='references are for compiled functions')
@pytest.mark.parametrize('odd', [(1.0, 2.0), 1j, None, 'text', np.float32(1.0)])
def test_a_field_that_a_reference_cannot_point_to_is_refused_not_read_from_the_wrong_place(odd):
    for value in Odd(1.0, odd, 3.0), Outer(1.0, Odd(1.0, odd, 3.0), None, np.zeros(1)):
        with pytest.raises(TypeError, match=r'^Odd.odd is of type .*: expected a float'):
            handle(value)
