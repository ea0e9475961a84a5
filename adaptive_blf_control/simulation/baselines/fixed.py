# SPDX-License-Identifier: Apache-2.0
"""Laws that learn nothing: PD, and computed torque with a model that is wrong."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.law import limited
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.simulation.baselines.gains import Gains
from adaptive_blf_control.simulation.sensors import Measurement

__all__ = ['ComputedTorque', 'ProportionalDerivative']


class ProportionalDerivative:
    """τ = −K_p e1 − K_d ė1."""

    def __init__(self, reference: Reference, gains: Gains) -> None:
        """Take the reference and the gains."""
        self.theta: np.ndarray | None = None
        self._reference = reference
        self._gains = gains

    def update(self, t: float, measured: Measurement) -> np.ndarray:
        """Answer a sample; see `Law`."""
        point, gains = self._reference.at(t), self._gains
        return np.asarray(limited(
            -gains.stiffness * (measured.q - point.position)
            - gains.damping * (measured.qd - point.velocity), gains.torque_limit))


class ComputedTorque:
    """τ = M̂(q) v + Ĉ q̇ + Ĝ + F̂ q̇ with v = ÿ_d − (K_d ė1 + K_p e1)/M_ii."""

    def __init__(self, arm: Arm, reference: Reference, gains: Gains, theta: np.ndarray) -> None:
        """Take the model it believes in, θ of shape (m,)."""
        self.theta: np.ndarray = theta
        self._arm = arm
        self._reference = reference
        self._gains = gains

    def update(self, t: float, measured: Measurement) -> np.ndarray:
        """Answer a sample; see `Law`."""
        point, gains = self._reference.at(t), self._gains
        wanted = point.acceleration - (
            gains.stiffness * (measured.q - point.position)
            + gains.damping * (measured.qd - point.velocity)) / gains.inertia
        # With α = q̇ the regressor X has no e2: it is that of the inverse dynamics.
        regressor = self._arm.X(measured.q, measured.qd, measured.qd, wanted)
        return np.asarray(limited(regressor @ self.theta, gains.torque_limit))
