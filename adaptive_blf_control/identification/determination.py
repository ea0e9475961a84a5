# SPDX-License-Identifier: Apache-2.0
"""Which parameters the recorded data determine, and which they leave open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ['WEAKEST', 'undetermined']

WEAKEST = 1e-10
"""Eigenvalue of the scaled Q, relative to its largest, that counts as no information: the motion
shows that direction 10⁵ times less than the strongest one. The same holds for a column of Y before
it is scaled: noise on the velocity of a joint that stands still shows nothing of its friction."""
_PART = 1e-3  # of a parameter that may lie in such directions: rounding


def undetermined(gram: np.ndarray, names: Sequence[str], weakest: float = WEAKEST,
                 rank: int | None = None) -> tuple[str, ...]:
    """Return the names of the parameters that Q = Σ Y_fjᵀ Y_fj leaves open, in their order.

    Q is scaled to a unit diagonal, which makes parameters of different units comparable. With N
    its eigenvectors of eigenvalues below ``weakest`` times the largest, parameter i can change by
    any amount along N without a change of the predicted torque where row i of N is not zero.

    Args:
        gram: Q, shape (m, m).
        names: Of the parameters, length m.
        weakest: See `WEAKEST`.
        rank: Rank of Q where it is known: as many of its weakest directions as it lacks are open
            as well.
    """
    scale = np.sqrt(np.diag(gram))
    shown = (scale > 0.0) & (scale ** 2 >= weakest * np.max(scale ** 2, initial=0.0))
    missing = ~shown
    if shown.any():
        scaled = gram[np.ix_(shown, shown)] / np.outer(scale[shown], scale[shown])
        values, vectors = np.linalg.eigh(scaled)
        open_part = np.linalg.norm(vectors[:, values < weakest * values[-1]], axis=1)
        missing[shown] = open_part > _PART
    if rank is not None and rank < len(names) and not missing.any():
        _, vectors = np.linalg.eigh(gram)
        missing = np.linalg.norm(vectors[:, :len(names) - rank], axis=1) > _PART
    return tuple(name for name, open_ in zip(names, missing) if open_)
