# SPDX-License-Identifier: Apache-2.0
"""When the recorded pairs were taken."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.identification.history import History
from adaptive_blf_control.identification.identifier import Identifier

__all__ = ['PairTimes', 'RecordedHistory']

_KEPT = 4  # times the size of the history: entries before those of pairs that left are dropped


class RecordedHistory(NamedTuple):
    """The pairs that a history holds at one sample; nothing of it changes later.

    Attributes:
        regressors: Y_f, shape (P, n, m).
        torques: τ_f, shape (P, n) [N·m].
        times: When each was taken, shape (P,) [s]; NaN where that is not known.
        memory: How long the filters remember [s].
    """

    regressors: np.ndarray
    torques: np.ndarray
    times: np.ndarray
    memory: float


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

    def recorded(self, identifier: Identifier) -> RecordedHistory:
        """Return a copy of what the identifier has recorded."""
        stack = identifier.stack
        count = stack.count
        return RecordedHistory(stack.regressors[:count].copy(), stack.torques[:count].copy(),
                               self.times(stack), identifier.memory)

    def times(self, stack: History) -> np.ndarray:
        """Return when each recorded pair was taken, shape (count,) [s]; NaN where not seen."""
        return np.array([self._times.get(row.tobytes(), math.nan)
                         for row in stack.torques[:stack.count]])
