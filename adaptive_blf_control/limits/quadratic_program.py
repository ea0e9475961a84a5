# SPDX-License-Identifier: Apache-2.0
"""A small strictly convex quadratic program with hard and soft rows, solved by its dual.

    min  ½ (x − x0)ᵀ H (x − x0) + ½ Σ s_i² / w_i   subject to  C x + s ≥ b,  s_i = 0 where w_i = 0

is solved by the dual active-set method of Goldfarb and Idnani (Mathematical Programming 27, 1983).
It starts from the unconstrained minimum x0, so that nothing is computed where no row is violated,
needs no feasible start, and finds out where there is no feasible point. A soft row differs from a
hard one by w_i on the diagonal of the dual's matrix S = C_A H⁻¹ C_Aᵀ + diag(w), A the active rows.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import jit

__all__ = ['INFEASIBLE', 'MOST_STEPS', 'UNFINISHED', 'solve']

INFEASIBLE = -1
UNFINISHED = -2
MOST_STEPS = 200
TOLERANCE = 1e-10  # violation of a row of length 1 that counts as none, relative to its terms
DEPENDENT = 1e-11  # part of a row's length that is left outside of the active rows' span


@jit
def solve(inverse: np.ndarray, x0: np.ndarray, rows: np.ndarray, bounds: np.ndarray,
          softness: np.ndarray, multipliers: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the solution and the number of steps, or INFEASIBLE or UNFINISHED instead of it.

    Args:
        inverse: H⁻¹, symmetric and positive definite, shape (n, n).
        x0: Minimum without rows, shape (n,).
        rows: C, shape (k, n).
        bounds: b, shape (k,).
        softness: w, shape (k,); 0 for a hard row, the larger the softer.
        multipliers: Shape (k,); the multiplier of each row is written into it, 0 where inactive.
    """
    k, n = rows.shape
    x = x0.copy()
    most = n + k
    active = np.empty(most, np.int64)
    factor = np.zeros((most, most))  # Cholesky factor of S, rows of it in the order of `active`
    multipliers[:] = 0.0
    is_active = np.zeros(k, np.bool_)
    count = 0
    for step in range(MOST_STEPS):
        row = _most_violated(x, rows, bounds, softness, multipliers, is_active)
        if row < 0:
            return x, step
        reached = False
        while not reached:
            direction, change, curvature, full = _direction(inverse, rows, softness, active, count,
                                                            factor, row)
            partial, blocking = np.inf, -1
            for i in range(count):
                if change[i] > 0.0 and multipliers[active[i]] < partial * change[i]:
                    partial = multipliers[active[i]] / change[i]
                    blocking = i
            length = np.inf
            if curvature > DEPENDENT * full:
                length = max(-_slack(x, rows, bounds, softness, multipliers, row), 0.0) / curvature
            taken = min(length, partial)
            if taken == np.inf:
                return x, INFEASIBLE
            for i in range(count):
                multipliers[active[i]] = max(multipliers[active[i]] - taken * change[i], 0.0)
            multipliers[row] += taken
            if length < np.inf:
                for i in range(n):
                    x[i] += taken * direction[i]
            reached = length <= partial
            if reached:
                _append(inverse, rows, softness, active, count, factor, row)
                count += 1
                is_active[row] = True
            else:
                is_active[active[blocking]] = False
                multipliers[active[blocking]] = 0.0
                count = _remove(inverse, rows, softness, active, count, factor, blocking)
    return x, UNFINISHED


@jit
def _slack(x: np.ndarray, rows: np.ndarray, bounds: np.ndarray, softness: np.ndarray,
           multipliers: np.ndarray, row: int) -> float:
    """Return c x + s − b of a row, with the slack s = w u that its multiplier u buys."""
    value = softness[row] * multipliers[row] - bounds[row]
    for i in range(x.size):
        value += rows[row, i] * x[i]
    return value


@jit
def _most_violated(x: np.ndarray, rows: np.ndarray, bounds: np.ndarray, softness: np.ndarray,
                   multipliers: np.ndarray, is_active: np.ndarray) -> int:
    """Return the row that is violated most for its length, -1 where none is."""
    found, worst = -1, 0.0
    for row in range(bounds.size):
        if is_active[row]:
            continue
        square, size = 0.0, abs(bounds[row])
        for i in range(x.size):
            square += rows[row, i] * rows[row, i]
            size += abs(rows[row, i] * x[i])
        slack = _slack(x, rows, bounds, softness, multipliers, row)
        if slack < -TOLERANCE * size and slack / np.sqrt(square) < worst:
            found, worst = row, slack / np.sqrt(square)
    return found


@jit
def _column(inverse: np.ndarray, rows: np.ndarray, row: int) -> np.ndarray:
    """Return H⁻¹ cᵀ of a row, shape (n,)."""
    n = inverse.shape[0]
    column = np.zeros(n)
    for i in range(n):
        for j in range(n):
            column[i] += inverse[i, j] * rows[row, j]
    return column


@jit
def _dot(rows: np.ndarray, row: int, column: np.ndarray) -> float:
    value = 0.0
    for i in range(column.size):
        value += rows[row, i] * column[i]
    return value


@jit
def _direction(inverse: np.ndarray, rows: np.ndarray, softness: np.ndarray, active: np.ndarray,
               count: int, factor: np.ndarray, row: int,
               ) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Return how x and the multipliers move per unit of the multiplier of ``row``.

    Returns:
        The direction of x, shape (n,); how fast the multipliers of the active rows fall, shape
        (count,); the rate at which the slack of the row grows; and what it would be without
        active rows.
    """
    column = _column(inverse, rows, row)
    full = _dot(rows, row, column) + softness[row]
    right = np.empty(count)
    for i in range(count):
        right[i] = _dot(rows, active[i], column)
        for j in range(i):
            right[i] -= factor[i, j] * right[j]
        right[i] /= factor[i, i]
    curvature = full
    for i in range(count):
        curvature -= right[i] * right[i]
    change = right
    for i in range(count - 1, -1, -1):
        for j in range(i + 1, count):
            change[i] -= factor[j, i] * change[j]
        change[i] /= factor[i, i]
    for i in range(count):
        other = _column(inverse, rows, active[i])
        for j in range(column.size):
            column[j] -= other[j] * change[i]
    return column, change, curvature, full


@jit
def _append(inverse: np.ndarray, rows: np.ndarray, softness: np.ndarray, active: np.ndarray,
            count: int, factor: np.ndarray, row: int) -> None:
    """Make ``row`` the last of the active rows: one more row of the Cholesky factor."""
    column = _column(inverse, rows, row)
    square = _dot(rows, row, column) + softness[row]
    for i in range(count):
        value = _dot(rows, active[i], column)
        for j in range(i):
            value -= factor[count, j] * factor[i, j]
        factor[count, i] = value / factor[i, i]
        square -= factor[count, i] * factor[count, i]
    factor[count, count] = np.sqrt(max(square, 1e-300))
    active[count] = row


@jit
def _remove(inverse: np.ndarray, rows: np.ndarray, softness: np.ndarray, active: np.ndarray,
            count: int, factor: np.ndarray, position: int) -> int:
    """Take a row out of the active rows; return how many are left."""
    for i in range(position + 1, count):
        _append(inverse, rows, softness, active, i - 1, factor, active[i])
    return count - 1
