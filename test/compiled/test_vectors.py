# SPDX-License-Identifier: Apache-2.0
"""Facts about sums and products of vectors in lanes."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.compiled import (
    add_four,
    add_multiple,
    combine_rows,
    COMPILED,
    dot,
    fold_row,
    jit,
    uncompiled,
)


@jit
def _compiled(x: np.ndarray, y: np.ndarray, size: int) -> float:
    return dot(x, y, size)


@jit
def _add_multiple(target: np.ndarray, factor: float, x: np.ndarray, size: int) -> None:
    add_multiple(target, factor, x, size)


@jit
def _fold_row(row: np.ndarray, a: float, w: np.ndarray, b: float, v: np.ndarray,
              total: np.ndarray, c: float, size: int) -> None:
    fold_row(row, a, w, b, v, total, c, size)


@jit
def _add_four(target: np.ndarray, rows: np.ndarray, factors: np.ndarray, size: int) -> None:
    add_four(target, factors[0], rows[0], factors[1], rows[1], factors[2], rows[2], factors[3],
             rows[3], size)


@jit
def _combine_rows(result: np.ndarray, matrix: np.ndarray, x: np.ndarray, size: int) -> None:
    combine_rows(result, matrix, x, size)


@pytest.mark.parametrize('size', [0, 1, 3, 4, 5, 7, 8, 11, 12, 15, 16, 50])
def test_the_first_elements_are_multiplied_and_added_up(size):
    x, y = np.random.default_rng(size).normal(size=(2, 53))
    expected = float(x[:size] @ y[:size])
    assert dot(x, y, size) == pytest.approx(expected, rel=1e-12, abs=1e-12)
    assert _compiled(x, y, size) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize('size', [1, 4, 5, 8, 12, 15, 20, 31, 50])
def test_a_sum_has_the_same_bits_compiled_and_in_python(size):
    x, y = np.random.default_rng(size).normal(size=(2, size)) * 10.0 ** np.arange(size).clip(0, 9)
    assert _compiled(x, y, size) == dot(x, y, size)


@pytest.mark.skipif(not COMPILED, reason='plain numpy takes any array')
def test_vectors_with_gaps_are_refused_while_it_is_compiled():
    with pytest.raises(Exception, match='dot'):
        _compiled(np.zeros(8)[::2], np.zeros(4), 4)


@pytest.mark.parametrize('size', [0, 1, 3, 4, 7, 8, 13, 50])
def test_the_first_elements_change_as_in_numpy_and_no_others(size):
    random = np.random.default_rng(size)
    row, w, v, total = random.normal(size=(4, 53))
    for add, fold in ((add_multiple, fold_row), (_add_multiple, _fold_row)):
        target, folded, sums = row.copy(), row.copy(), total.copy()
        add(target, 0.3, w, size)
        np.testing.assert_array_equal(target[:size], row[:size] + 0.3 * w[:size])
        fold(folded, 0.3, w, -0.7, v, sums, 1.9, size)
        expected = row[:size] - (0.3 * w[:size] + -0.7 * v[:size])
        np.testing.assert_array_equal(folded[:size], expected)
        np.testing.assert_array_equal(sums[:size], total[:size] + 1.9 * expected)
        for changed, before in ((target, row), (folded, row), (sums, total)):
            np.testing.assert_array_equal(changed[size:], before[size:])


@pytest.mark.parametrize('size', [0, 1, 2, 3, 4, 7, 8, 13, 16, 17, 29, 50])
def test_rows_are_combined_with_the_same_bits_compiled_and_in_python(size):
    random = np.random.default_rng(size)
    matrix, (x, before) = random.normal(size=(53, 53)), random.normal(size=(2, 53))
    compiled, plain = before.copy(), before.copy()
    _combine_rows(compiled, matrix, x, size)
    combine_rows(plain, matrix, x, size)
    np.testing.assert_array_equal(compiled, plain)
    np.testing.assert_array_equal(compiled[size:], before[size:])
    np.testing.assert_allclose(compiled[:size], matrix[:size, :size].T @ x[:size], rtol=1e-12,
                               atol=1e-12)


@pytest.mark.parametrize('size', [0, 1, 4, 7, 8, 13, 50])
def test_four_multiples_are_added_as_in_numpy_and_to_no_other_elements(size):
    random = np.random.default_rng(size)
    rows, target, factors = random.normal(size=(4, 53)), random.normal(size=53), random.normal(
        size=4)
    compiled, plain = target.copy(), target.copy()
    _add_four(compiled, rows, factors, size)
    uncompiled(_add_four)(plain, rows, factors, size)
    np.testing.assert_array_equal(compiled, plain)
    np.testing.assert_array_equal(compiled[size:], target[size:])
    np.testing.assert_allclose(compiled[:size], (target + factors @ rows)[:size], rtol=1e-12)


@pytest.mark.skipif(not COMPILED, reason='plain numpy takes any array')
def test_a_matrix_whose_rows_have_gaps_is_refused_while_it_is_compiled():
    with pytest.raises(Exception, match='combine_rows'):
        _combine_rows(np.zeros(4), np.zeros((4, 8))[:, ::2], np.zeros(4), 4)
