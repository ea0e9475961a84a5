# SPDX-License-Identifier: Apache-2.0
"""Facts about arrays that only one call of a compiled function needs."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.compiled import COMPILED, jit, local_zeros


@jit
def _fill(matrix: np.ndarray, value: float) -> float:
    """Add to every element, and return the sum of all."""
    total = 0.0
    for i in range(matrix.shape[0]):
        row = matrix[i]
        for j in range(row.size):
            row[j] += value
            total += row[j]
    return total


@jit
def _sum_of_a_new_one(rows: int, columns: int, value: float) -> float:
    matrix, vector = local_zeros((rows, columns)), local_zeros(columns)
    _fill(matrix, value)
    for j in range(vector.size):
        vector[j] += value
    return _fill(matrix, 0.0) + vector.sum()


@jit
def _wrong_sums(rows: int, columns: int, calls: int) -> int:
    """Return after how many calls the sum is not that of zeros to which the call was added."""
    wrong = 0
    for call in range(calls):
        if _sum_of_a_new_one(rows, columns, 1.0 + call) != (1.0 + call) * (rows + 1) * columns:
            wrong += 1
    return wrong


@jit
def _has_its_columns(rows: int, columns: int) -> bool:
    """Write column by column, and return whether every element is where it was written."""
    matrix, right = local_zeros((rows, columns)), True
    for j in range(columns):
        column = matrix[:, j]
        for i in range(rows):
            column[i] = 10.0 * i + j
    for i in range(rows):
        for j in range(columns):
            right = right and matrix[i, j] == 10.0 * i + j
    return right


@jit
def _shape(rows: int, columns: int) -> tuple[int, int, int, int]:
    cube = local_zeros((rows, columns, 3))
    return cube.shape[0], cube.shape[1], cube.shape[2], cube.size


@pytest.mark.parametrize('shape', [(7, 12), (1, 1), (3, 0), (6, 43)])
def test_it_is_of_zeros_of_the_shape_that_was_asked_for(shape):
    rows, columns = shape
    assert _sum_of_a_new_one(rows, columns, 2.0) == 2.0 * (rows * columns + columns)
    assert _shape(rows, columns) == (rows, columns, 3, 3 * rows * columns)


def test_its_columns_are_views_of_it():
    assert _has_its_columns(7, 3)


def test_each_call_gets_zeros_again_and_gives_its_room_back():
    # 200 000 times 4 kB would not fit on any stack.
    calls = 200_000 if COMPILED else 100
    assert _wrong_sums(10, 50, calls) == 0


@pytest.mark.skipif(not COMPILED, reason='numpy refuses it in its own words')
def test_a_shape_that_is_no_number_is_refused_while_it_is_compiled():
    @jit
    def of_a_float(rows: float) -> float:
        return local_zeros(rows).sum()  # type: ignore[arg-type,no-any-return]

    with pytest.raises(Exception, match='local_zeros'):
        of_a_float(2.0)
