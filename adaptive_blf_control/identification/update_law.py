# SPDX-License-Identifier: Apache-2.0
"""Update laws (20), (22), (37) with one implicit step: stable for every gain and step.

They differ in what goes into the step only:

* ``gradient`` (20): the present pair, k_h = 0 and no Xᵀe2. Its Γ is our k_t Γ.
* ``concurrent`` (22): the recorded pairs as well.
* ``ablf_concurrent`` (37): Xᵀe2 of the controller as well, which Theorem 2 needs.

G = Σ Y_fjᵀ Y_fj changes only when a pair is taken, so √Γ G √Γ = Z T Zᵀ with T tridiagonal is kept
from sample to sample. In these axes the recorded pairs cost a few operations for each parameter,
whatever the interval and the gains, and the n rows of the present pair a system of n equations
(Woodbury's identity), in place of a factorisation of m × m.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, combine_rows, dot, jit
from adaptive_blf_control.identification.tridiagonal import (
    reduce,
    Tridiagonal,
    tridiagonal,
    turned_axes,
)

__all__ = ['advance', 'implicit_step', 'KeptHistory', 'kept_history']


class KeptHistory(NamedTuple):
    """√Γ G √Γ = Z T Zᵀ as it was reduced last, and room for a step.

    Attributes:
        gram: G of which it was made, shape (m, m).
        gamma: Diagonal of Γ, likewise, shape (m,); NaN before the first step.
        root: √Γ, shape (m,).
        form: T.
        axes: Z, shape (m, m).
        rows: Y_f √Γ Z L⁻ᵀ, shape (n, m).
        system: The n equations of the present pair, their right-hand side last, (n, n + 1).
        increment: θ̂⁺ − θ̂ in the axes Z, shape (m,).
        pivot: D of I + dt k_h T = L D Lᵀ, shape (m,).
        factor: The elements of L below its diagonal, shape (m,).
        scaled: Shape (m,).
    """

    gram: np.ndarray
    gamma: np.ndarray
    root: np.ndarray
    form: Tridiagonal
    axes: np.ndarray
    rows: np.ndarray
    system: np.ndarray
    increment: np.ndarray
    pivot: np.ndarray
    factor: np.ndarray
    scaled: np.ndarray


def kept_history(n: int, m: int) -> KeptHistory:
    """Return room for ``n`` joints and ``m`` parameters; the first step fills it."""
    vectors = np.zeros((4, m))
    return KeptHistory(np.zeros((m, m)), np.full(m, math.nan), np.zeros(m), tridiagonal(m),
                       np.zeros((m, m)), np.zeros((n, m)), np.zeros((n, n + 1)), *vectors)


def implicit_step(theta: np.ndarray, dt: float, gamma: np.ndarray, kt: float, kh: float,
                  yf: np.ndarray, tf: np.ndarray, gram: np.ndarray, moment: np.ndarray,
                  adaptation_term: np.ndarray) -> np.ndarray:
    """Return θ̂⁺ of one step with nothing kept; arguments as `advance`."""
    result = theta.copy()
    advance(kept_history(*yf.shape), result, dt, gamma, kt, kh, yf, tf, gram, moment,
            adaptation_term)
    return result


@jit
def advance(kept: KeptHistory, theta: np.ndarray, dt: float, gamma: np.ndarray, kt: float,
            kh: float, yf: np.ndarray, tf: np.ndarray, gram: np.ndarray, moment: np.ndarray,
            adaptation_term: np.ndarray) -> None:
    """Advance θ̂ over ``dt``: (37) is linear in θ̂, so its implicit Euler step is one solve.

    (Γ⁻¹ + dt [k_t Y_fᵀY_f + k_h G]) θ̂⁺ = Γ⁻¹ θ̂ + dt [k_t Y_fᵀ τ_f + k_h g − Xᵀe2]
    with G = Σ Y_fjᵀ Y_fj and g = Σ Y_fjᵀ τ_fj. It is solved for the increment θ̂⁺ − θ̂, which keeps
    the digits where the step is small: first without the present pair, then corrected by what
    that leaves of the pair's residual.

    Args:
        kept: Of the steps before; reduced again where G or Γ is another.
        theta: θ̂, shape (m,); changed in place.
        dt: Step [s].
        gamma: Diagonal of Γ, shape (m,), > 0.
        kt: Gain on the present pair, ≥ 0.
        kh: Gain on the history stack, ≥ 0.
        yf: Present filtered regressor, shape (n, m).
        tf: Present filtered torque, shape (n,) [N·m].
        gram: G, shape (m, m).
        moment: g, shape (m,).
        adaptation_term: Xᵀ e2, shape (m,); zeros give (22).
    """
    kept = borrowed(kept)
    if not (_same_vector(kept.gamma, gamma) and _same_matrix(kept.gram, gram)):
        _keep(kept, gram, gamma)
    n, m = yf.shape
    increment, factor = kept.increment, kept.factor
    _history_slope(kept.scaled, kept.root, theta, kh, gram, moment, adaptation_term)
    combine_rows(increment, kept.axes, kept.scaled, m)
    _factorise(kept.pivot, factor, kept.form.diagonal, kept.form.off, dt * kh)
    _eliminate(factor, increment)
    for j in range(n):
        for i in range(m):
            kept.scaled[i] = yf[j, i] * kept.root[i]
        kept.system[j, n] = tf[j] - dot(yf[j], theta, m)
        combine_rows(kept.rows[j], kept.axes, kept.scaled, m)
    for i in range(1, m):  # L⁻¹ of all rows at once: each element waits for the one before
        for j in range(n):
            kept.rows[j, i] -= factor[i] * kept.rows[j, i - 1]
    for i in range(m):
        increment[i] *= dt / kept.pivot[i]
    _correct(increment, kept.rows, kept.pivot, kept.system, kept.scaled, dt * kt)
    _substitute(factor, increment)
    for i in range(m):
        theta[i] += kept.root[i] * dot(kept.axes[i], increment, m)


@jit
def _same_vector(one: np.ndarray, other: np.ndarray) -> bool:
    differences = 0
    for i in range(one.size):
        differences += one[i] != other[i]
    return differences == 0


@jit
def _same_matrix(one: np.ndarray, other: np.ndarray) -> bool:
    same = True
    for i in range(one.shape[0]):
        same = same and _same_vector(one[i], other[i])
    return same


@jit
def _keep(kept: KeptHistory, gram: np.ndarray, gamma: np.ndarray) -> None:
    kept = borrowed(kept)
    m = gamma.size
    for i in range(m):
        kept.gamma[i] = gamma[i]
        kept.root[i] = math.sqrt(gamma[i])
    for i in range(m):
        for j in range(m):
            kept.gram[i, j] = gram[i, j]
            kept.form.matrix[i, j] = kept.root[i] * gram[i, j] * kept.root[j]
    reduce(kept.form, m)
    turned_axes(kept.form, kept.axes)


@jit
def _history_slope(scaled: np.ndarray, root: np.ndarray, theta: np.ndarray, kh: float,
                   gram: np.ndarray, moment: np.ndarray, adaptation_term: np.ndarray) -> None:
    """Set ``scaled`` to √Γ (k_h (g − G θ̂) − Xᵀe2)."""
    m = theta.size
    combine_rows(scaled, gram, theta, m)
    for i in range(m):
        scaled[i] = root[i] * (kh * (moment[i] - scaled[i]) - adaptation_term[i])


@jit
def _factorise(pivot: np.ndarray, factor: np.ndarray, diagonal: np.ndarray, off: np.ndarray,
               gain: float) -> None:
    """I + gain T = L D Lᵀ."""
    before = 1.0
    for i in range(pivot.size):
        below = gain * off[i]
        factor[i] = below / before
        before = 1.0 + gain * diagonal[i] - factor[i] * below
        pivot[i] = before


@jit
def _eliminate(factor: np.ndarray, x: np.ndarray) -> None:
    """Replace x by L⁻¹ x."""
    for i in range(1, x.size):
        x[i] -= factor[i] * x[i - 1]


@jit
def _substitute(factor: np.ndarray, x: np.ndarray) -> None:
    """Replace x by L⁻ᵀ x."""
    for i in range(x.size - 1, 0, -1):
        x[i - 1] -= factor[i] * x[i]


@jit
def _correct(increment: np.ndarray, rows: np.ndarray, pivot: np.ndarray, system: np.ndarray,
             scaled: np.ndarray, gain: float) -> None:
    """Add D⁻¹ Rᵀ s to the increment, (I + gain R D⁻¹ Rᵀ) s = gain (r − R · increment).

    R are the rows of the present pair, r its residual; s by Gauss without pivoting, as the matrix
    is symmetric and positive definite.
    """
    n, m = rows.shape
    for i in range(n):
        row = rows[i]
        for k in range(m):
            scaled[k] = row[k] / pivot[k]
        system[i, n] = gain * (system[i, n] - dot(row, increment, m))
        for j in range(i, n):
            system[i, j] = system[j, i] = gain * dot(scaled, rows[j], m)
        system[i, i] += 1.0
    _solve(system)
    for j in range(n):
        row, weight = rows[j], system[j, n]
        for k in range(m):
            increment[k] += row[k] * weight / pivot[k]


@jit
def _solve(system: np.ndarray) -> None:
    """Replace the last column of [A b], shape (n, n + 1), by A⁻¹ b."""
    n = system.shape[0]
    for j in range(n):
        for i in range(j + 1, n):
            part = system[i, j] / system[j, j]
            for k in range(j + 1, n + 1):
                system[i, k] -= part * system[j, k]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            system[i, n] -= system[i, k] * system[k, n]
        system[i, n] /= system[i, i]
