# SPDX-License-Identifier: Apache-2.0
"""Sums of YᵀY and what a direction sees of them, in loops over arrays that are there already."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import jit

__all__ = ['add_square', 'dot', 'energy', 'project', 'seen_square']


@jit
def dot(x: np.ndarray, y: np.ndarray, size: int) -> float:
    """Return Σ x_i y_i over the first ``size`` elements."""
    total = 0.0
    for i in range(size):
        total += x[i] * y[i]
    return total


@jit
def add_square(matrix: np.ndarray, regressor: np.ndarray, sign: float) -> None:
    """Add ± YᵀY of a regressor, shape (n, m), to a matrix, shape (m, m)."""
    n, m = regressor.shape
    for k in range(n):
        y = regressor[k]
        for i in range(m):
            row, weight = matrix[i], sign * y[i]
            for j in range(m):
                row[j] += weight * y[j]


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
