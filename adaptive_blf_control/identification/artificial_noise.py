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

import numpy as np

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.pair_selection import is_different

__all__ = ['NoisyHistory']


class NoisyHistory:
    """A history stack whose pairs get artificial noise until its rank is full.

    Attributes:
        stack: The pairs, those with artificial noise among them.
        noisy: How many pairs were offered with artificial noise.
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
                elements of Y_f, > 0.
            seed: Of the noise.
        """
        if not (math.isfinite(deviation) and deviation > 0.0):
            raise ParameterError('identifier.history.noise', deviation, 'a finite value > 0')
        self.stack = HistoryStack(n, m, size, epsilon)
        self.noisy = 0
        self._m = m
        self._deviation = deviation
        self._random = np.random.default_rng(seed)
        self._last = np.zeros((n, m))

    def offer(self, regressor: np.ndarray, torque: np.ndarray) -> None:
        """Offer Y_f (n, m), τ_f (n,) [N·m] to Algorithm 1, with noise while rank is short."""
        if not is_different(regressor, self._last, self.stack.epsilon):
            return
        self._last = regressor.copy()
        if self.stack.rank < self._m:
            deviation = self._deviation * math.sqrt(float(np.mean(regressor * regressor)))
            regressor = regressor + deviation * self._random.standard_normal(regressor.shape)
            self.noisy += 1
        self.stack.offer(regressor, torque)
