# SPDX-License-Identifier: Apache-2.0
"""The arrays of a history stack, changed in place by compiled functions, and what is known of Q.

Q = Σ Y_fjᵀ Y_fj follows a replacement by a sum and a difference while what rounding leaves in it
is surely negligible; otherwise it is summed again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, jit, jit_apart
from adaptive_blf_control.identification.squares import add_square, assign
from adaptive_blf_control.identification.tridiagonal import (
    count_up_to,
    eigenvector,
    EPSILON,
    largest_eigenvalue,
    reduce,
    smallest_eigenvalue,
    Tridiagonal,
    tridiagonal,
)
from adaptive_blf_control.identification.weak_directions import (
    clear_directions,
    Directions,
    follow_slot,
    new_directions,
    project_gram,
    set_weakest,
)

__all__ = ['clear_pairs', 'COUNT', 'GROWTH', 'INSERTIONS', 'is_full', 'measure', 'NEGLIGIBLE',
           'new_pairs', 'Pairs', 'RANK', 'rank_of', 'remove', 'REVISION', 'ROUNDING', 'SIGMA_MIN',
           'shift_torques', 'SIZE', 'store', 'sum_again', 'sums_follow', 'surely_full_rank',
           'take_turn', 'THRESHOLD', 'TOLERANCE', 'trace', 'TURN', 'with_slots']

# Q may follow from the one before while what rounding has left in it is surely below this part
# of σ_min and this many units in its last place; otherwise it is summed again.
NEGLIGIBLE = 1e-6
UNITS = 64.0

# Elements of `Pairs.counters` ...
SIZE, COUNT, INSERTIONS, REVISION, RANK, TURN = range(6)
# ... and of `Pairs.figures`.
THRESHOLD, GROWTH, SIGMA_MIN, TOLERANCE, ROUNDING = range(5)


class Pairs(NamedTuple):
    """A history stack of up to P pairs.

    Attributes:
        regressors: Y_fj, shape (slots, n, m), of which ``counters[COUNT]`` are filled.
        torques: τ_fj, shape (slots, n) [N·m].
        gram: Q, shape (m, m).
        moment: Σ Y_fjᵀ τ_fj, shape (m,).
        last: The regressor taken last, shape (n, m).
        turns: When each slot was filled or passed over last, shape (slots,).
        counters: By name: SIZE P, COUNT, INSERTIONS, REVISION, RANK of Q, and TURN, the last turn.
        figures: By name: THRESHOLD ε, GROWTH (part of σ_min by which a replacement must raise it),
            SIGMA_MIN, the TOLERANCE of the rank, and what ROUNDING may have left in Q.
        directions: In which Q is weakest, for the search.
        grown: Q + YᵀY of a candidate, shape (m, m).
        trial: Room for the matrix of one replacement, or for Q.
    """

    regressors: np.ndarray
    torques: np.ndarray
    gram: np.ndarray
    moment: np.ndarray
    last: np.ndarray
    turns: np.ndarray
    counters: np.ndarray
    figures: np.ndarray
    directions: Directions
    grown: np.ndarray
    trial: Tridiagonal


def new_pairs(n: int, m: int, slots: int) -> Pairs:
    """Return an empty stack of as many slots; the caller sets SIZE, THRESHOLD and GROWTH."""
    return Pairs(np.zeros((slots, n, m)), np.zeros((slots, n)), np.zeros((m, m)), np.zeros(m),
                 np.zeros((n, m)), np.zeros(slots, dtype=np.int64), np.zeros(6, dtype=np.int64),
                 np.zeros(5), new_directions(n, m, slots), np.zeros((m, m)), tridiagonal(m))


def with_slots(pairs: Pairs, slots: int) -> Pairs:
    """Return the same stack with more slots."""
    n, m = pairs.last.shape
    result = new_pairs(n, m, slots)
    count, source, target = pairs.counters[COUNT], pairs.directions, result.directions
    for new, old in ((result.regressors, pairs.regressors), (result.torques, pairs.torques),
                     (result.turns, pairs.turns), (target.seen, source.seen),
                     (target.energies, source.energies)):
        new[:count] = old[:count]
    return pairs._replace(
        regressors=result.regressors, torques=result.torques, turns=result.turns,
        directions=source._replace(seen=target.seen, energies=target.energies,
                                   bounds=target.bounds, stages=target.stages))


@jit
def clear_pairs(pairs: Pairs) -> None:
    """Forget every pair; size and thresholds stay."""
    pairs = borrowed(pairs)
    for array in (pairs.gram, pairs.last):
        array[:] = 0.0
    pairs.regressors[:] = 0.0
    pairs.torques[:] = 0.0
    pairs.moment[:] = 0.0
    pairs.turns[:] = 0
    for counter in (COUNT, INSERTIONS, RANK, TURN):
        pairs.counters[counter] = 0
    pairs.counters[REVISION] += 1
    for figure in (SIGMA_MIN, TOLERANCE, ROUNDING):
        pairs.figures[figure] = 0.0
    clear_directions(pairs.directions)


@jit
def is_full(pairs: Pairs) -> bool:
    """Whether all P slots are filled."""
    pairs = borrowed(pairs)
    return bool(pairs.counters[COUNT] >= pairs.counters[SIZE])


@jit
def _add_moment(moment: np.ndarray, regressor: np.ndarray, torque: np.ndarray,
                sign: float) -> None:
    n, m = regressor.shape
    for k in range(n):
        weight = sign * torque[k]
        for i in range(m):
            moment[i] += weight * regressor[k, i]


@jit
def sum_again(pairs: Pairs) -> None:
    """Sum Q and the moment over the pairs."""
    pairs = borrowed(pairs)
    pairs.gram[:] = 0.0
    pairs.moment[:] = 0.0
    slots, n, m = pairs.regressors.shape
    count = pairs.counters[COUNT]
    add_square(pairs.gram, pairs.regressors.reshape(slots * n, m), count * n, 1.0)
    for slot in range(count):
        _add_moment(pairs.moment, pairs.regressors[slot], pairs.torques[slot], 1.0)
    pairs.figures[ROUNDING] = 0.0
    project_gram(pairs.directions, pairs.gram)


@jit
def sums_follow(pairs: Pairs, slot: int, regressor: np.ndarray, torque: np.ndarray) -> bool:
    """Let Q and the moment follow a replacement; False, and nothing, where they cannot.

    Only with rank full: in a deficient Q the rounding of earlier pairs would pass for rank.
    """
    pairs = borrowed(pairs)
    n, m = regressor.shape
    if pairs.counters[RANK] < m:
        return False
    before, figures = trace(pairs.gram), pairs.figures
    # Zeros in an empty slot.
    after = before + _square(regressor) - _square(pairs.regressors[slot])
    figures[ROUNDING] += EPSILON * max(before, after)
    if figures[ROUNDING] > min(UNITS * EPSILON * after, NEGLIGIBLE * figures[SIGMA_MIN]):
        return False
    add_square(pairs.gram, regressor, n, 1.0)
    add_square(pairs.gram, pairs.regressors[slot], n, -1.0)
    _add_moment(pairs.moment, regressor, torque, 1.0)
    _add_moment(pairs.moment, pairs.regressors[slot], pairs.torques[slot], -1.0)
    return True


@jit
def shift_torques(pairs: Pairs, change: np.ndarray) -> None:
    """Let the pairs be those of an arm whose θ* is another by ``change``, shape (m,)."""
    pairs = borrowed(pairs)
    n, m = pairs.last.shape
    for slot in range(pairs.counters[COUNT]):
        for k in range(n):
            row, total = pairs.regressors[slot, k], 0.0
            for i in range(m):
                total += row[i] * change[i]
            pairs.torques[slot, k] += total
    for i in range(m):
        row, total = pairs.gram[i], 0.0
        for j in range(m):
            total += row[j] * change[j]
        pairs.moment[i] += total
    pairs.counters[REVISION] += 1


@jit
def take_turn(pairs: Pairs, slot: int) -> None:
    """Make a slot the one whose turn comes last."""
    pairs = borrowed(pairs)
    pairs.counters[TURN] += 1
    pairs.turns[slot] = pairs.counters[TURN]


@jit
def store(pairs: Pairs, slot: int, regressor: np.ndarray, torque: np.ndarray) -> None:
    """Put a pair into a slot, the first empty one or one that is filled."""
    pairs = borrowed(pairs)
    if slot == pairs.counters[COUNT]:
        pairs.counters[COUNT] += 1
    take_turn(pairs, slot)
    assign(pairs.regressors[slot], regressor)
    assign(pairs.last, regressor)
    pairs.torques[slot] = torque
    pairs.counters[INSERTIONS] += 1
    pairs.counters[REVISION] += 1
    follow_slot(pairs.directions, slot, regressor)


@jit
def remove(pairs: Pairs, slot: int) -> None:
    """Take a pair away; the last one moves into its slot."""
    pairs = borrowed(pairs)
    pairs.counters[COUNT] -= 1
    last, directions = pairs.counters[COUNT], pairs.directions
    add_square(directions.gram, directions.seen[slot], pairs.last.shape[0], -1.0)
    for array in (pairs.regressors, directions.seen):
        assign(array[slot], array[last])
        array[last] = 0.0
    pairs.torques[slot] = pairs.torques[last]
    pairs.torques[last] = 0.0
    pairs.turns[slot] = pairs.turns[last]
    pairs.counters[REVISION] += 1


@jit
def trace(matrix: np.ndarray) -> float:
    """Return the sum of the diagonal."""
    total = 0.0
    for i in range(matrix.shape[0]):
        total += matrix[i, i]
    return total


@jit
def _square(regressor: np.ndarray) -> float:
    total = 0.0
    for k in range(regressor.shape[0]):
        for i in range(regressor.shape[1]):
            total += regressor[k, i] * regressor[k, i]
    return total


@jit
def rank_of(form: Tridiagonal, rows: int) -> tuple[int, float]:
    """Rank of a reduced sum over so many rows, and the rounding that it is told from."""
    form = borrowed(form)
    m = form.diagonal.size
    tolerance = max(m, rows) * EPSILON * max(largest_eigenvalue(form, m), 0.0)
    return m - count_up_to(form, m, tolerance), tolerance


@jit
def surely_full_rank(pairs: Pairs, sigma_min: float) -> bool:
    """Whether the tolerance of `rank_of` is below σ_min whatever the largest eigenvalue is."""
    pairs = borrowed(pairs)
    rows = pairs.counters[COUNT] * pairs.regressors.shape[1]
    return bool(sigma_min > max(pairs.moment.size, rows) * EPSILON * trace(pairs.gram))


@jit_apart
def measure(pairs: Pairs) -> None:
    """Set rank, its tolerance and σ_min, and in a full stack the weakest direction, from Q."""
    pairs = borrowed(pairs)
    m, form = pairs.moment.size, pairs.trial
    assign(form.matrix, pairs.gram)
    reduce(form, m)
    rank, tolerance = rank_of(form, pairs.counters[COUNT] * pairs.regressors.shape[1])
    pairs.counters[RANK] = rank
    pairs.figures[TOLERANCE] = tolerance
    pairs.figures[SIGMA_MIN] = smallest_eigenvalue(form, m) if rank == m else 0.0
    if rank == m and is_full(pairs):
        eigenvector(form, m, pairs.figures[SIGMA_MIN], pairs.directions.weakest)
        set_weakest(pairs.directions, pairs.regressors, pairs.gram, pairs.counters[COUNT])
