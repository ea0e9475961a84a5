# SPDX-License-Identifier: Apache-2.0
"""Remark 3: artificial noise on recorded regressors where the motion does not give full rank.

A pair (Y_f + Δ, τ_f) states what the arm never did, so θ̂ is drawn to a wrong value for as long as
such pairs are used. They are therefore kept in a stack of their own beside the measured one: it
replaces the measured stack in the update law while the rank of the *measured* pairs is short, and
is thrown away for good once that rank is full. Left in one stack, Algorithm 1 would keep noisy
pairs for ever: noise points in all directions and makes σ_min large.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.algorithm_1 import arrays_of_stack
from adaptive_blf_control.identification.history import facts, offer
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.pair_selection import is_different
from adaptive_blf_control.identification.stack_arrays import Pairs

__all__ = ['ACTIVE', 'NOISY', 'NoisyHistory', 'NoisyHistoryArrays', 'offer_with_noise']

# Elements of `NoisyHistoryArrays.counts`
ACTIVE, NOISY = range(2)


class NoisyHistoryArrays(NamedTuple):
    """A history with artificial noise as compiled functions take it; changed in place.

    Attributes:
        history: The pairs, those with artificial noise among them.
        last: The last regressor that was different, without noise, shape (n, m).
        counts: By name: whether the pairs are ACTIVE, that is, taught from in place of the
            measured ones; how many were offered with noise, NOISY; shape (2,).
        random: Where the noise comes from.
        deviation: Standard deviation of every element of Δ, relative to the RMS of Y_f.
        epsilon: ε of Algorithm 1, applied to the regressor without noise.
    """

    history: Pairs
    last: np.ndarray
    counts: np.ndarray
    random: np.random.Generator
    deviation: float
    epsilon: float


@jit
def offer_with_noise(noise: NoisyHistoryArrays, regressor: np.ndarray, torque: np.ndarray,
                     rank: int) -> None:
    """Offer a pair to Algorithm 1, with noise while the rank of the noisy pairs is short.

    Args:
        noise: The pairs with artificial noise.
        regressor: Y_f, shape (n, m).
        torque: τ_f, shape (n,) [N·m].
        rank: Rank of the measured pairs; once it is m, the noisy ones are not active any more.
    """
    noise = borrowed(noise)
    n, m = regressor.shape
    if is_different(regressor, noise.last, noise.epsilon):
        noise.last[:, :] = regressor
        offered = regressor
        _, _, noisy_rank, _ = facts(noise.history)
        if noisy_rank < m:
            deviation = noise.deviation * math.sqrt(np.mean(regressor * regressor))
            offered = regressor + deviation * noise.random.standard_normal((n, m))
            noise.counts[NOISY] += 1
        offer(noise.history, offered, torque)
    if rank == m:
        noise.counts[ACTIVE] = 0


class NoisyHistory:
    """A history stack whose pairs get artificial noise until its rank is full.

    Attributes:
        stack: The pairs, those with artificial noise among them.
    """

    def __init__(self, n: int, m: int, size: int, epsilon: float, deviation: float,
                 seed: int) -> None:
        """Set up an empty stack.

        Args:
            n: Number of joints.
            m: Number of parameters.
            size: P, number of pairs.
            epsilon: ε of Algorithm 1, applied to the regressor without noise.
            deviation: Standard deviation of every element of Δ, relative to the RMS of the
                elements of Y_f; 0: never active.
            seed: Of the noise.
        """
        if not (math.isfinite(deviation) and deviation >= 0.0):
            raise ParameterError('identifier.history.noise', deviation, 'a finite value >= 0')
        self.stack = HistoryStack(n, m, size if deviation > 0.0 else 1, epsilon)
        self._counts = np.array([deviation > 0.0, 0], dtype=np.int64)
        self._random = np.random.default_rng(seed)
        self._last = np.zeros((n, m))
        self._deviation = float(deviation)

    @property
    def arrays(self) -> NoisyHistoryArrays:
        """The state as compiled functions take it."""
        return NoisyHistoryArrays(arrays_of_stack(self.stack), self._last, self._counts,
                                  self._random, self._deviation, float(self.stack.epsilon))

    @property
    def noisy(self) -> int:
        """How many pairs were offered with artificial noise."""
        return int(self._counts[NOISY])

    @property
    def in_use(self) -> bool:
        """Whether θ̂ is learned from pairs with artificial noise."""
        return bool(self._counts[ACTIVE] and self._counts[NOISY])

    def end(self) -> None:
        """Go back to the measured pairs for good."""
        self._counts[ACTIVE] = 0

    def retune(self, size: int, epsilon: float) -> None:
        """Use another P and ε."""
        if self._deviation > 0.0:
            self.stack.retune(size, epsilon, 0.0)
