# SPDX-License-Identifier: Apache-2.0
"""History stack of filtered pairs with the paper's Algorithm 1, selection exact and pruned.

The stack holds P pairs (Y_f, τ_f); their prediction errors are re-evaluated with the present θ̂,
as the proof of Theorem 1 needs. σ_min is that of Q = H Hᵀ = Σ Y_fjᵀ Y_fj (Assumption 2).
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.pair_selection import (
    best_replacement,
    EPSILON,
    is_different,
    lost_ranks,
    rank_tolerance,
    squared_projections,
)

__all__ = ['HistoryStack', 'best_replacement', 'is_different', 'squared_projections']

# Q may follow from the one before while what rounding has left in it is surely below this part
# of σ_min and this many units in its last place; otherwise it is summed anew.
NEGLIGIBLE = 1e-6
UNITS = 16.0


def _with_slots(array: np.ndarray, count: int, slots: int) -> np.ndarray:
    """Return a copy of the first ``count`` of ``array``, followed by zeros up to ``slots``."""
    result = np.zeros((slots, *array.shape[1:]), dtype=array.dtype)
    result[:count] = array[:count]
    return result


class HistoryStack:
    """P pairs chosen for a large σ_min(H Hᵀ); rank and σ_min are known at every moment.

    Attributes:
        size: P. After :meth:`resize` to fewer than there are, ``count`` comes down to it.
        regressors: Y_fj, shape (max(P, count), n, m), of which ``count`` are filled.
        torques: τ_fj, shape (max(P, count), n) [N·m].
        gram: Q = Σ Y_fjᵀ Y_fj, shape (m, m).
        moment: Σ Y_fjᵀ τ_fj, shape (m,).
        count: Number of filled slots.
        insertions: Number of pairs taken so far, replacements included.
        revision: Differs whenever the pairs differ.
        rank: Rank of Q.
        sigma_min: Smallest eigenvalue of Q; 0 where Q is numerically singular.
    """

    def __init__(self, n: int, m: int, size: int, epsilon: float,
                 minimum_growth: float = 0.0) -> None:
        """Set up an empty stack.

        Args:
            n: Number of joints.
            m: Number of parameters.
            size: P, number of pairs.
            epsilon: ε, relative difference of a new pair to the last one taken, 0..1: the first
                pair of all differs from nothing by 1.
            minimum_growth: Part of σ_min by which a replacement must raise it; 0 asks only that
                it does not fall, as Algorithm 1 does.
        """
        self._check(size, epsilon, minimum_growth)
        self.size = size
        self.minimum_growth = minimum_growth
        self.epsilon = epsilon
        self.revision = 0
        self._shape = (n, m)
        self.clear()

    @staticmethod
    def _check(size: int, epsilon: float, minimum_growth: float) -> None:
        if size < 1:
            raise ParameterError('identifier.history.size', size, 'at least 1 pair')
        if not 0.0 <= epsilon <= 1.0:
            raise ParameterError('identifier.history.epsilon', epsilon,
                                 'a threshold >= 0 and <= 1, the difference to an empty history')
        if not (math.isfinite(minimum_growth) and minimum_growth >= 0.0):
            raise ParameterError('identifier.history.minimum_growth', minimum_growth,
                                 'a finite part >= 0')

    def clear(self) -> None:
        """Forget every pair."""
        n, m = self._shape
        self.regressors = np.zeros((self.size, n, m))
        self.torques = np.zeros((self.size, n))
        self.gram = np.zeros((m, m))
        self.moment = np.zeros(m)
        self.count = 0
        self.insertions = 0
        self.revision += 1
        self.rank = 0
        self.sigma_min = 0.0
        self._last = np.zeros((n, m))
        # Which slot has its turn: the one filled or passed over longest ago.
        self._turns = np.zeros(self.size, dtype=np.int64)
        self._turn = 0
        self._rounding = 0.0
        self._tolerance = 0.0
        self._values = np.zeros(m)
        self._vectors = np.zeros((m, m))
        self._weakest = np.zeros(m)
        self._weakest_projections = np.zeros(self.size)
        self._least_projection = 0.0

    def retune(self, size: int, epsilon: float, minimum_growth: float) -> None:
        """Change the settings, all or none; for ``size`` see :meth:`resize`."""
        self._check(size, epsilon, minimum_growth)
        self.resize(size)
        self.epsilon = epsilon
        self.minimum_growth = minimum_growth

    def resize(self, size: int) -> None:
        """Change P. A larger stack keeps all pairs and appends again.

        A smaller one keeps the best: pairs leave one at a time, each time the one whose absence
        leaves the largest σ_min; while σ_min is 0 the oldest of those that cost the least rank.
        That takes an eigenvalue problem or two for each, so one leaves with every call of
        :meth:`offer`, and no pair is taken until P are left.
        """
        self._check(size, self.epsilon, self.minimum_growth)
        if size != self.size:
            self.size = size
            self._resize_arrays()
            if self.full:
                self._measure()

    def _resize_arrays(self) -> None:
        slots = max(self.size, self.count)
        self.regressors = _with_slots(self.regressors, self.count, slots)
        self.torques = _with_slots(self.torques, self.count, slots)
        self._turns = _with_slots(self._turns, self.count, slots)

    @property
    def full(self) -> bool:
        """Whether all P slots are filled."""
        return self.count >= self.size

    @property
    def shrinking(self) -> bool:
        """Whether pairs still have to leave after :meth:`resize`."""
        return self.count > self.size

    def offer(self, regressor: np.ndarray, torque: np.ndarray) -> int:
        """Offer a pair to Algorithm 1; while the stack is :attr:`shrinking` one leaves instead.

        Args:
            regressor: Y_f, shape (n, m).
            torque: τ_f, shape (n,) [N·m].

        Returns:
            The slot that was filled or replaced, −1 where the pair was not taken.
        """
        if self.shrinking:
            self._remove(self._least_missed())
            return -1
        if not is_different(regressor, self._last, self.epsilon):
            return -1
        slot = self._select(regressor) if self.full else self.count
        if slot >= 0:
            self._put(slot, regressor, torque)
        return slot

    def _select(self, regressor: np.ndarray) -> int:
        """Slot whose replacement gives the largest σ_min, if that grows enough; else −1."""
        if self.rank < self._shape[1]:
            slot = self._select_for_rank(regressor)
            return slot if slot >= 0 else self._select_oldest(regressor)
        y = regressor @ self._weakest
        gain = float(y @ y)
        wanted = (1.0 + self.minimum_growth) * self.sigma_min
        # Not enough along the weakest direction, whichever pair goes.
        if self.sigma_min + gain - self._least_projection < wanted:
            return -1
        return int(best_replacement(regressor, self.regressors, self.gram, wanted,
                                    self.sigma_min + gain - self._weakest_projections))

    def _select_for_rank(self, regressor: np.ndarray) -> int:
        """While σ_min is 0: the slot whose replacement makes the rank largest, if it grows."""
        m = self._shape[1]
        outside = regressor @ self._vectors[:, :m - self.rank]
        if np.sum(outside * outside) <= self._tolerance:  # nothing that Q does not have
            return -1
        values, vectors = np.linalg.eigh(self.gram + regressor.T @ regressor)
        rows = (self.count + 1) * self._shape[0]
        rank = int(np.count_nonzero(values > rank_tolerance(values, rows)))
        lost = lost_ranks(self.regressors, values, vectors, rank)
        slot = self._oldest(lost == lost.min())
        grows = rank - lost[slot] > self.rank and self._rank_with(slot, regressor) > self.rank
        return slot if grows else -1

    def _select_oldest(self, regressor: np.ndarray) -> int:
        """While σ_min is 0 and the rank stays: the oldest goes, unless the rank would fall."""
        slot = self._oldest(np.ones(self.count, dtype=bool))
        if self._rank_with(slot, regressor) >= self.rank:
            return slot
        self._take_turn(slot)  # indispensable: look at the next one next time
        return -1

    def _rank_with(self, slot: int, regressor: np.ndarray) -> int:
        """Rank with another regressor in ``slot``; a huge pair leaves its rounding with it."""
        trial = self.regressors.copy()
        trial[slot] = regressor
        stacked = trial.reshape(-1, self._shape[1])
        values = np.linalg.eigvalsh(stacked.T @ stacked)
        return int(np.count_nonzero(values > rank_tolerance(values, len(stacked))))

    def _least_missed(self) -> int:
        """Slot whose absence leaves the largest σ_min, or the oldest that costs the least rank."""
        if self.rank == self._shape[1]:
            slot = best_replacement(np.zeros(self._shape), self.regressors, self.gram,
                                    self._tolerance, self.sigma_min - self._weakest_projections)
            if slot >= 0:
                return int(slot)
        lost = lost_ranks(self.regressors, self._values, self._vectors, self.rank)
        return self._oldest(lost == lost.min())

    def _oldest(self, among: np.ndarray) -> int:
        slots = np.flatnonzero(among)
        return int(slots[np.argmin(self._turns[slots])])

    def _take_turn(self, slot: int) -> None:
        self._turn += 1
        self._turns[slot] = self._turn

    def _put(self, slot: int, regressor: np.ndarray, torque: np.ndarray) -> None:
        sums = self._running_sums(slot, regressor, torque)
        if slot == self.count:
            self.count += 1
        self._take_turn(slot)
        self.regressors[slot] = regressor
        self.torques[slot] = torque
        self.insertions += 1
        self._last = regressor.copy()
        self._take_over(sums)

    def _remove(self, slot: int) -> None:
        """Take a pair away; the last one moves into its slot."""
        n, m = self._shape
        sums = self._running_sums(slot, np.zeros((n, m)), np.zeros(n))
        self.count -= 1
        for array in (self.regressors, self.torques, self._turns):
            array[slot] = array[self.count]
        if self.shrinking:  # views: nothing is copied until the last one has left
            self.regressors = self.regressors[:self.count]
            self.torques = self.torques[:self.count]
            self._turns = self._turns[:self.count]
        else:
            self._resize_arrays()
        self._take_over(sums)
        # Without the pair σ_min may have fallen among what its rounding left in Q.
        if self._rounding > NEGLIGIBLE * self.sigma_min:
            self._take_over(None)

    def _take_over(self, sums: tuple[np.ndarray, np.ndarray] | None) -> None:
        """Set Q and the moment, summed anew where None is given, and what follows from them."""
        if sums is None:
            stacked = self.regressors[:self.count].reshape(-1, self._shape[1])
            sums = stacked.T @ stacked, self.torques[:self.count].reshape(-1) @ stacked
            self._rounding = 0.0
        self.gram, self.moment = sums
        self.revision += 1
        self._measure()

    def _running_sums(self, slot: int, regressor: np.ndarray,
                      torque: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Return Q and the moment after a replacement, from those before; None to sum anew.

        Only with rank full: in a deficient Q the rounding of earlier pairs would pass for rank.
        """
        if self.rank < self._shape[1]:
            return None
        old, old_torque = self.regressors[slot], self.torques[slot]  # zeros in an empty slot
        gram = self.gram + regressor.T @ regressor - old.T @ old
        trace = float(np.trace(gram))
        self._rounding += EPSILON * max(trace, float(np.trace(self.gram)))
        if self._rounding > min(UNITS * EPSILON * trace, NEGLIGIBLE * self.sigma_min):
            return None
        return gram, self.moment + torque @ regressor - old_torque @ old

    def _measure(self) -> None:
        if self.full:
            values, vectors = np.linalg.eigh(self.gram)
            self._values, self._vectors = values, vectors
            self._weakest = np.ascontiguousarray(vectors[:, 0])
            self._weakest_projections = squared_projections(self.regressors, self._weakest)
            self._least_projection = float(np.min(self._weakest_projections))
        else:  # nothing is selected yet: no vectors needed, less than half the time
            values = np.linalg.eigvalsh(self.gram)
        self._tolerance = rank_tolerance(values, self.count * self._shape[0])
        self.rank = int(np.count_nonzero(values > self._tolerance))
        self.sigma_min = float(values[0]) if values[0] > self._tolerance else 0.0
