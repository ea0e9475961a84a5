# SPDX-License-Identifier: Apache-2.0
"""Products and inverses of small arrays in compiled functions, without BLAS and LAPACK.

numba's ``np.dot``, ``@`` and ``np.linalg`` go through scipy's BLAS and LAPACK. Loading them takes
a third of a second, in the control cycle of the first call, and a call takes longer than the few
multiplications of an arm.
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.compiled import dot, jit

__all__ = ['inverse', 'matrix_product', 'product']


@jit
def product(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return the product of a matrix, shape (n, m), and a vector, shape (m,): shape (n,)."""
    rows, columns = matrix.shape
    result = np.empty(rows)
    whole = rows - rows % 4
    for i in range(0, whole, 4):  # four sums at a time, which do not wait for each other
        a, b, c, d = 0.0, 0.0, 0.0, 0.0
        for j in range(columns):
            factor = vector[j]
            a += matrix[i, j] * factor
            b += matrix[i + 1, j] * factor
            c += matrix[i + 2, j] * factor
            d += matrix[i + 3, j] * factor
        result[i], result[i + 1], result[i + 2], result[i + 3] = a, b, c, d
    for i in range(whole, rows):
        total = 0.0
        for j in range(columns):
            total += matrix[i, j] * vector[j]
        result[i] = total
    return result


@jit
def matrix_product(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the product of two matrices, shapes (n, k) and (k, m): shape (n, m)."""
    rows, inner = left.shape
    columns = right.shape[1]
    result = np.zeros((rows, columns))
    for i in range(rows):
        for k in range(inner):
            factor = left[i, k]
            for j in range(columns):
                result[i, j] += factor * right[k, j]
    return result


@jit
def inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a symmetric positive definite matrix, shape (n, n), by Cholesky.

    Only its lower triangle is read. It is finite where the matrix is singular, too, and of no use.
    """
    n = matrix.shape[0]
    factor, result = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            value = matrix[i, j] - dot(factor[i], factor[j], j)
            factor[i, j] = math.sqrt(max(value, 1e-300)) if i == j else value / factor[j, j]
    for c in range(n):  # columns of L⁻¹, in the rows of `result`
        for i in range(c, n):
            value = 1.0 if i == c else -dot(factor[i, c:], result[c, c:], i - c)
            result[c, i] = value / factor[i, i]
    inverted = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            value = dot(result[i, i:], result[j, i:], n - i)
            inverted[i, j] = inverted[j, i] = value
    return inverted
