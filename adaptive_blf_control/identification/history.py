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

    What follows may as well be attributes.
    """

    @property
    @abstractmethod
    def regressors(self) -> np.ndarray:
        """Y_fj, shape (at least ``count``, n, m), zero where no pair is."""
        ...

    @property
    @abstractmethod
    def torques(self) -> np.ndarray:
        """τ_fj, shape (at least ``count``, n) [N·m], likewise."""
        ...

    @property
    @abstractmethod
    def gram(self) -> np.ndarray:
        """Q = Σ Y_fjᵀ Y_fj, shape (m, m)."""
        ...

    @property
    @abstractmethod
    def moment(self) -> np.ndarray:
        """Σ Y_fjᵀ τ_fj, shape (m,)."""
        ...

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of pairs that it holds when it is full."""
        ...

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of pairs that it holds."""
        ...

    @property
    @abstractmethod
    def insertions(self) -> int:
        """Number of pairs taken since it was empty."""
        ...

    @property
    @abstractmethod
    def revision(self) -> int:
        """Another number whenever the pairs are others."""
        ...

    @property
    @abstractmethod
    def rank(self) -> int:
        """Rank of Q."""
        ...

    @property
    @abstractmethod
    def sigma_min(self) -> float:
        """Smallest eigenvalue of Q, 0 where the rank is not full."""
        ...

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
