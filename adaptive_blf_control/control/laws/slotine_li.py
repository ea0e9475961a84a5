# SPDX-License-Identifier: Apache-2.0
"""Slotine and Li (1987): passivity-based adaptive control, driven by the tracking error alone."""

from __future__ import annotations

import copy

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.laws.linear_gains import joint_inertia, linear_gains
from adaptive_blf_control.control.laws.protocol import LawAnswer, LawSample
from adaptive_blf_control.control.settings import ControllerSettings

__all__ = ['SlotineLi']


class SlotineLi:
    """τ = Y_r θ̂ − K_D s, θ̂̇ = −Γ Y_rᵀ s, with s = ė1 + Λ e1 and q̇_r = ẏ_d − Λ e1.

    It adapts by itself, from the θ̂ of the first sample on, and tells the identifier nothing.

    Attributes:
        theta: θ̂, shape (m,); None before the first sample.
    """

    uses_estimate = False

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Take the arm and the gains; Γ is ``settings.slotine_li.gamma``."""
        self.theta: np.ndarray | None = None
        self._arm = arm
        self._bandwidth = np.zeros(arm.n)
        self._term = np.zeros(arm.m)
        self._t = 0.0
        self._tune(settings)

    def _tune(self, settings: ControllerSettings) -> None:
        self._gains = linear_gains(settings)
        self._gamma = settings.slotine_li.resolved(parameters=self._arm.m).gamma.copy()

    def retuned(self, settings: ControllerSettings) -> SlotineLi:
        """Return the law that goes on from here with other gains; Λ stays."""
        other = copy.copy(self)
        other._tune(settings)
        return other

    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample; see `Law`."""
        theta = self._begin(sample) if self.theta is None else self._learn(
            self.theta, sample, sample.t - self._t, self._term)
        self.theta, self._t = theta, sample.t
        point = sample.reference
        error, rate = sample.q - point.position, sample.qd - point.velocity
        sliding = rate + self._bandwidth * error
        # X differs from the Christoffel form of Y_r by a term that s does no work on.
        regressor = self._arm.X(sample.q, sample.qd, sample.qd - sliding,
                                point.acceleration - self._bandwidth * rate)
        self._term = sliding @ regressor
        return LawAnswer(regressor @ theta - self._gains.damping * sliding, sliding, None)

    def _begin(self, sample: LawSample) -> np.ndarray:
        """Return θ̂ at the first sample, shape (m,)."""
        inertia = joint_inertia(self._arm, sample.reference.position)
        self._bandwidth = np.sqrt(self._gains.stiffness / inertia)
        return sample.theta

    def _learn(self, theta: np.ndarray, sample: LawSample, dt: float,
               term: np.ndarray) -> np.ndarray:
        """Return θ̂ after the interval in which Y_rᵀ s, ``term`` (m,), was held."""
        return theta - dt * self._gamma * term
