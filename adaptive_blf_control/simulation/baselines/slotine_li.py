# SPDX-License-Identifier: Apache-2.0
"""Slotine and Li (1987): passivity-based adaptive control, driven by the tracking error alone."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.law import limited
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.simulation.baselines.gains import Gains
from adaptive_blf_control.simulation.sensors import Measurement

__all__ = ['SlotineLi']


class SlotineLi:
    """τ = Y_r θ̂ − K_D s, θ̂̇ = −Γ Y_rᵀ s, with s = ė1 + Λ e1 and q̇_r = ẏ_d − Λ e1.

    Attributes:
        theta: θ̂, shape (m,).
    """

    def __init__(self, arm: Arm, reference: Reference, gains: Gains, gamma: np.ndarray,
                 theta: np.ndarray) -> None:
        """Start from ``theta`` (m,) with the diagonal ``gamma`` of Γ, shape (m,)."""
        self.theta: np.ndarray = theta
        self._arm = arm
        self._reference = reference
        self._gains = gains
        self._gamma = gamma
        self._t: float | None = None
        self._term = np.zeros(arm.m)

    def update(self, t: float, measured: Measurement) -> np.ndarray:
        """Answer a sample; see `Law`."""
        if self._t is not None:
            self._learn(t, t - self._t, measured, self._term)
        self._t = t
        point, gains = self._reference.at(t), self._gains
        error, rate = measured.q - point.position, measured.qd - point.velocity
        sliding = rate + gains.bandwidth * error
        # X differs from the Christoffel form of Y_r by a term that s does no work on.
        regressor = self._arm.X(measured.q, measured.qd, measured.qd - sliding,
                                point.acceleration - gains.bandwidth * rate)
        self._term = sliding @ regressor
        return np.asarray(limited(regressor @ self.theta - gains.damping * sliding,
                                  gains.torque_limit))

    def _learn(self, t: float, dt: float, measured: Measurement, term: np.ndarray) -> None:
        """Advance θ̂ over the interval in which Y_rᵀ s, ``term`` (m,), was held."""
        self.theta = self.theta - dt * self._gamma * term
