# SPDX-License-Identifier: Apache-2.0
"""Which pair to replace while σ_min is 0, where Algorithm 1 cannot tell one from another.

The replacement that makes the rank largest is taken if the rank grows. Where it stays, the oldest
pair goes, unless the rank would fall.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.identification.squares import add_square, assign
from adaptive_blf_control.identification.stack_arrays import (
    COUNT,
    Pairs,
    RANK,
    rank_of,
    take_turn,
)
from adaptive_blf_control.identification.tridiagonal import count_up_to, reduce

__all__ = ['least_missed', 'replacement_for_rank']


@jit
def replacement_for_rank(pairs: Pairs, candidate: np.ndarray) -> int:
    """Return the slot to replace, or −1."""
    pairs = borrowed(pairs)
    n, m = candidate.shape
    count, known = pairs.counters[COUNT], pairs.counters[RANK]
    assign(pairs.grown, pairs.gram)
    add_square(pairs.grown, candidate, n, 1.0)
    assign(pairs.trial.matrix, pairs.grown)
    reduce(pairs.trial, m)
    rank, tolerance = rank_of(pairs.trial, (count + 1) * n)
    if rank > known:
        slot, lost = least_missed(pairs, pairs.grown, rank, tolerance)
        # Summed again, too: a huge pair leaves its rounding behind in a difference of sums.
        if rank - lost > known and _rank_with(pairs, slot, candidate) > known:
            return slot
    slot = _oldest_after(pairs.turns, count, -1)
    if _rank_with(pairs, slot, candidate) >= known:
        return slot
    take_turn(pairs, slot)  # indispensable: look at the next one next time
    return -1


@jit
def least_missed(pairs: Pairs, total: np.ndarray, rank: int, tolerance: float) -> tuple[int, int]:
    """Return the oldest of the pairs that cost a sum the least rank, and how much that is.

    Args:
        pairs: Oldest first, so that the search ends with the first that costs nothing.
        total: The sum Q, of which the pairs are part, shape (m, m).
        rank: Its rank.
        tolerance: From which eigenvalue on a direction counts, see `rank_of`.
    """
    pairs = borrowed(pairs)
    form, (n, m) = pairs.trial, pairs.last.shape
    found, least, turn = -1, rank + 1, -1
    for _ in range(pairs.counters[COUNT]):
        slot = _oldest_after(pairs.turns, pairs.counters[COUNT], turn)
        turn = pairs.turns[slot]
        assign(form.matrix, total)
        add_square(form.matrix, pairs.regressors[slot], n, -1.0)
        reduce(form, m)
        lost = rank - (m - count_up_to(form, m, tolerance))
        if lost < least:
            found, least = slot, lost
        if least <= 0:
            break
    return found, least


@jit
def _oldest_after(turns: np.ndarray, count: int, turn: int) -> int:
    """Slot whose turn is longest ago among those after ``turn``."""
    found = -1
    for slot in range(count):
        if turns[slot] > turn and (found < 0 or turns[slot] < turns[found]):
            found = slot
    return found


@jit
def _rank_with(pairs: Pairs, slot: int, candidate: np.ndarray) -> int:
    """Rank with the candidate in a slot, summed again."""
    pairs = borrowed(pairs)
    n, m = candidate.shape
    count, form = pairs.counters[COUNT], pairs.trial
    rows = pairs.regressors.reshape(pairs.regressors.shape[0] * n, m)
    form.matrix[:] = 0.0
    add_square(form.matrix, rows, slot * n, 1.0)
    add_square(form.matrix, candidate, n, 1.0)
    add_square(form.matrix, rows[(slot + 1) * n:], (count - slot - 1) * n, 1.0)
    reduce(form, m)
    rank, _ = rank_of(form, count * n)
    return rank
