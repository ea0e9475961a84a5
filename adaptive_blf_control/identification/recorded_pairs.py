# SPDX-License-Identifier: Apache-2.0
"""The recorded pairs: which history teaches, and when it is forgotten."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.identification.artificial_noise import NoisyHistory
from adaptive_blf_control.identification.change_monitor import ChangeMonitor
from adaptive_blf_control.identification.history import History
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.parts import PartMaker
from adaptive_blf_control.identification.settings import IdentifierSettings
from adaptive_blf_control.identification.torque_filter import FilteredPair

__all__ = ['RecordedPairs']


class RecordedPairs:
    """History, change monitor and, while the rank is short, the pairs with artificial noise.

    Attributes:
        stack: The measured pairs.
        monitor: Finds that they contradict present data.
        changes: How often it has.
    """

    def __init__(self, make: PartMaker, settings: IdentifierSettings) -> None:
        """Start without a pair."""
        self._make = make
        self._settings = settings
        self.stack = make.history(settings)
        self.monitor = make.monitor(settings)
        self.changes = 0
        self._noisy = self._new_noisy_history()

    def _new_noisy_history(self) -> NoisyHistory | None:
        history, arm = self._settings.history, self._make.arm
        if history.noise == 0.0:
            return None
        return NoisyHistory(arm.n, arm.m, history.size, history.epsilon, history.noise,
                            history.noise_seed)

    @property
    def rank_is_full(self) -> bool:
        """Whether the measured pairs determine every parameter."""
        return self.stack.rank == self._make.arm.m

    @property
    def artificial_noise(self) -> bool:
        """Whether pairs with artificial noise teach (Remark 3)."""
        return self._noisy is not None and self._noisy.noisy > 0

    def clear(self) -> None:
        """Forget every pair."""
        self.stack.clear()
        self.monitor.reset()
        self._noisy = self._new_noisy_history()

    def retune(self, settings: IdentifierSettings, stack: History | None,
               monitor: ChangeMonitor | None) -> None:
        """Use other settings and parts.

        Args:
            settings: The new ones.
            stack: An empty history that the pairs of the present one are offered to, or None.
            monitor: Another one, or None.
        """
        before, self._settings = self._settings, settings
        history, change = settings.history, settings.change
        if monitor is not None:
            self.monitor = monitor
        self.monitor.retune(change.window, change.threshold, change.resolution)
        if stack is not None:
            for j in range(self.stack.count):
                stack.offer(self.stack.regressors[j], self.stack.torques[j])
            self.stack = stack
        self.stack.retune(history.size, history.epsilon, history.minimum_growth)
        noise = history.noise, history.noise_seed
        if noise != (before.history.noise, before.history.noise_seed):
            self._noisy = None if self.rank_is_full else self._new_noisy_history()
        elif self._noisy is not None:
            self._noisy.stack.retune(history.size, history.epsilon, 0.0)

    def contradict(self, dt: float, pair: FilteredPair) -> bool:
        """Forget the pairs where the present one shows that the arm has changed; else False."""
        if not self.monitor.watch(dt, *pair, self.stack):
            return False
        self.stack.clear()
        self.monitor.reset()
        self.changes += 1
        return True

    def offer(self, pair: FilteredPair) -> None:
        """Offer the present pair; artificial noise ends with the rank of the measured pairs."""
        self.stack.offer(*pair)
        if self._noisy is not None:
            self._noisy.offer(*pair)
            if self.rank_is_full:
                self._noisy = None

    @property
    def teaching(self) -> History:
        """The pairs that θ̂ is learned from."""
        return self.stack if self._noisy is None else self._noisy.stack

    def sums(self) -> tuple[np.ndarray, np.ndarray]:
        """Return Q, shape (m, m), and Σ Y_fjᵀ τ_fj, shape (m,), of the pairs that teach."""
        stack = self.teaching
        if isinstance(stack, HistoryStack):
            return stack.gram, stack.moment
        name, m = type(stack).__name__, self._make.arm.m
        return (checked_array(f'{name}.gram', stack.gram, (m, m)),
                checked_array(f'{name}.moment', stack.moment, (m,)))
