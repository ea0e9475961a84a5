# SPDX-License-Identifier: Apache-2.0
"""Which pair to take and which to give up: the searches of Algorithm 1, as pure functions."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import jit

__all__ = ['EPSILON', 'best_replacement', 'is_different', 'lost_ranks', 'rank_tolerance',
           'squared_projections']

EPSILON = 2.220446049250313e-16
# A leverage this close to 1 is 1: no other pair reaches that direction.
ALONE = 1.0 - 1e-10


@jit
def is_different(candidate: np.ndarray, last: np.ndarray, epsilon: float) -> bool:
    """Algorithm 1, lines 2 and 8: ‖Y_f − Y_last‖₂ ≥ ε ‖Y_f‖₂ in the spectral norm."""
    difference = candidate - last
    # ‖·‖_F / √n ≤ ‖·‖₂ ≤ ‖·‖_F settles most cases without an eigenvalue problem.
    d2 = np.sum(difference * difference)
    c2 = np.sum(candidate * candidate)
    n = candidate.shape[0]
    if not 0.0 < c2 < np.inf or d2 < epsilon * epsilon * c2 / n:
        return False
    if d2 / n >= epsilon * epsilon * c2:
        return True
    top = np.linalg.eigvalsh(np.dot(difference, difference.T))[-1]
    return bool(top >= epsilon * epsilon * np.linalg.eigvalsh(np.dot(candidate, candidate.T))[-1])


@jit
def squared_projections(regressors: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return ‖Y_l u‖² for every slot l of ``regressors``, shape (P, n, m) → (P,)."""
    slots, n, m = regressors.shape
    y = np.dot(regressors.reshape(slots * n, m), u).reshape(slots, n)
    return np.sum(y * y, axis=1)


@jit
def _inverse_iteration(matrix: np.ndarray, shift: float, v: np.ndarray,
                       steps: int) -> np.ndarray:
    """Turn the unit vector v, (m,), towards eigenvectors with eigenvalues near ``shift``."""
    shifted = matrix - shift * np.eye(v.size)
    for _ in range(steps):
        v = np.linalg.solve(shifted, v)
        v = v / np.sqrt(np.sum(v * v))
    return v


@jit
def best_replacement(candidate: np.ndarray, regressors: np.ndarray, gram: np.ndarray,
                     sigma_min: float, bounds: np.ndarray) -> int:
    """Lines 9-15 of Algorithm 1: the slot whose replacement gives the largest σ_min.

    For any unit vector v, vᵀ(Q + YᵀY)v − ‖Y_l v‖² bounds the σ_min that slot l would give from
    above. Slots are visited in the order of their bounds; the weakest direction of each trial
    sharpens the bounds of all others that are still open, and the search ends when none can beat
    the best found: the answer of the brute-force search after one or two eigenvalue problems
    instead of P. A slot that only seemed good is recognised by an inverse iteration, which costs
    a quarter of an eigenvalue problem; how well that converges decides on the time, never on the
    answer.

    With Y = 0 it is the search for the pair that is missed least.

    Args:
        candidate: Y, shape (n, m).
        regressors: The full stack, shape (P, n, m).
        gram: Q, shape (m, m).
        sigma_min: What the smallest eigenvalue must reach at least, > 0.
        bounds: Upper bounds to start from, shape (P,); overwritten.

    Returns:
        The slot, or −1 where no replacement reaches ``sigma_min``.
    """
    n, m = candidate.shape
    best, best_slot = sigma_min, -1
    grown = gram + np.dot(candidate.T, candidate)
    margin = 1e-12 * np.trace(grown)  # keeps the shifted matrices from being exactly singular
    v = np.full(m, 1.0 / np.sqrt(m))
    while True:
        slot = int(np.argmax(bounds))
        bound = bounds[slot]
        if bound < best or (best_slot >= 0 and bound == best):
            return best_slot
        bounds[slot] = -np.inf
        old = regressors[slot]
        trial = grown - np.dot(old.T, old)
        v = _inverse_iteration(trial, 0.99 * best - margin, v, 2)
        if np.dot(v, np.dot(trial, v)) >= (1.0 - 1e-12) * best:  # v does not rule the slot out
            value = np.linalg.eigvalsh(trial)[0]
            if value > best or (value == best and best_slot < 0):
                best, best_slot = value, slot
            v = _inverse_iteration(trial, value - margin, v, 1)
        still_open = np.flatnonzero(bounds >= best)
        seen = squared_projections(regressors[still_open], v)
        bounds[still_open] = np.minimum(bounds[still_open], np.dot(v, np.dot(grown, v)) - seen)


@jit
def rank_tolerance(eigenvalues: np.ndarray, rows: int) -> float:
    """Return the rounding of an eigenvalue of a sum over so many rows; ``eigenvalues`` ascend."""
    return float(max(eigenvalues.size, rows) * EPSILON * max(eigenvalues[-1], 0.0))


def lost_ranks(regressors: np.ndarray, values: np.ndarray, vectors: np.ndarray,
               rank: int) -> np.ndarray:
    """Return by how much the rank of a sum falls without each of its pairs, shape (P,).

    With Q = V Λ Vᵀ restricted to its range and W = Y_l V Λ^{−½}, Q − Y_lᵀY_l has lost one rank for
    every eigenvalue 1 of W Wᵀ (a leverage: how much of a direction is this pair's alone). Its
    trace, below 1 for all but ``rank`` pairs at most, settles the others without an eigenvalue
    problem.

    Args:
        regressors: Pairs that are part of the sum, shape (P, n, m).
        values: Eigenvalues of the sum Q, ascending, shape (m,).
        vectors: Its eigenvectors, shape (m, m).
        rank: Rank of Q, of which the largest eigenvalues are taken.
    """
    slots, n, m = regressors.shape
    lost = np.zeros(slots, dtype=np.int64)
    if rank == 0:
        return lost
    whitening = vectors[:, m - rank:] / np.sqrt(values[m - rank:])
    rows = (regressors.reshape(slots * n, m) @ whitening).reshape(slots, n, rank)
    suspects = np.einsum('pnr,pnr->p', rows, rows) > ALONE
    leverages = np.linalg.eigvalsh(rows[suspects] @ rows[suspects].transpose(0, 2, 1))
    lost[suspects] = np.count_nonzero(leverages > ALONE, axis=1)
    return lost
