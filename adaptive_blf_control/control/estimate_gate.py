# SPDX-License-Identifier: Apache-2.0
"""Estimates that a controller can trust, and the one that it uses."""

from __future__ import annotations

from collections import deque

import numpy as np

from adaptive_blf_control.compiled import all_finite, is_within
from adaptive_blf_control.control.refusal import Refusal

__all__ = ['EstimateGate']

KEPT = 4  # estimates for states that have not been answered yet


class EstimateGate:
    """Holds θ̂ in use; an estimate that is not finite or beyond the limit leaves it as it is.

    Attributes:
        theta: θ̂ in use, shape (m,).
        limit: Largest absolute value of each element that is believed, shape (m,).
    """

    def __init__(self, parameters: tuple[str, ...], theta: np.ndarray,
                 limit: np.ndarray) -> None:
        """Take the names of the parameters, θ̂ until the first estimate (m,) and the limit (m,)."""
        self.theta, self.limit = theta, limit
        self._parameters = parameters
        is_within(theta, limit)  # compile here, not between two samples
        self._of_state: deque[tuple[int, np.ndarray | None]] = deque(maxlen=KEPT)

    def check(self, theta: np.ndarray) -> Refusal | None:
        """Return why an estimate, shape (m,), is not used."""
        if is_within(theta, self.limit):
            return None
        if not all_finite(theta):
            return Refusal('non-finite estimate', 'the last one is kept')
        i = int(np.argmax(np.abs(theta) / self.limit))
        return Refusal('estimate beyond its limit', (
            f'{self._parameters[i]} = {theta[i]:.4g} is beyond estimate_limit '
            f'{self.limit[i]:g}: the last estimate is kept'), fault=True)

    def offer(self, theta: np.ndarray) -> Refusal | None:
        """Use an estimate, shape (m,), from now on, or return why not."""
        refusal = self.check(theta)
        if refusal is None:
            self.theta = theta
        return refusal

    def offer_after(self, stamp: int, theta: np.ndarray) -> Refusal | None:
        """Keep an estimate for the state that follows the one of ``stamp`` [ns].

        In lockstep it may be that of a state which still waits for the one before. One that is
        refused is kept as such: its state is answered with the last one.
        """
        refusal = self.check(theta)
        self._of_state.append((stamp, theta if refusal is None else None))
        return refusal

    def use_after(self, stamp: int) -> bool:
        """Use what was kept for the state that follows ``stamp`` [ns]; False where none came."""
        for kept, theta in self._of_state:
            if kept == stamp:
                self.theta = self.theta if theta is None else theta
                return True
        return False
