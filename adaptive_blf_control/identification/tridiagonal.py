# SPDX-License-Identifier: Apache-2.0
"""Eigenvalues of small symmetric matrices in place: A = Z T Zᵀ with T tridiagonal.

Plain loops instead of LAPACK: for the sizes here (m up to about 100) faster, without threads, and
with the same bits wherever they are called from, as no loop leaves the order of a sum to the
compiler. Householder's reduction and the Sturm count are those of Golub and Van Loan, Matrix
Computations (2013), 8.3.1 and 8.4.1; Laguerre's iteration those of Li and Zeng, "The Laguerre
iteration in solving the symmetric tridiagonal eigenproblem, revisited" (SIAM J. Sci. Comput.,
1994).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import add_multiple, borrowed, combine_rows, dot, fold_row, jit

__all__ = ['EPSILON', 'Tridiagonal', 'count_up_to', 'eigenvector', 'largest_eigenvalue', 'reduce',
           'smallest_eigenvalue', 'tridiagonal', 'turned_axes']

EPSILON = 2.220446049250313e-16
_ITERATIONS = 60  # of Laguerre's method; it takes less than ten


class Tridiagonal(NamedTuple):
    """Room for a symmetric matrix A of up to m rows, and for its tridiagonal form.

    Attributes:
        matrix: A, shape (m, m); after `reduce` the elements before ``k`` of row k are the
            reflector u_k.
        diagonal: That of T, shape (m,).
        off: T[k, k − 1], shape (m,); its first element is 0.
        factor: β_k of the reflections H_k = I − β_k u_k u_kᵀ, shape (m,); Z = H_{m−1} … H_1.
        work: Shape (4, m).
    """

    matrix: np.ndarray
    diagonal: np.ndarray
    off: np.ndarray
    factor: np.ndarray
    work: np.ndarray


@jit
def tridiagonal(m: int) -> Tridiagonal:
    """Return room for matrices of up to ``m`` rows."""
    return Tridiagonal(np.zeros((m, m)), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros((4, m)))


@jit
def reduce(form: Tridiagonal, size: int) -> None:
    """Reduce the first ``size`` rows and columns of ``form.matrix`` to T, in place."""
    form = borrowed(form)
    v, w, u, p = form.work[0], form.work[1], form.work[2], form.work[3]
    v[:size] = 0.0
    w[:size] = 0.0
    form.off[0] = 0.0
    for k in range(size - 1, 0, -1):
        row = form.matrix[k]
        form.diagonal[k] = row[k]
        beta = _reflector(form, row, k)
        for i in range(k):
            u[i] = row[i]
        _fold(form.matrix, k, v, w, u, p)
        half = 0.5 * beta * dot(p, u, k)
        for i in range(k):
            w[i] = beta * (p[i] - half * u[i])
            v[i] = u[i]
        # The row that gives the next reflector; the others follow with `_fold`.
        row = form.matrix[k - 1]
        a, b = v[k - 1], w[k - 1]
        for i in range(k):
            row[i] -= a * w[i] + b * v[i]
    form.diagonal[0] = form.matrix[0, 0]


@jit
def _reflector(form: Tridiagonal, row: np.ndarray, k: int) -> float:
    """Make the first k elements of a row the reflector that leaves only the last of them."""
    form = borrowed(form)
    last, rest = row[k - 1], dot(row, row, k - 1)
    beta, scale, norm = 0.0, 0.0, last
    if rest > 0.0:
        norm = -math.copysign(math.sqrt(last * last + rest), last)
        beta, scale = 1.0 - last / norm, 1.0 / (last - norm)
    for i in range(k - 1):
        row[i] *= scale
    row[k - 1] = 1.0
    form.off[k] = norm
    form.factor[k] = beta
    return beta


@jit
def _fold(matrix: np.ndarray, k: int, v: np.ndarray, w: np.ndarray, u: np.ndarray,
          p: np.ndarray) -> None:
    """A −= v wᵀ + w vᵀ and p = A u for the first k rows and columns of A, in one pass."""
    for i in range(k):
        p[i] = 0.0
    for j in range(k):
        fold_row(matrix[j], v[j], w, w[j], v, p, u[j], k)


@jit
def _row_sum(form: Tridiagonal, size: int) -> float:
    """The largest row sum of |T|, a bound of its eigenvalues."""
    form = borrowed(form)
    largest = 0.0
    for i in range(size):
        total = abs(form.diagonal[i]) + abs(form.off[i])
        if i + 1 < size:
            total += abs(form.off[i + 1])
        largest = max(largest, total)
    return largest


@jit
def count_up_to(form: Tridiagonal, size: int, bound: float) -> int:
    """Return how many eigenvalues of T are not above ``bound``: Sturm's count."""
    form = borrowed(form)
    count, pivot = 0, 1.0
    tiny = EPSILON * EPSILON * max(_row_sum(form, size), 1e-290)
    for i in range(size):
        pivot = form.diagonal[i] - bound - form.off[i] * form.off[i] / pivot
        if pivot <= 0.0:
            count += 1
            pivot = min(pivot, -tiny)
    return count


@jit
def smallest_eigenvalue(form: Tridiagonal, size: int) -> float:
    """Return the smallest eigenvalue of a positive semi-definite T, to the rounding of ‖T‖."""
    form = borrowed(form)
    scale = _row_sum(form, size)
    return _from_below(form, size, -2.0 * size * EPSILON * scale, scale)


@jit
def largest_eigenvalue(form: Tridiagonal, size: int) -> float:
    """Return the largest eigenvalue of T, to the rounding of ‖T‖."""
    form = borrowed(form)
    scale = _row_sum(form, size)
    for i in range(size):
        form.diagonal[i] = -form.diagonal[i]
    value = -_from_below(form, size, -scale * (1.0 + 4.0 * EPSILON), scale)
    for i in range(size):
        form.diagonal[i] = -form.diagonal[i]
    return value


@jit
def _from_below(form: Tridiagonal, size: int, lower: float, scale: float) -> float:
    """Laguerre's iteration, which rises from a bound ``lower`` to the smallest eigenvalue.

    With q_i the pivots of T − x I, s1 = Σ 1/(λ_i − x) = −Σ q_i'/q_i and s2 = Σ 1/(λ_i − x)²
    follow from derivatives of their recursion.
    """
    form = borrowed(form)
    value = lower
    for _ in range(_ITERATIONS):
        s1, s2, inverse, slope, bend = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(size):
            c = form.off[i] * form.off[i] * inverse
            pivot = form.diagonal[i] - value - c
            if not pivot > 0.0:  # at the eigenvalue, but for rounding
                return value
            inverse = 1.0 / pivot
            bend, slope = c * (bend - 2.0 * slope * slope) * inverse, (c * slope - 1.0) * inverse
            s1 -= slope
            s2 += slope * slope - bend
        step = size / (s1 + math.sqrt(max((size - 1.0) * (size * s2 - s1 * s1), 0.0)))
        value += step
        if not step > 0.25 * EPSILON * scale:
            return value
    return value


@jit
def eigenvector(form: Tridiagonal, size: int, value: float, x: np.ndarray) -> None:
    """Set x, shape (m,), to a unit vector of A for the smallest eigenvalue of T.

    Two steps of inverse iteration below ``value``, which is exact to rounding.
    """
    form = borrowed(form)
    pivot, factor = form.work[0], form.work[1]
    below = 4.0 * EPSILON * max(_row_sum(form, size), 1e-100)
    shift, tiny = value - below, EPSILON * below
    before = 1.0
    for i in range(size):
        x[i] = 1.0
        factor[i] = form.off[i] / before
        before = max(form.diagonal[i] - shift - factor[i] * form.off[i], tiny)
        pivot[i] = before
    for _ in range(2):
        for i in range(1, size):
            x[i] -= factor[i] * x[i - 1]
        after, square = 0.0, 0.0
        for i in range(size - 1, -1, -1):
            x[i] = x[i] / pivot[i]
            if i + 1 < size:
                x[i] -= factor[i + 1] * after
            after = x[i]
            square += after * after
        norm = 1.0 / math.sqrt(square)
        for i in range(size):
            x[i] *= norm
    _turn_back(form, size, x)


@jit
def _turn_back(form: Tridiagonal, size: int, x: np.ndarray) -> None:
    """Replace x by Z x."""
    form = borrowed(form)
    for k in range(1, size):
        row = form.matrix[k]
        add_multiple(x, -form.factor[k] * dot(row, x, k), row, k)


@jit
def turned_axes(form: Tridiagonal, axes: np.ndarray) -> None:
    """Set ``axes``, shape (m, m), to Z of a matrix of m rows."""
    form = borrowed(form)
    size, total, weights = axes.shape[0], form.work[0], form.work[1]
    for i in range(size):
        row = axes[i]
        for j in range(size):
            row[j] = 0.0
        row[i] = 1.0
    for k in range(1, size):  # Z ← H_k Z: so far only its first k rows and columns are of interest
        reflector = form.matrix[k]
        for i in range(k):
            weights[i] = form.factor[k] * reflector[i]
        combine_rows(total, axes, weights, k)
        for i in range(k):
            add_multiple(axes[i], -reflector[i], total, k)
