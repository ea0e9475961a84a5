# SPDX-License-Identifier: Apache-2.0
"""What a history is to the identifier: recorded pairs, chosen by Algorithm 1 or otherwise."""

from __future__ import annotations

from abc import abstractmethod
from typing import Protocol

import numpy as np

__all__ = ['History', 'SELECTIONS']

SELECTIONS = ('algorithm_1',)
"""The names of our ways to select pairs."""


class History(Protocol):
    """Recorded pairs (Y_f, τ_f), made as ``history(arm, settings)``.

    θ̂ converges once its rank is m (Theorem 1), the faster the larger σ_min.

    Attributes:
        regressors: Y_fj, shape (at least ``count``, n, m), zero where no pair is.
        torques: τ_fj, shape (at least ``count``, n) [N·m], likewise.
        gram: Q = Σ Y_fjᵀ Y_fj, shape (m, m).
        moment: Σ Y_fjᵀ τ_fj, shape (m,).
        size: Number of pairs that it holds when it is full.
        count: Number of pairs that it holds.
        insertions: Number of pairs taken since it was empty.
        revision: Another number whenever the pairs are others.
        rank: Rank of Q.
        sigma_min: Smallest eigenvalue of Q, 0 where the rank is not full.
    """

    regressors: np.ndarray
    torques: np.ndarray
    gram: np.ndarray
    moment: np.ndarray
    size: int
    count: int
    insertions: int
    revision: int
    rank: int
    sigma_min: float

    @abstractmethod
    def offer(self, regressor: np.ndarray, torque: np.ndarray) -> int:
        """Take a pair, or not.

        Args:
            regressor: Y_f, shape (n, m); a copy of it is kept.
            torque: τ_f, shape (n,) [N·m]; likewise.

        Returns:
            The slot that was filled or replaced, −1 where the pair was not taken.
        """
        ...

    @abstractmethod
    def clear(self) -> None:
        """Forget every pair: the arm has changed."""
        ...

    @abstractmethod
    def retune(self, size: int, epsilon: float, minimum_growth: float) -> None:
        """Use other values of the parameters of ``history`` that have these names.

        The recorded pairs stay. The values have been checked.
        """
        ...
