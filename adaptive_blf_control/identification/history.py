# SPDX-License-Identifier: Apache-2.0
"""What a history is to the identifier: recorded pairs, chosen by Algorithm 1 or otherwise."""

from __future__ import annotations

from abc import abstractmethod
from typing import Protocol

import numpy as np

from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.compiled import by_type

__all__ = ['History', 'SELECTIONS', 'UNJUDGED', 'facts', 'forget_pairs', 'offer', 'pairs', 'sums']

SELECTIONS = ('algorithm_1',)
"""The names of our ways to select pairs."""


class History(Protocol):
    """Recorded pairs (Y_f, τ_f), made as ``history(arm, settings)``.

    θ̂ converges once its rank is m (Theorem 1), the faster the larger σ_min.

    The properties below may as well be plain attributes.
    """

    @property
    @abstractmethod
    def regressors(self) -> np.ndarray:
        """Y_fj, shape (at least ``count``, n, m), zero in slots without a pair."""
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
        """A number that changes whenever the recorded pairs do."""
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
        """Consider a pair: take it or leave it.

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
        """Take new values of the parameters of ``history`` with these names, already checked.

        The recorded pairs stay.
        """
        ...


# What compiled functions ask of a history, by its type; here of one in Python.


UNJUDGED = -2
"""What `offer` returns for a pair that LAPACK could not judge."""


@by_type
def offer(history: History, regressor: np.ndarray, torque: np.ndarray) -> int:
    """Offer a pair, see `History.offer`."""
    try:
        return history.offer(regressor, torque)
    except np.linalg.LinAlgError:
        return UNJUDGED


@by_type
def forget_pairs(history: History) -> None:
    """Forget every pair."""
    history.clear()


@by_type
def facts(history: History) -> tuple[int, int, int, int]:
    """Return count, size, rank and revision."""
    return history.count, history.size, history.rank, history.revision


@by_type
def pairs(history: History) -> tuple[np.ndarray, np.ndarray]:
    """Return the regressors, shape (P, n, m), and torques, shape (P, n), of a full history."""
    return history.regressors, history.torques


@by_type
def sums(history: History) -> tuple[np.ndarray, np.ndarray]:
    """Return Q, shape (m, m), and Σ Y_fjᵀ τ_fj, shape (m,); ParameterError for other shapes."""
    name = type(history).__name__
    gram = checked_array(f'{name}.gram', history.gram, (-1, -1))
    if gram.shape[0] != gram.shape[1]:
        gram = checked_array(f'{name}.gram', gram, (gram.shape[1],) * 2)
    return gram, checked_array(f'{name}.moment', history.moment, gram.shape[:1])
