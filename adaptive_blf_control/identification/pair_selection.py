# SPDX-License-Identifier: Apache-2.0
"""Lines 9 to 15 of Algorithm 1: the replacement that gives the largest σ_min, exactly.

The candidate Y in place of pair l makes Q + YᵀY − Y_lᵀY_l. Its smallest eigenvalue is bounded from
above by what any direction sees of it, and better by its projection on several (Rayleigh and
Ritz). Slots are visited in the order of their bounds, cheap ones first: the weakest direction of
Q, then the projection on the kept `Directions`, then the whole matrix. Of both it is first asked
whether a direction sees too little, and only if none does for the smallest eigenvalue; each
gives a direction that sharpens the bounds of all other slots. With few parameters the
whole matrix is as cheap as its projection, so no `Directions` are kept. The search ends when no
bound exceeds the best σ_min found. How good the bounds are decides on the time, never on the
answer.
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.compiled import borrowed, dot, jit
from adaptive_blf_control.identification.definiteness import direction_below
from adaptive_blf_control.identification.squares import (
    add_square,
    assign,
    energy,
    project,
    seen_square,
)
from adaptive_blf_control.identification.stack_arrays import COUNT, Pairs, trace
from adaptive_blf_control.identification.tridiagonal import (
    eigenvector,
    EPSILON,
    largest_eigenvalue,
    reduce,
    smallest_eigenvalue,
    tridiagonal,
)
from adaptive_blf_control.identification.weak_directions import add_direction, Directions, SET

__all__ = ['best_replacement', 'is_different']

# How the bound of a slot is known: from single directions, from all of them, from one that was
# looked for in this slot, or exactly.
SINGLE, JOINT, SEEN, EXACT = range(4)


@jit
def is_different(candidate: np.ndarray, last: np.ndarray, epsilon: float) -> bool:
    """Algorithm 1, lines 2 and 8: ‖Y_f − Y_last‖₂ ≥ ε ‖Y_f‖₂ in the spectral norm."""
    n, m = candidate.shape
    d2, c2 = 0.0, 0.0
    for k in range(n):
        for i in range(m):
            difference = candidate[k, i] - last[k, i]
            d2 += difference * difference
            c2 += candidate[k, i] * candidate[k, i]
    # ‖·‖_F / √n ≤ ‖·‖₂ ≤ ‖·‖_F settles most cases without an eigenvalue problem.
    if not 0.0 < c2 < np.inf or d2 < epsilon * epsilon * c2 / n:
        return False
    if d2 / n >= epsilon * epsilon * c2:
        return True
    square = epsilon * epsilon * _spectral_square(candidate)
    return bool(_spectral_square(candidate - last) >= square)


@jit
def _spectral_square(matrix: np.ndarray) -> float:
    """‖A‖₂² of a matrix with few rows."""
    n, m = matrix.shape
    form = tridiagonal(n)
    for i in range(n):
        for j in range(n):
            form.matrix[i, j] = dot(matrix[i], matrix[j], m)
    reduce(form, n)
    return largest_eigenvalue(form, n)


@jit
def best_replacement(pairs: Pairs, candidate: np.ndarray, wanted: float) -> tuple[int, float]:
    """Return the slot whose replacement gives the largest σ_min, and that σ_min.

    With Y = 0 it is the search for the pair that is missed least. The weakest direction after
    the replacement is left in ``pairs.directions.best``.

    Args:
        pairs: A full stack of full rank whose weakest direction is known.
        candidate: Y, shape (n, m).
        wanted: What σ_min must reach at least, > 0.

    Returns:
        Slot −1 where no replacement reaches ``wanted``.
    """
    pairs = borrowed(pairs)
    directions, count = pairs.directions, pairs.counters[COUNT]
    m = pairs.moment.size
    gain = seen_square(candidate, directions.weakest, m)
    # Far above the rounding of Q, far below what matters.
    slack = 1e-14 * wanted + 2.0 * EPSILON * trace(pairs.gram)
    if not _bound_by_weakest(directions, count, gain + slack, wanted):
        return -1, 0.0
    assign(pairs.grown, pairs.gram)
    add_square(pairs.grown, candidate, candidate.shape[0], 1.0)
    slack += 2.0 * EPSILON * (trace(pairs.grown) - trace(pairs.gram))
    project(candidate, directions.basis, directions.counters[SET], directions.candidate)
    best, best_slot = wanted, -1
    projects = directions.counters[SET] > 0
    while True:
        slot = _most_promising(directions, count, best)
        if slot < 0:
            return best_slot, best
        stage = directions.stages[slot]
        if stage == SINGLE and projects:
            bound = _joint_bound(directions, slot, best - slack) + slack
            directions.bounds[slot] = min(directions.bounds[slot], bound)
            directions.stages[slot] = JOINT
            _sharpen(directions, count, best, slack)
            continue
        _set_trial(pairs, slot)
        if stage != SEEN and direction_below(pairs.trial, m, best - slack, directions.vector):
            directions.stages[slot] = SEEN
        else:
            value = _sigma_min(pairs)
            directions.stages[slot] = EXACT
            if value > best or (value == best and best_slot < 0):
                best, best_slot = value, slot
                directions.best[:] = directions.vector
        if projects:
            _take_in(pairs, candidate)
            _sharpen(directions, count, best, slack)
        else:
            _sharpen_by_vector(pairs, count, best, slack)


@jit
def _bound_by_weakest(directions: Directions, count: int, gain: float, wanted: float) -> bool:
    """Set the bounds by the weakest direction of Q; whether one of them leaves a slot open."""
    directions = borrowed(directions)
    promising = False
    for slot in range(count):
        bound = directions.strength[0] + gain - directions.energies[slot]
        directions.bounds[slot] = bound
        directions.stages[slot] = SINGLE
        promising = promising or bound >= wanted
    return promising


@jit
def _most_promising(directions: Directions, count: int, best: float) -> int:
    """Slot with the largest bound that reaches ``best``, −1 for none."""
    directions = borrowed(directions)
    found, largest = -1, best
    for slot in range(count):
        bound = directions.bounds[slot]
        if directions.stages[slot] != EXACT and (bound > largest or (found < 0
                                                                     and bound == largest)):
            found, largest = slot, bound
    return found


@jit
def _joint_bound(directions: Directions, slot: int, wanted: float) -> float:
    """Bound of the trial's σ_min by its projection on W; ``weights`` become its direction.

    It is the projection's smallest eigenvalue where that exceeds ``wanted``.
    """
    directions = borrowed(directions)
    size, form = directions.counters[SET], directions.form
    candidate, seen = directions.candidate, directions.seen[slot]
    for i in range(size):
        row = form.matrix[i]
        for j in range(i + 1):
            row[j] = directions.gram[i, j]
        for k in range(candidate.shape[0]):
            new, old = candidate[k], seen[k]
            a, b = new[i], old[i]
            for j in range(i + 1):
                row[j] += a * new[j] - b * old[j]
        for j in range(i):
            form.matrix[j, i] = row[j]
    if direction_below(form, size, wanted, directions.weights):
        return energy(form.matrix, directions.weights, size)
    reduce(form, size)
    value = smallest_eigenvalue(form, size)
    eigenvector(form, size, value, directions.weights)
    return value


@jit
def _set_trial(pairs: Pairs, slot: int) -> None:
    """Set ``trial`` to Q with the candidate in a slot."""
    pairs = borrowed(pairs)
    matrix = pairs.trial.matrix
    assign(matrix, pairs.grown)
    add_square(matrix, pairs.regressors[slot], pairs.last.shape[0], -1.0)


@jit
def _sigma_min(pairs: Pairs) -> float:
    """σ_min of ``trial``, which is used up; ``vector`` becomes the direction."""
    pairs = borrowed(pairs)
    form, m = pairs.trial, pairs.moment.size
    reduce(form, m)
    value = smallest_eigenvalue(form, m)
    eigenvector(form, m, value, pairs.directions.vector)
    return value


@jit
def _take_in(pairs: Pairs, candidate: np.ndarray) -> None:
    """Take ``vector`` into W; ``weights`` become the part of it that is in W, as a unit vector."""
    pairs = borrowed(pairs)
    directions, m = pairs.directions, candidate.shape[1]
    count = pairs.counters[COUNT]
    add_direction(directions, directions.vector, pairs.regressors, pairs.gram, count)
    size, square = directions.counters[SET], 0.0
    for i in range(size):
        weight = dot(directions.basis[i], directions.vector, m)
        directions.weights[i] = weight
        square += weight * weight
    for i in range(size):
        directions.weights[i] /= math.sqrt(square)
    project(candidate, directions.basis, size, directions.candidate)
    for slot in range(count):
        if directions.stages[slot] == JOINT:
            directions.stages[slot] = SINGLE  # W knows more than before


@jit
def _sharpen(directions: Directions, count: int, best: float, slack: float) -> None:
    """Lower the bounds of all open slots by what the direction ``weights`` sees."""
    directions = borrowed(directions)
    size, weights = directions.counters[SET], directions.weights
    strength = (energy(directions.gram, weights, size)
                + seen_square(directions.candidate, weights, size) + slack)
    for slot in range(count):
        if directions.stages[slot] != EXACT and directions.bounds[slot] >= best:
            bound = strength - seen_square(directions.seen[slot], weights, size)
            directions.bounds[slot] = min(directions.bounds[slot], bound)


@jit
def _sharpen_by_vector(pairs: Pairs, count: int, best: float, slack: float) -> None:
    """Lower the bounds of all open slots by what the direction ``vector`` sees."""
    pairs = borrowed(pairs)
    directions, m = pairs.directions, pairs.moment.size
    strength = energy(pairs.grown, directions.vector, m) + slack
    for slot in range(count):
        if directions.stages[slot] != EXACT and directions.bounds[slot] >= best:
            bound = strength - seen_square(pairs.regressors[slot], directions.vector, m)
            directions.bounds[slot] = min(directions.bounds[slot], bound)
