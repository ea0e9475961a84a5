# SPDX-License-Identifier: Apache-2.0
"""Sums of YᵀY and what a direction sees of them, in loops over arrays that are there already."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import add_four, add_multiple, dot, jit

__all__ = ['add_lower_square', 'add_square', 'assign', 'energy', 'project', 'seen_square']


@jit
def assign(target: np.ndarray, source: np.ndarray) -> None:
    """Copy a matrix into another one of its shape."""
    for i in range(source.shape[0]):
        row, new = target[i], source[i]
        for j in range(source.shape[1]):
            row[j] = new[j]


@jit
def add_square(matrix: np.ndarray, rows: np.ndarray, count: int, sign: float) -> None:
    """Add ± YᵀY of the first ``count`` rows of Y, shape (·, m), to a symmetric matrix, (m, m)."""
    add_lower_square(matrix, rows, count, sign)
    for i in range(matrix.shape[0]):
        row = matrix[i]
        for j in range(i):
            matrix[j, i] = row[j]


@jit
def add_lower_square(matrix: np.ndarray, rows: np.ndarray, count: int, weight: float) -> None:
    """Add ``weight`` times YᵀY, as `add_square`, to the lower triangle of a matrix alone."""
    m = matrix.shape[0]
    whole = count - count % 4
    for k in range(0, whole, 4):
        y0, y1, y2, y3 = rows[k], rows[k + 1], rows[k + 2], rows[k + 3]
        for i in range(m):
            add_four(matrix[i], weight * y0[i], y0, weight * y1[i], y1, weight * y2[i], y2,
                     weight * y3[i], y3, i + 1)
    for k in range(whole, count):
        y0 = rows[k]
        for i in range(m):
            add_multiple(matrix[i], weight * y0[i], y0, i + 1)


@jit
def energy(matrix: np.ndarray, x: np.ndarray, size: int) -> float:
    """Return xᵀ A x for the first ``size`` rows and columns of A."""
    total = 0.0
    for i in range(size):
        total += x[i] * dot(matrix[i], x, size)
    return total


@jit
def seen_square(regressor: np.ndarray, x: np.ndarray, size: int) -> float:
    """Return ‖Y x‖² for the first ``size`` columns of Y."""
    total = 0.0
    for k in range(regressor.shape[0]):
        y = dot(regressor[k], x, size)
        total += y * y
    return total


@jit
def project(regressor: np.ndarray, basis: np.ndarray, count: int, result: np.ndarray) -> None:
    """Set the first ``count`` columns of ``result``, shape (n, K), to those of Y Wᵀ."""
    for k in range(regressor.shape[0]):
        for i in range(count):
            result[k, i] = dot(regressor[k], basis[i], basis.shape[1])
