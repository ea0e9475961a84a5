# SPDX-License-Identifier: Apache-2.0
"""Integral concurrent learning (Parikh, Kamalapurkar, Dixon): integrals instead of filters.

Over a sliding window Δ, with Y1 θ = M q̇ and Y2 of (12),

    [Y1(t) − Y1(t − Δ) + ∫ Y2] θ* = ∫ τ,

which needs no acceleration either. Divided by Δ both sides are means, of the size of our filtered
pairs. The pairs go into the same history stack; the tracking law is Slotine and Li's.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.laws.protocol import LawSample
from adaptive_blf_control.control.laws.slotine_li import SlotineLi
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.state_filter import StateFilter
from adaptive_blf_control.identification.update_law import implicit_step
from adaptive_blf_control.simulation.sensors import Measurement

__all__ = ['IntegralConcurrentLearning', 'IntegralWindow']


class IntegralWindow:
    """The pair of the module's docstring over the last ``samples`` intervals."""

    def __init__(self, arm: Arm, samples: int) -> None:
        """Start empty; ``samples`` ≥ 1 intervals fill the window."""
        self._arm = arm
        self._rows: deque[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = deque()
        self._samples = max(samples, 1)
        self._area = np.zeros((arm.n, arm.m))
        self._impulse = np.zeros(arm.n)
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def update(self, dt: float, q: np.ndarray, qd: np.ndarray,
               tau: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Add a sample ``dt`` [s] after the last one; τ is the mean over that interval.

        Returns:
            Mean regressor (n, m) and mean torque (n,) [N·m]; None until the window is full.
        """
        y1, y2 = self._arm.Y12(q, qd)
        if self._last is not None:
            last1, last2 = self._last
            row = (dt, last1, 0.5 * dt * (last2 + y2), dt * tau)
            self._rows.append(row)
            self._area = self._area + row[2]
            self._impulse = self._impulse + row[3]
            if len(self._rows) > self._samples:
                _, _, area, impulse = self._rows.popleft()
                self._area = self._area - area
                self._impulse = self._impulse - impulse
        self._last = (y1, y2)
        if len(self._rows) < self._samples:
            return None
        length = self._samples * dt
        return (y1 - self._rows[0][1] + self._area) / length, self._impulse / length


class IntegralConcurrentLearning(SlotineLi):
    """θ̂̇ = −Γ[Y_rᵀ s + k_h Σ 𝒴_jᵀ(𝒴_j θ̂ − 𝒰_j)], stepped implicitly as our own law is."""

    def __init__(self, arm: Arm, settings: ControllerSettings, kh: float, stack: HistoryStack,
                 samples: int, state_filter: StateFilter | None = None) -> None:
        """Take k_h, an empty stack and the length of the window in samples.

        With a state filter it learns from filtered signals; it still tracks with the measured.
        """
        super().__init__(arm, settings)
        self._state_filter = state_filter
        self.stack = stack
        self._kh = kh
        self._window = IntegralWindow(arm, samples)
        self._no_pair = np.zeros((arm.n, arm.m)), np.zeros(arm.n)

    def _seen(self, dt: float, sample: LawSample) -> Measurement:
        measured = Measurement(sample.q, sample.qd, sample.torque)
        if self._state_filter is None:
            return measured
        return Measurement(*self._state_filter.update(dt, *measured))

    def _begin(self, sample: LawSample) -> np.ndarray:
        self._window.update(0.0, *self._seen(0.0, sample))
        return super()._begin(sample)

    def _learn(self, theta: np.ndarray, sample: LawSample, dt: float,
               term: np.ndarray) -> np.ndarray:
        pair = self._window.update(dt, *self._seen(dt, sample))
        if pair is not None:
            self.stack.offer(*pair)
        return np.asarray(implicit_step(
            theta, dt, self._gamma, 0.0, self._kh, *self._no_pair, self.stack.pairs.gram,
            self.stack.pairs.moment, term))
