# SPDX-License-Identifier: Apache-2.0
"""Sums of YᵀY and what a direction sees of them, in loops over arrays that are there already."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import dot, jit

__all__ = ['add_lower_square', 'add_square', 'assign', 'combine_rows', 'energy', 'project',
           'seen_square']


@jit
def assign(target: np.ndarray, source: np.ndarray) -> None:
    """Copy a matrix into another one of its shape."""
    for i in range(source.shape[0]):
        row, new = target[i], source[i]
        for j in range(source.shape[1]):
            row[j] = new[j]


@jit
def combine_rows(matrix: np.ndarray, x: np.ndarray, size: int, result: np.ndarray) -> None:
    """Set ``result`` to Aᵀ x for the first ``size`` rows and columns of A, four rows at a time."""
    for k in range(size):
        result[k] = 0.0
    for i in range(size // 4):
        i = 4 * i
        a, b, c, d = matrix[i], matrix[i + 1], matrix[i + 2], matrix[i + 3]
        x0, x1, x2, x3 = x[i], x[i + 1], x[i + 2], x[i + 3]
        for k in range(size):
            result[k] += (x0 * a[k] + x1 * b[k]) + (x2 * c[k] + x3 * d[k])
    for i in range(size - size % 4, size):
        a, x0 = matrix[i], x[i]
        for k in range(size):
            result[k] += x0 * a[k]


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
            row, a, b = matrix[i], weight * y0[i], weight * y1[i]
            c, d = weight * y2[i], weight * y3[i]
            for j in range(i + 1):
                row[j] += (a * y0[j] + b * y1[j]) + (c * y2[j] + d * y3[j])
    for k in range(whole, count):
        y0 = rows[k]
        for i in range(m):
            row, a = matrix[i], weight * y0[i]
            for j in range(i + 1):
                row[j] += a * y0[j]


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
