# SPDX-License-Identifier: Apache-2.0
"""Facts about the direction that sees no more of a matrix than a bound."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.identification.definiteness import direction_below
from adaptive_blf_control.identification.tridiagonal import Tridiagonal, tridiagonal

SIZES = (1, 2, 5, 20, 50)


def form_of(matrix: np.ndarray) -> Tridiagonal:
    """Room that holds a matrix."""
    form = tridiagonal(len(matrix))
    form.matrix[:] = matrix
    return form


def symmetric(m: int) -> np.ndarray:
    """Eigenvalues over some decades, as those of a history stack."""
    rows = np.random.default_rng(m).normal(size=(2 * m + 3, m)) * np.logspace(-2.0, 1.0, m)
    result: np.ndarray = rows.T @ rows
    return result


@pytest.mark.parametrize('m', SIZES)
@pytest.mark.parametrize('factor', [1.0 + 1e-9, 1.5, 40.0])
def test_above_the_smallest_eigenvalue_there_is_a_direction_that_sees_less(m, factor):
    matrix = symmetric(m)
    bound, x = factor * np.linalg.eigvalsh(matrix)[0], np.full(m, np.nan)
    assert direction_below(form_of(matrix), m, bound, x)
    assert np.linalg.norm(x) == pytest.approx(1.0)
    assert x @ matrix @ x <= bound + 1e-13 * np.trace(matrix)


@pytest.mark.parametrize('m', SIZES)
def test_below_the_smallest_eigenvalue_there_is_none(m):
    matrix = symmetric(m)
    smallest = np.linalg.eigvalsh(matrix)[0]
    for bound in (0.0, 0.5 * smallest, (1.0 - 1e-9) * smallest):
        assert not direction_below(form_of(matrix), m, bound, np.zeros(m))


def test_the_matrix_remains_and_what_is_behind_it_is_not_looked_at():
    matrix = symmetric(20)
    form, x = form_of(matrix), np.full(20, np.nan)
    assert direction_below(form, 7, 2.0 * np.linalg.eigvalsh(matrix[:7, :7])[0], x)
    assert np.array_equal(form.matrix, matrix)
    assert np.linalg.norm(x[:7]) == pytest.approx(1.0)
    assert not x[7:].any()
    assert not direction_below(form, 7, 0.0, x)
    assert np.array_equal(form.matrix, matrix)


@pytest.mark.parametrize('matrix', [np.zeros((4, 4)), np.diag([2.0, 0.0, 1.0])])
def test_a_singular_matrix_has_a_direction_that_sees_nothing(matrix):
    x = np.zeros(len(matrix))
    assert direction_below(form_of(matrix), len(matrix), 0.0, x)
    assert x @ matrix @ x == 0.0
