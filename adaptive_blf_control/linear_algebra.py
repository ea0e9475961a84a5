# SPDX-License-Identifier: Apache-2.0
"""Products of small arrays in compiled functions, without BLAS.

numba's ``np.dot`` and ``@`` go through scipy's BLAS. Loading that takes a third of a second, and a
call of it more than the few multiplications of an arm.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import COMPILED, jit

__all__ = ['dot', 'load_lapack', 'product']


@jit
def dot(a: np.ndarray, b: np.ndarray) -> float:
    """Return the inner product of two vectors of one length."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * b[i]
    return total


@jit
def product(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return the product of a matrix, shape (n, m), and a vector, shape (m,): shape (n,)."""
    rows, columns = matrix.shape
    result = np.zeros(rows)
    for i in range(rows):
        for j in range(columns):
            result[i] += matrix[i, j] * vector[j]
    return result


def load_lapack() -> None:
    """Load what numba's ``np.linalg`` calls; otherwise its first call does, in a control cycle."""
    if COMPILED:
        import scipy.linalg  # noqa: F401
