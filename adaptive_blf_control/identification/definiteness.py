# SPDX-License-Identifier: Apache-2.0
"""A direction that sees little of a symmetric matrix, without eigenvalues.

Whether the smallest eigenvalue of A exceeds a bound b is asked more often than what it is. The
pivots of A − b I answer it, and one that is not positive gives a direction x with xᵀ A x ≤ b xᵀ x
(Sylvester's law of inertia; Golub and Van Loan, Matrix Computations (2013), 4.1 and 8.1.5).
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.compiled import add_multiple, borrowed, dot, jit
from adaptive_blf_control.identification.tridiagonal import Tridiagonal

__all__ = ['direction_below']


@jit
def direction_below(form: Tridiagonal, size: int, bound: float, x: np.ndarray) -> bool:
    """Set x, shape (m,), to a unit vector with xᵀ A x ≤ ``bound``, if there is one.

    A − bound I = L D Lᵀ up to the first pivot d_k that is not positive: of the x with Lᵀ x = e_k,
    xᵀ A x is bound xᵀ x + d_k.

    Args:
        form: Its ``matrix`` is A in the first ``size`` rows and columns, and remains so.
        size: Number of rows.
        bound: What the smallest eigenvalue of A is compared with.
        x: Is written where there is such a vector.

    Returns:
        Whether there is, to the rounding of A.
    """
    form = borrowed(form)
    matrix, diagonal = form.matrix, form.diagonal
    for i in range(size):
        diagonal[i] = matrix[i, i]
        matrix[i, i] -= bound
    last = -1
    for k in range(size):  # the upper triangle becomes D Lᵀ
        row, pivot = matrix[k], matrix[k, k]
        if not pivot > 0.0:
            last = k
            break
        for i in range(k + 1, size):
            add_multiple(matrix[i, i:], -row[i] / pivot, row[i:], size - i)
    if last >= 0:
        _substitute(matrix, last, x)
    for i in range(size):
        row = matrix[i]
        for j in range(i):
            matrix[j, i] = row[j]
        row[i] = diagonal[i]
    return last >= 0


@jit
def _substitute(upper: np.ndarray, last: int, x: np.ndarray) -> None:
    """Set x to the unit vector along that with Lᵀ x = e_last, of the upper triangle of D Lᵀ."""
    square = 1.0
    x[:] = 0.0
    x[last] = 1.0
    for i in range(last - 1, -1, -1):
        row = upper[i]
        x[i] = -dot(row[i + 1:], x[i + 1:], last - i) / row[i]
        square += x[i] * x[i]
    norm = 1.0 / math.sqrt(square)
    for i in range(last + 1):
        x[i] *= norm
