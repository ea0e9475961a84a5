# SPDX-License-Identifier: Apache-2.0
"""Facts about the products and inverses of compiled functions."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.linear_algebra import inverse, matrix_product, product


@pytest.mark.parametrize(('rows', 'columns'), [(1, 1), (3, 2), (4, 5), (7, 50), (9, 10)])
def test_products_are_those_of_numpy_whatever_the_shape(rows, columns):
    random = np.random.default_rng(rows)
    left, right = random.normal(size=(rows, columns)), random.normal(size=(columns, rows))
    np.testing.assert_allclose(product(left, right[:, 0]), left @ right[:, 0], rtol=1e-12,
                               atol=1e-12)
    np.testing.assert_allclose(product(right.T, left[0]), right.T @ left[0], atol=1e-12)
    np.testing.assert_allclose(matrix_product(left, right), left @ right, atol=1e-12)


@pytest.mark.parametrize('n', [1, 2, 10, 50])
def test_the_inverse_is_that_of_a_positive_definite_matrix_by_its_lower_triangle(n):
    root = np.random.default_rng(n).normal(size=(n, n + 3))
    matrix = root @ root.T + np.eye(n)
    np.testing.assert_allclose(inverse(np.tril(matrix)) @ matrix, np.eye(n), atol=1e-10)


def test_the_inverse_of_a_singular_matrix_is_finite():
    assert np.isfinite(inverse(np.zeros((3, 3)))).all()
