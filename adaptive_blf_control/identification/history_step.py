# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 for one candidate, on the arrays of a history stack."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import borrowed, Handle, jit, jit_apart
from adaptive_blf_control.identification.pair_selection import best_replacement, is_different
from adaptive_blf_control.identification.rank_selection import least_missed, replacement_for_rank
from adaptive_blf_control.identification.stack_arrays import (
    COUNT,
    GROWTH,
    measure,
    NEGLIGIBLE,
    Pairs,
    RANK,
    remove,
    ROUNDING,
    SIGMA_MIN,
    SIZE,
    store,
    sum_again,
    sums_follow,
    surely_full_rank,
    THRESHOLD,
    TOLERANCE,
)
from adaptive_blf_control.identification.weak_directions import set_weakest

__all__ = ['measure_pairs', 'offer', 'offer_pair']

# One function that calls all others: numba optimises what a function calls once more with each
# function that calls it, so every level between would cost seconds of compilation.


@jit_apart
def offer(pairs: Pairs, regressor: np.ndarray, torque: np.ndarray) -> int:
    """Offer a pair; while more than P are there one leaves instead.

    Args:
        pairs: The stack.
        regressor: Y_f, shape (n, m).
        torque: τ_f, shape (n,) [N·m].

    Returns:
        The slot that was filled or replaced, −1 where the pair was not taken.
    """
    pairs = borrowed(pairs)
    counters, figures, m = pairs.counters, pairs.figures, regressor.shape[1]
    shrinking = counters[COUNT] > counters[SIZE]
    if not shrinking and not is_different(regressor, pairs.last, figures[THRESHOLD]):
        return -1
    slot, sigma_min, wanted = -1, 0.0, (1.0 + figures[GROWTH]) * figures[SIGMA_MIN]
    if shrinking:  # as if nothing came in the place of what leaves
        regressor, torque = np.zeros(regressor.shape), np.zeros(torque.shape)
        wanted = figures[TOLERANCE]
    if counters[COUNT] < counters[SIZE]:
        slot = counters[COUNT]
    elif counters[RANK] == m:
        slot, sigma_min = best_replacement(pairs, regressor, wanted)
    elif not shrinking:
        slot = replacement_for_rank(pairs, regressor)
    if shrinking and slot < 0:
        slot, _ = least_missed(pairs, pairs.gram, counters[RANK], figures[TOLERANCE])
    if slot < 0:
        return -1
    followed = sums_follow(pairs, slot, regressor, torque)
    if shrinking:
        remove(pairs, slot)
    else:
        store(pairs, slot, regressor, torque)
    if not followed:
        sum_again(pairs)
    if followed and sigma_min > 0.0 and not shrinking and surely_full_rank(pairs, sigma_min):
        figures[SIGMA_MIN] = sigma_min  # the search has found it, and the direction
        pairs.directions.weakest[:] = pairs.directions.best
        set_weakest(pairs.directions, pairs.regressors, pairs.gram, counters[COUNT])
    else:
        measure(pairs)
    # Without a pair σ_min may have fallen among what its rounding left in Q.
    if shrinking and figures[ROUNDING] > NEGLIGIBLE * figures[SIGMA_MIN]:
        sum_again(pairs)
        measure(pairs)
    return -1 if shrinking else slot


@jit
def offer_pair(pairs: Handle, regressor: np.ndarray, torque: np.ndarray) -> int:
    """Offer a pair as `offer` does, called from Python.

    From there `offer` would be compiled once more, for arrays that are not references.
    """
    return offer(pairs.value, regressor, torque)


@jit
def measure_pairs(pairs: Handle) -> None:
    """Set rank and σ_min as `measure` does, likewise."""
    measure(pairs.value)
