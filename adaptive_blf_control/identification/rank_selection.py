# SPDX-License-Identifier: Apache-2.0
"""Which pair to replace while σ_min is 0, where Algorithm 1 cannot tell one from another.

The replacement that makes the rank largest is taken if the rank grows; that happens at most m
times, so this part is left to LAPACK. Where the rank stays, the oldest pair goes, unless the rank
would fall.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.identification.squares import add_square
from adaptive_blf_control.identification.stack_arrays import COUNT, Pairs, RANK, rank_of
from adaptive_blf_control.identification.tridiagonal import reduce

__all__ = ['oldest', 'oldest_least_missed', 'replacement_for_rank']

# A leverage this close to 1 is 1: no other pair reaches that direction.
ALONE = 1.0 - 1e-10


@jit
def replacement_for_rank(pairs: Pairs, candidate: np.ndarray) -> tuple[int, int]:
    """Return the slot to replace, or −1, and then the slot that was indispensable, or −1."""
    slot = _where_rank_grows(pairs, candidate)
    if slot >= 0:
        return slot, -1
    slot = oldest(pairs, np.zeros(pairs.counters[COUNT], dtype=np.int64))
    if _rank_with(pairs, slot, candidate) >= pairs.counters[RANK]:
        return slot, -1
    return -1, slot


@jit
def oldest(pairs: Pairs, costs: np.ndarray) -> int:
    """Return the slot whose turn is longest ago among those of the lowest cost."""
    found = 0
    for slot in range(1, pairs.counters[COUNT]):
        if costs[slot] < costs[found] or (costs[slot] == costs[found]
                                          and pairs.turns[slot] < pairs.turns[found]):
            found = slot
    return found


@jit
def oldest_least_missed(pairs: Pairs) -> int:
    """Return the oldest of the pairs whose absence costs the least rank."""
    return oldest(pairs, _lost_ranks(pairs, pairs.gram, pairs.counters[RANK]))


@jit
def _where_rank_grows(pairs: Pairs, candidate: np.ndarray) -> int:
    """Slot whose replacement makes the rank largest, if it grows; else −1."""
    n, m = candidate.shape
    pairs.grown[:, :] = pairs.gram
    add_square(pairs.grown, candidate, candidate.shape[0], 1.0)
    pairs.trial.matrix[:, :] = pairs.grown
    reduce(pairs.trial, m)
    rank, _ = rank_of(pairs.trial, (pairs.counters[COUNT] + 1) * n)
    if rank <= pairs.counters[RANK]:
        return -1
    lost = _lost_ranks(pairs, pairs.grown, rank)
    slot = oldest(pairs, lost)
    grows = rank - lost[slot] > pairs.counters[RANK]
    # By itself, too: a huge pair leaves its rounding behind in a difference of sums.
    return slot if grows and _rank_with(pairs, slot, candidate) > pairs.counters[RANK] else -1


@jit
def _rank_with(pairs: Pairs, slot: int, candidate: np.ndarray) -> int:
    """Rank with the candidate in a slot, summed anew."""
    n, m = candidate.shape
    count, form = pairs.counters[COUNT], pairs.trial
    form.matrix[:, :] = 0.0
    rows = pairs.regressors.reshape(pairs.regressors.shape[0] * n, m)
    add_square(form.matrix, rows, slot * n, 1.0)
    add_square(form.matrix, candidate, n, 1.0)
    add_square(form.matrix, rows[(slot + 1) * n:], (count - slot - 1) * n, 1.0)
    reduce(form, m)
    rank, _ = rank_of(form, count * n)
    return rank


@jit
def _lost_ranks(pairs: Pairs, total: np.ndarray, rank: int) -> np.ndarray:
    """By how much the rank of a sum Q falls without each of its pairs, shape (count,).

    With Q = V Λ Vᵀ restricted to its range and W = Y_l V Λ^{−½}, Q − Y_lᵀY_l has lost one rank for
    every eigenvalue 1 of W Wᵀ (a leverage: how much of a direction is this pair's alone). Its
    trace, below 1 for all but ``rank`` pairs at most, settles the others without an eigenvalue
    problem.
    """
    count, m = pairs.counters[COUNT], total.shape[0]
    lost = np.zeros(count, dtype=np.int64)
    if rank == 0:
        return lost
    values, vectors = np.linalg.eigh(total)
    whitening = np.ascontiguousarray(vectors[:, m - rank:] / np.sqrt(values[m - rank:]))
    for slot in range(count):
        rows = np.dot(pairs.regressors[slot], whitening)
        if np.sum(rows * rows) > ALONE:
            for leverage in np.linalg.eigvalsh(np.dot(rows, rows.T)):
                lost[slot] += leverage > ALONE
    return lost
