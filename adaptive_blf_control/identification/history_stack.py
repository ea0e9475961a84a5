# SPDX-License-Identifier: Apache-2.0
"""History stack of filtered pairs with the paper's Algorithm 1, selection exact and pruned.

The stack holds P pairs (Y_f, τ_f); their prediction errors are re-evaluated with the present θ̂,
as the proof of Theorem 1 needs. σ_min is that of Q = H Hᵀ = Σ Y_fjᵀ Y_fj (Assumption 2).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from adaptive_blf_control.compiled import handle
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.history_step import measure_pairs, offer_pair
from adaptive_blf_control.identification.pair_selection import is_different
from adaptive_blf_control.identification.stack_arrays import (
    clear_pairs,
    COUNT,
    GROWTH,
    INSERTIONS,
    is_full,
    new_pairs,
    RANK,
    REVISION,
    SIGMA_MIN,
    SIZE,
    THRESHOLD,
    with_slots,
)
from adaptive_blf_control.parameters.guided import Guided

__all__ = ['HistoryStack']


class HistoryStack(Guided, instead={
        **dict.fromkeys(('size =', 'epsilon =', 'minimum_growth ='),
                        'retune(history={...}) of its identifier changes it'),
        'pairs =': 'it is filled by what the identifier is given'}):
    """P pairs chosen for a large σ_min(H Hᵀ); rank and σ_min are known at every moment.

    Arrays are views of :attr:`pairs`, to be read; the next :meth:`offer` changes them in place.

    Attributes:
        pairs: The arrays themselves, for compiled functions.
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
        self.pairs = new_pairs(n, m, size)
        self._made: Any = None
        self.pairs.counters[SIZE] = size
        self._set_thresholds(epsilon, minimum_growth)

    def __repr__(self) -> str:
        """Show pairs, rank and σ_min."""
        return (f'<HistoryStack: {self.count} of {self.size} pairs, rank {self.rank}, '
                f'sigma_min {self.sigma_min:.3g}>')

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

    def _set_thresholds(self, epsilon: float, minimum_growth: float) -> None:
        self.pairs.figures[THRESHOLD] = epsilon
        self.pairs.figures[GROWTH] = minimum_growth

    def clear(self) -> None:
        """Forget every pair."""
        clear_pairs(self.pairs)

    def retune(self, size: int, epsilon: float, minimum_growth: float) -> None:
        """Change the settings, all or none; for ``size`` see :meth:`resize`."""
        self._check(size, epsilon, minimum_growth)
        self.resize(size)
        self._set_thresholds(epsilon, minimum_growth)

    def resize(self, size: int) -> None:
        """Change P. A larger stack keeps all pairs and appends again.

        A smaller one keeps the best: pairs leave one at a time, each time the one whose absence
        leaves the largest σ_min; while σ_min is 0 the oldest of those that cost the least rank.
        That takes an eigenvalue problem or two for each, so one leaves with every call of
        :meth:`offer`, and no pair is taken until P are left.
        """
        self._check(size, self.epsilon, self.minimum_growth)
        if size != self.size:
            if size > len(self.pairs.regressors):
                vars(self)['pairs'] = with_slots(self.pairs, size)
            self.pairs.counters[SIZE] = size
            if self.full:
                measure_pairs(self._handle)

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy or a pickle takes: all but the handle, which it makes again."""
        return {**self.__dict__, '_made': None}

    @property
    def _handle(self) -> Any:
        """What compiled functions get, of the present :attr:`pairs`."""
        if self._made is None or self._made.value is not self.pairs:
            self._made = handle(self.pairs)
        return self._made

    @property
    def size(self) -> int:
        """P. After :meth:`resize` to fewer than there are, ``count`` comes down to it."""
        return int(self.pairs.counters[SIZE])

    @property
    def epsilon(self) -> float:
        """ε of Algorithm 1."""
        return float(self.pairs.figures[THRESHOLD])

    @property
    def minimum_growth(self) -> float:
        """Part of σ_min by which a replacement must raise it."""
        return float(self.pairs.figures[GROWTH])

    @property
    def regressors(self) -> np.ndarray:
        """Y_fj, shape (max(P, count), n, m), of which ``count`` are filled."""
        return _to_be_read(self.pairs.regressors[:max(self.size, self.count)])

    @property
    def torques(self) -> np.ndarray:
        """τ_fj, shape (max(P, count), n) [N·m]."""
        return _to_be_read(self.pairs.torques[:max(self.size, self.count)])

    @property
    def gram(self) -> np.ndarray:
        """Q = Σ Y_fjᵀ Y_fj, shape (m, m)."""
        return _to_be_read(self.pairs.gram)

    @property
    def moment(self) -> np.ndarray:
        """Σ Y_fjᵀ τ_fj, shape (m,)."""
        return _to_be_read(self.pairs.moment)

    @property
    def count(self) -> int:
        """Number of filled slots."""
        return int(self.pairs.counters[COUNT])

    @property
    def insertions(self) -> int:
        """Number of pairs taken so far, replacements included."""
        return int(self.pairs.counters.item(INSERTIONS))

    @property
    def revision(self) -> int:
        """Differs whenever the pairs differ."""
        return int(self.pairs.counters[REVISION])

    @property
    def rank(self) -> int:
        """Rank of Q."""
        return int(self.pairs.counters[RANK])

    @property
    def sigma_min(self) -> float:
        """Smallest eigenvalue of Q; 0 where Q is numerically singular."""
        return float(self.pairs.figures[SIGMA_MIN])

    @property
    def full(self) -> bool:
        """Whether all P slots are filled."""
        return is_full(self.pairs)

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
        regressor = np.ascontiguousarray(regressor, dtype=float)
        # As `offer` does; by itself it spares most samples the way of all arrays into it.
        if not self.shrinking and not is_different(regressor, self.pairs.last, self.epsilon):
            return -1
        return int(offer_pair(self._handle, regressor, np.ascontiguousarray(torque, dtype=float)))


def _to_be_read(array: np.ndarray) -> np.ndarray:
    """Return a view that cannot be written to: the arrays belong together."""
    view = array.view()
    view.setflags(write=False)
    return view
