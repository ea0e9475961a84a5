# SPDX-License-Identifier: Apache-2.0
"""History stack of filtered pairs with the paper's Algorithm 1, selection exact and pruned.

The stack holds P pairs (Y_f, τ_f); their prediction errors are re-evaluated with the present θ̂,
as the proof of Theorem 1 needs. σ_min is that of Q = H Hᵀ = Σ Y_fjᵀ Y_fj (Assumption 2).
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError

__all__ = ['HistoryStack', 'best_replacement', 'is_different', 'squared_projections']

EPSILON = 2.220446049250313e-16
# Q may follow from the one before while what rounding has left in it is surely below this part
# of σ_min and this many units in its last place; otherwise it is summed anew.
NEGLIGIBLE = 1e-6
UNITS = 16.0


@jit
def is_different(candidate: np.ndarray, last: np.ndarray, epsilon: float) -> bool:
    """Algorithm 1, lines 2 and 8: ‖Y_f − Y_last‖₂ ≥ ε ‖Y_f‖₂ in the spectral norm."""
    difference = candidate - last
    # ‖·‖_F / √n ≤ ‖·‖₂ ≤ ‖·‖_F settles most cases without an eigenvalue problem.
    d2 = np.sum(difference * difference)
    c2 = np.sum(candidate * candidate)
    n = candidate.shape[0]
    if not 0.0 < c2 < np.inf or d2 < epsilon * epsilon * c2 / n:
        return False
    if d2 / n >= epsilon * epsilon * c2:
        return True
    top = np.linalg.eigvalsh(np.dot(difference, difference.T))[-1]
    return bool(top >= epsilon * epsilon * np.linalg.eigvalsh(np.dot(candidate, candidate.T))[-1])


@jit
def squared_projections(regressors: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return ‖Y_l u‖² for every slot l of ``regressors``, shape (P, n, m) → (P,)."""
    slots, n, m = regressors.shape
    y = np.dot(regressors.reshape(slots * n, m), u).reshape(slots, n)
    return np.sum(y * y, axis=1)


@jit
def _inverse_iteration(matrix: np.ndarray, shift: float, v: np.ndarray,
                       steps: int) -> np.ndarray:
    """Turn the unit vector v, (m,), towards eigenvectors with eigenvalues near ``shift``."""
    shifted = matrix - shift * np.eye(v.size)
    for _ in range(steps):
        v = np.linalg.solve(shifted, v)
        v = v / np.sqrt(np.sum(v * v))
    return v


@jit
def best_replacement(candidate: np.ndarray, regressors: np.ndarray, gram: np.ndarray,
                     sigma_min: float, bounds: np.ndarray) -> int:
    """Lines 9-15 of Algorithm 1: the slot whose replacement gives the largest σ_min.

    For any unit vector v, vᵀ(Q + YᵀY)v − ‖Y_l v‖² bounds the σ_min that slot l would give from
    above. Slots are visited in the order of their bounds; the weakest direction of each trial
    sharpens the bounds of all others that are still open, and the search ends when none can beat
    the best found: the answer of the brute-force search after one or two eigenvalue problems
    instead of P. A slot that only seemed good is recognised by an inverse iteration, which costs
    a quarter of an eigenvalue problem; how well that converges decides on the time, never on the
    answer.

    Args:
        candidate: Y, shape (n, m).
        regressors: The full stack, shape (P, n, m).
        gram: Q, shape (m, m).
        sigma_min: What the smallest eigenvalue must reach at least, that of Q or more.
        bounds: Upper bounds to start from, shape (P,); overwritten.

    Returns:
        The slot, or −1 where no replacement reaches ``sigma_min``.
    """
    n, m = candidate.shape
    best, best_slot = sigma_min, -1
    grown = gram + np.dot(candidate.T, candidate)
    margin = 1e-12 * np.trace(grown)  # keeps the shifted matrices from being exactly singular
    v = np.full(m, 1.0 / np.sqrt(m))
    while True:
        slot = int(np.argmax(bounds))
        bound = bounds[slot]
        if bound < best or (best_slot >= 0 and bound == best):
            return best_slot
        bounds[slot] = -np.inf
        old = regressors[slot]
        trial = grown - np.dot(old.T, old)
        v = _inverse_iteration(trial, 0.99 * best - margin, v, 2)
        if np.dot(v, np.dot(trial, v)) >= (1.0 - 1e-12) * best:  # v does not rule the slot out
            value = np.linalg.eigvalsh(trial)[0]
            if value > best or (value == best and best_slot < 0):
                best, best_slot = value, slot
            v = _inverse_iteration(trial, value - margin, v, 1)
        still_open = np.flatnonzero(bounds >= best)
        seen = squared_projections(regressors[still_open], v)
        bounds[still_open] = np.minimum(bounds[still_open], np.dot(v, np.dot(grown, v)) - seen)


@jit
def _rank_tolerance(eigenvalues: np.ndarray, rows: int) -> float:
    # The rounding of an eigenvalue of a sum over so many rows.
    return float(max(eigenvalues.size, rows) * EPSILON * max(eigenvalues[-1], 0.0))


class HistoryStack:
    """P pairs chosen for a large σ_min(H Hᵀ); rank and σ_min are known at every moment.

    Attributes:
        gram: Q = Σ Y_fjᵀ Y_fj, shape (m, m).
        moment: Σ Y_fjᵀ τ_fj, shape (m,).
        count: Number of filled slots.
        insertions: Number of pairs taken so far, replacements included.
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
            epsilon: ε, relative difference of a new pair to the last one taken.
            minimum_growth: Part of σ_min by which a replacement must raise it; 0 asks only that
                it does not fall, as Algorithm 1 does.
        """
        if size < 1:
            raise ParameterError('identifier.history.size', size, 'at least 1 pair')
        if not epsilon >= 0.0:
            raise ParameterError('identifier.history.epsilon', epsilon, 'a threshold >= 0')
        if not (math.isfinite(minimum_growth) and minimum_growth >= 0.0):
            raise ParameterError('identifier.history.minimum_growth', minimum_growth,
                                 'a finite part >= 0')
        self.size = size
        self.minimum_growth = minimum_growth
        self.epsilon = epsilon
        self._shape = (n, m)
        self.clear()

    def clear(self) -> None:
        """Forget every pair."""
        n, m = self._shape
        self.regressors = np.zeros((self.size, n, m))
        self.torques = np.zeros((self.size, n))
        self.gram = np.zeros((m, m))
        self.moment = np.zeros(m)
        self.count = 0
        self.insertions = 0
        self.rank = 0
        self.sigma_min = 0.0
        self._last = np.zeros((n, m))
        self._oldest = 0
        self._rounding = 0.0
        self._weakest = np.zeros(m)
        self._weakest_projections = np.zeros(self.size)
        self._least_projection = 0.0

    @property
    def full(self) -> bool:
        """Whether all P slots are filled."""
        return self.count == self.size

    def offer(self, regressor: np.ndarray, torque: np.ndarray) -> int:
        """Offer a pair to Algorithm 1.

        Args:
            regressor: Y_f, shape (n, m).
            torque: τ_f, shape (n,) [N·m].

        Returns:
            The slot that was filled or replaced, −1 where the pair was not taken.
        """
        if not is_different(regressor, self._last, self.epsilon):
            return -1
        slot = self._select(regressor) if self.full else self.count
        if slot >= 0:
            self._put(slot, regressor, torque)
        return slot

    def _select(self, regressor: np.ndarray) -> int:
        """Slot whose replacement gives the largest σ_min, if that grows enough; else −1."""
        if self.rank < self._shape[1]:
            return self._select_deficient(regressor)
        y = regressor @ self._weakest
        gain = float(y @ y)
        wanted = (1.0 + self.minimum_growth) * self.sigma_min
        # Not enough along the weakest direction, whichever pair goes.
        if self.sigma_min + gain - self._least_projection < wanted:
            return -1
        return int(best_replacement(regressor, self.regressors, self.gram, wanted,
                                    self.sigma_min + gain - self._weakest_projections))

    def _select_deficient(self, regressor: np.ndarray) -> int:
        """While σ_min is 0 every slot ties: the oldest goes, unless the rank would fall."""
        slot = self._oldest
        trial = self.regressors.copy()
        trial[slot] = regressor
        stacked = trial.reshape(-1, self._shape[1])
        values = np.linalg.eigvalsh(stacked.T @ stacked)
        if np.count_nonzero(values > _rank_tolerance(values, len(stacked))) >= self.rank:
            return slot
        self._oldest = (slot + 1) % self.size  # indispensable: look at the next one next time
        return -1

    def _put(self, slot: int, regressor: np.ndarray, torque: np.ndarray) -> None:
        sums = self._running_sums(slot, regressor, torque)
        if slot == self.count:
            self.count += 1
        elif slot == self._oldest:
            self._oldest = (slot + 1) % self.size
        self.regressors[slot] = regressor
        self.torques[slot] = torque
        self.insertions += 1
        self._last = regressor.copy()
        if sums is None:
            stacked = self.regressors[:self.count].reshape(-1, self._shape[1])
            sums = stacked.T @ stacked, self.torques[:self.count].reshape(-1) @ stacked
            self._rounding = 0.0
        self.gram, self.moment = sums
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
            self._weakest = np.ascontiguousarray(vectors[:, 0])
            self._weakest_projections = squared_projections(self.regressors, self._weakest)
            self._least_projection = float(np.min(self._weakest_projections))
        else:  # nothing is selected yet: no vectors needed, less than half the time
            values = np.linalg.eigvalsh(self.gram)
        tolerance = _rank_tolerance(values, self.count * self._shape[0])
        self.rank = int(np.count_nonzero(values > tolerance))
        self.sigma_min = float(values[0]) if values[0] > tolerance else 0.0
