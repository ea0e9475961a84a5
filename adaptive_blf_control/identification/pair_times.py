# SPDX-License-Identifier: Apache-2.0
"""When the recorded pairs were taken."""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.identification.history import History
from adaptive_blf_control.identification.identifier import Identifier

__all__ = ['PairTimes']

_KEPT = 4  # times the size of the history: entries before those of pairs that left are dropped


class PairTimes:
    """Times of the pairs of an identifier that is looked at after every sample.

    A history need not say which pair it keeps where: a pair is known by its torque.
    """

    def __init__(self) -> None:
        """Start with nothing seen."""
        self._insertions = 0
        self._times: dict[bytes, float] = {}

    def observe(self, t: float, identifier: Identifier) -> None:
        """Look at the identifier after it has taken a sample of time ``t`` [s]."""
        stack = identifier.stack
        if stack.insertions == self._insertions:
            return
        self.note(t, identifier.pair[1], stack)

    def note(self, t: float, torque: np.ndarray, stack: History) -> None:
        """Take the time of the pair that a history may have taken last.

        Args:
            t: Time of its sample [s].
            torque: Its τ_f, shape (n,) [N·m].
            stack: The history.
        """
        self._insertions = stack.insertions
        self._times[torque.tobytes()] = t
        if len(self._times) > _KEPT * stack.size:
            held = {row.tobytes() for row in stack.torques[:stack.count]}
            self._times = {key: time for key, time in self._times.items() if key in held}

    def times(self, stack: History) -> np.ndarray:
        """Return when each recorded pair was taken, shape (count,) [s]; NaN where not seen."""
        return np.array([self._times.get(row.tobytes(), math.nan)
                         for row in stack.torques[:stack.count]])
