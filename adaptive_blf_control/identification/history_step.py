# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 for one candidate, on the arrays of a history stack."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.identification.pair_selection import best_replacement, is_different
from adaptive_blf_control.identification.rank_selection import (
    oldest_least_missed,
    replacement_for_rank,
)
from adaptive_blf_control.identification.stack_arrays import (
    COUNT,
    GROWTH,
    INSERTIONS,
    is_full,
    measure,
    NEGLIGIBLE,
    Pairs,
    RANK,
    REVISION,
    ROUNDING,
    SIGMA_MIN,
    SIZE,
    sum_anew,
    sums_follow,
    surely_full_rank,
    THRESHOLD,
    TOLERANCE,
    TURN,
)
from adaptive_blf_control.identification.weak_directions import (
    follow_slot,
    project_gram,
    set_weakest,
)

__all__ = ['offer']


@jit
def offer(pairs: Pairs, regressor: np.ndarray, torque: np.ndarray) -> int:
    """Offer a pair; while more than P are there one leaves instead.

    Args:
        pairs: The stack.
        regressor: Y_f, shape (n, m).
        torque: τ_f, shape (n,) [N·m].

    Returns:
        The slot that was filled or replaced, −1 where the pair was not taken.
    """
    counters = pairs.counters
    if counters[COUNT] > counters[SIZE]:
        _remove(pairs, _least_missed(pairs))
        return -1
    if not is_different(regressor, pairs.last, pairs.figures[THRESHOLD]):
        return -1
    if not is_full(pairs):
        slot = counters[COUNT]
        _put(pairs, slot, regressor, torque)
        measure(pairs)
        return slot
    if counters[RANK] < regressor.shape[1]:
        slot, indispensable = replacement_for_rank(pairs, regressor)
        if slot >= 0:
            _put(pairs, slot, regressor, torque)
            measure(pairs)
        elif indispensable >= 0:
            _take_turn(pairs, indispensable)  # look at the next one next time
        return slot
    wanted = (1.0 + pairs.figures[GROWTH]) * pairs.figures[SIGMA_MIN]
    slot, sigma_min = best_replacement(pairs, regressor, wanted)
    if slot >= 0:
        _replace(pairs, slot, regressor, torque, sigma_min)
    return slot


@jit
def _replace(pairs: Pairs, slot: int, regressor: np.ndarray, torque: np.ndarray,
             sigma_min: float) -> None:
    """Take a pair into a full stack of full rank; the search has found σ_min and its direction."""
    followed = _put(pairs, slot, regressor, torque)
    if followed and surely_full_rank(pairs, sigma_min):
        pairs.figures[SIGMA_MIN] = sigma_min
        pairs.directions.weakest[:] = pairs.directions.best
        set_weakest(pairs.directions, pairs.regressors, pairs.gram, pairs.counters[COUNT])
    else:
        measure(pairs)


@jit
def _put(pairs: Pairs, slot: int, regressor: np.ndarray, torque: np.ndarray) -> bool:
    """Store a pair in a slot; whether the sums followed, or were made anew."""
    counters = pairs.counters
    followed = sums_follow(pairs, slot, regressor, torque)
    if slot == counters[COUNT]:
        counters[COUNT] += 1
    _take_turn(pairs, slot)
    pairs.regressors[slot] = regressor
    pairs.torques[slot] = torque
    pairs.last[:, :] = regressor
    counters[INSERTIONS] += 1
    counters[REVISION] += 1
    follow_slot(pairs.directions, slot, regressor)
    if not followed:
        sum_anew(pairs)
        project_gram(pairs.directions, pairs.gram)
    return followed


@jit
def _take_turn(pairs: Pairs, slot: int) -> None:
    pairs.counters[TURN] += 1
    pairs.turns[slot] = pairs.counters[TURN]


@jit
def _least_missed(pairs: Pairs) -> int:
    """Slot whose absence leaves the largest σ_min, or the oldest that costs the least rank."""
    n, m = pairs.last.shape
    if pairs.counters[RANK] == m:
        slot, _ = best_replacement(pairs, np.zeros((n, m)), pairs.figures[TOLERANCE])
        if slot >= 0:
            return slot
    return oldest_least_missed(pairs)


@jit
def _remove(pairs: Pairs, slot: int) -> None:
    """Take a pair away; the last one moves into its slot."""
    counters = pairs.counters
    n, m = pairs.last.shape
    followed = sums_follow(pairs, slot, np.zeros((n, m)), np.zeros(n))
    counters[COUNT] -= 1
    last = counters[COUNT]
    follow_slot(pairs.directions, slot, pairs.regressors[last])
    pairs.regressors[slot] = pairs.regressors[last]
    pairs.regressors[last] = 0.0
    pairs.directions.seen[last] = 0.0
    pairs.torques[slot] = pairs.torques[last]
    pairs.torques[last] = 0.0
    pairs.turns[slot] = pairs.turns[last]
    counters[REVISION] += 1
    if followed:
        project_gram(pairs.directions, pairs.gram)
        measure(pairs)
        # Without the pair σ_min may have fallen among what its rounding left in Q.
        followed = pairs.figures[ROUNDING] <= NEGLIGIBLE * pairs.figures[SIGMA_MIN]
    if not followed:
        sum_anew(pairs)
        project_gram(pairs.directions, pairs.gram)
        measure(pairs)
