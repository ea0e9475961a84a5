# SPDX-License-Identifier: Apache-2.0
"""Facts about the tridiagonal form: eigenvalues, rank and axes are those of LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.identification.tridiagonal import (
    count_up_to,
    eigenvector,
    largest_eigenvalue,
    reduce,
    smallest_eigenvalue,
    Tridiagonal,
    tridiagonal,
    turned_axes,
)

EPS = np.finfo(float).eps
RANDOM = np.random.default_rng(31)


def scaled(m: int) -> np.ndarray:
    """Eigenvalues over eight decades."""
    return RANDOM.normal(size=(2 * m, m)) * 10.0 ** RANDOM.uniform(-3.0, 1.0, m)


MATRICES = {
    'one element': RANDOM.normal(size=(3, 1)),
    'well conditioned': RANDOM.normal(size=(90, 30)),
    'scaled': scaled(50),
    'deficient': RANDOM.normal(size=(9, 20)),
    'integers': RANDOM.integers(-2, 3, size=(12, 15)).astype(float),
    'columns of zeros': RANDOM.normal(size=(30, 12)) * (np.arange(12) % 3 > 0),
    'diagonal': np.diag(np.arange(8.0)),
    'repeated eigenvalues': np.eye(9),
    'zero': np.zeros((4, 6)),
}


def square(rows: np.ndarray) -> np.ndarray:
    return rows.T @ rows


def reduced(matrix: np.ndarray) -> Tridiagonal:
    form = tridiagonal(len(matrix))
    form.matrix[:] = matrix
    reduce(form, len(matrix))
    return form


@pytest.fixture(params=MATRICES.values(), ids=MATRICES)
def matrix(request):
    return square(request.param)


def rounding(matrix: np.ndarray) -> float:
    return 8.0 * EPS * max(float(np.trace(matrix)), 1e-290)


def test_the_form_is_the_matrix_in_orthonormal_axes(matrix):
    form, m = reduced(matrix), len(matrix)
    axes = np.empty((m, m))
    turned_axes(form, axes)
    tri = np.diag(form.diagonal) + np.diag(form.off[1:], 1) + np.diag(form.off[1:], -1)
    np.testing.assert_allclose(axes.T @ axes, np.eye(m), atol=50.0 * EPS)
    np.testing.assert_allclose(axes @ tri @ axes.T, matrix, atol=rounding(matrix))


def test_smallest_and_largest_eigenvalue_are_those_of_lapack(matrix):
    form, values = reduced(matrix), np.linalg.eigvalsh(matrix)
    assert smallest_eigenvalue(form, len(matrix)) == pytest.approx(values[0], rel=0.0,
                                                                   abs=rounding(matrix))
    assert largest_eigenvalue(form, len(matrix)) == pytest.approx(values[-1], rel=0.0,
                                                                  abs=rounding(matrix))


def test_eigenvector_is_one_of_the_smallest_eigenvalue(matrix):
    form, m = reduced(matrix), len(matrix)
    value, x = smallest_eigenvalue(form, m), np.zeros(m)
    eigenvector(form, m, value, x)
    assert np.linalg.norm(x) == pytest.approx(1.0)
    np.testing.assert_allclose(matrix @ x, value * x, atol=10.0 * rounding(matrix))


def test_count_is_that_of_the_eigenvalues_up_to_the_bound(matrix):
    form, values = reduced(matrix), np.linalg.eigvalsh(matrix)
    for bound in (-1.0, *(0.5 * (values[1:] + values[:-1])), values[-1] + 1.0):
        if np.abs(values - bound).min() > rounding(matrix):
            assert count_up_to(form, len(matrix), bound) == np.count_nonzero(values <= bound)


def test_an_eigenvalue_of_zero_is_not_above_zero():
    assert count_up_to(reduced(np.zeros((3, 3))), 3, 0.0) == 3
    assert count_up_to(reduced(np.diag([0.0, 2.0, 0.0])), 3, 0.0) == 2


def test_the_first_rows_and_columns_can_be_reduced_by_themselves():
    matrix, form = square(RANDOM.normal(size=(30, 12))), tridiagonal(12)
    form.matrix[:5, :5] = matrix[:5, :5]
    reduce(form, 5)
    x = np.zeros(12)
    value = smallest_eigenvalue(form, 5)
    eigenvector(form, 5, value, x)
    assert value == pytest.approx(np.linalg.eigvalsh(matrix[:5, :5])[0])
    np.testing.assert_allclose(matrix[:5, :5] @ x[:5], value * x[:5], atol=1e-12)
