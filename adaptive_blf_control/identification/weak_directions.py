# SPDX-License-Identifier: Apache-2.0
"""A few directions in which a history stack is weakest, kept from one candidate to the next.

For W with orthonormal rows, λ_min(W A Wᵀ) bounds λ_min(A) from above (Rayleigh and Ritz). The rows
of W are the weakest directions of the last matrices whose smallest eigenvalue was computed. What
they see of every pair, Y_j Wᵀ, is kept beside them, so the bound for a replacement is an
eigenvalue problem of their number instead of m.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import add_multiple, borrowed, dot, jit
from adaptive_blf_control.identification.squares import (
    add_square,
    energy,
    project,
    seen_square,
)
from adaptive_blf_control.identification.tridiagonal import Tridiagonal, tridiagonal

__all__ = ['add_direction', 'clear_directions', 'Directions', 'follow_slot', 'new_directions',
           'project_gram', 'set_weakest', 'SET']

MOST = 20  # directions: with more of them a bound costs more than it saves; for up to as many
# parameters none are kept, as then a bound costs what the answer does
KNOWN = 1e-8  # a direction of which less is outside of W has no place in it

SET, NEXT = range(2)  # elements of `Directions.counters`


class Directions(NamedTuple):
    """K directions W, what they see, and room for the search in them.

    Attributes:
        basis: W, shape (K, m), of which ``counters[SET]`` rows are set.
        seen: Y_j Wᵀ for every slot, shape (slots, n, K).
        gram: W Q Wᵀ, shape (K, K).
        counters: By name: rows of W that are SET, and the one that is replaced NEXT.
        weakest: A unit vector u in which Q is weakest, shape (m,).
        strength: uᵀQu, shape (1,).
        energies: ‖Y_j u‖² for every slot, shape (slots,).
        candidate: Y Wᵀ of a candidate, shape (n, K).
        vector: A direction, shape (m,).
        weights: A direction in terms of W, shape (K,).
        best: The weakest direction after the best replacement, shape (m,).
        bounds: What the σ_min after each replacement cannot exceed, shape (slots,).
        stages: How each bound is known, shape (slots,).
        form: Room for a matrix in the directions W.
        work: Shape (2, m).
    """

    basis: np.ndarray
    seen: np.ndarray
    gram: np.ndarray
    counters: np.ndarray
    weakest: np.ndarray
    strength: np.ndarray
    energies: np.ndarray
    candidate: np.ndarray
    vector: np.ndarray
    weights: np.ndarray
    best: np.ndarray
    bounds: np.ndarray
    stages: np.ndarray
    form: Tridiagonal
    work: np.ndarray


def new_directions(n: int, m: int, slots: int) -> Directions:
    """Return room for the directions of a stack of ``slots`` pairs, none of them set."""
    size = min(MOST, m)
    return Directions(
        basis=np.zeros((size, m)), seen=np.zeros((slots, n, size)), gram=np.zeros((size, size)),
        counters=np.zeros(2, dtype=np.int64), weakest=np.zeros(m), strength=np.zeros(1),
        energies=np.zeros(slots), candidate=np.zeros((n, size)), vector=np.zeros(m),
        weights=np.zeros(size), best=np.zeros(m), bounds=np.zeros(slots),
        stages=np.zeros(slots, dtype=np.int64), form=tridiagonal(size), work=np.zeros((2, m)))


@jit
def clear_directions(directions: Directions) -> None:
    """Forget all directions."""
    directions = borrowed(directions)
    directions.counters[:] = 0
    directions.basis[:] = 0.0
    directions.seen[:] = 0.0
    directions.gram[:] = 0.0


@jit
def set_weakest(directions: Directions, regressors: np.ndarray, gram: np.ndarray,
                count: int) -> None:
    """Take over what ``weakest`` sees of Q and of ``count`` pairs, and the direction into W.

    With no more than `MOST` parameters W stays empty.
    """
    directions = borrowed(directions)
    m = directions.weakest.size
    directions.strength[0] = energy(gram, directions.weakest, m)
    for slot in range(count):
        directions.energies[slot] = seen_square(regressors[slot], directions.weakest, m)
    if m > MOST:
        add_direction(directions, directions.weakest, regressors, gram, count)


@jit
def add_direction(directions: Directions, direction: np.ndarray, regressors: np.ndarray,
                  gram: np.ndarray, count: int) -> None:
    """Take a unit vector, shape (m,), into W in place of the row that is there longest."""
    directions = borrowed(directions)
    m, row = direction.size, directions.counters[NEXT]
    vector = directions.work[0]
    vector[:] = direction
    for _ in range(2):  # Gram and Schmidt, twice is enough
        for i in range(directions.counters[SET]):
            if i != row:
                part = dot(directions.basis[i], vector, m)
                add_multiple(vector, -part, directions.basis[i], m)
        norm = math.sqrt(dot(vector, vector, m))
        if not norm > KNOWN:
            return
        for k in range(m):
            vector[k] /= norm
    directions.basis[row] = vector
    directions.counters[SET] = max(directions.counters[SET], row + 1)
    directions.counters[NEXT] = (row + 1) % directions.basis.shape[0]
    for slot in range(count):
        for k in range(regressors.shape[1]):
            directions.seen[slot, k, row] = dot(regressors[slot, k], vector, m)
    _project_row(directions, gram, row)


@jit
def _project_row(directions: Directions, gram: np.ndarray, row: int) -> None:
    """Set one row and column of W Q Wᵀ."""
    directions = borrowed(directions)
    m, basis = gram.shape[0], directions.basis
    image = directions.work[1]
    for i in range(m):
        image[i] = dot(gram[i], basis[row], m)
    for k in range(directions.counters[SET]):
        value = dot(basis[k], image, m)
        directions.gram[row, k] = directions.gram[k, row] = value


@jit
def project_gram(directions: Directions, gram: np.ndarray) -> None:
    """Set W Q Wᵀ."""
    directions = borrowed(directions)
    for row in range(directions.counters[SET]):
        _project_row(directions, gram, row)


@jit
def follow_slot(directions: Directions, slot: int, regressor: np.ndarray) -> None:
    """Let what W sees follow a replacement."""
    directions = borrowed(directions)
    count = directions.counters[SET]
    if count == 0:
        return
    add_square(directions.gram, directions.seen[slot], regressor.shape[0], -1.0)
    project(regressor, directions.basis, count, directions.seen[slot])
    add_square(directions.gram, directions.seen[slot], regressor.shape[0], 1.0)
