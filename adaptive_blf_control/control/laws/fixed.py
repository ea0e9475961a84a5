# SPDX-License-Identifier: Apache-2.0
"""Laws that learn nothing: PD, and computed torque with the θ̂ that they are given."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.laws.linear_gains import joint_inertia, linear_gains
from adaptive_blf_control.control.laws.protocol import LawAnswer, LawSample
from adaptive_blf_control.control.settings import ControllerSettings

__all__ = ['ComputedTorque', 'ProportionalDerivative']


class ProportionalDerivative:
    """τ = −K_p e1 − K_d ė1."""

    uses_estimate = False

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Take the gains, see `linear_gains`."""
        self._gains = linear_gains(settings)

    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample; see `Law`."""
        return LawAnswer(-self.pull(sample), sample.qd - sample.reference.velocity, None)

    def pull(self, sample: LawSample) -> np.ndarray:
        """Return K_p e1 + K_d ė1, shape (n,) [N·m]."""
        return np.asarray(self._gains.stiffness * (sample.q - sample.reference.position)
                          + self._gains.damping * (sample.qd - sample.reference.velocity))


class ComputedTorque(ProportionalDerivative):
    """τ = M̂ v + Ĉ q̇ + Ĝ + F̂ q̇ from θ̂, with v = ÿ_d − (K_p e1 + K_d ė1)/M_ii."""

    uses_estimate = True

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Take the arm and the gains."""
        super().__init__(arm, settings)
        self._arm = arm
        self._inertia: np.ndarray | None = None

    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample; see `Law`."""
        if self._inertia is None:
            self._inertia = joint_inertia(self._arm, sample.reference.position)
        wanted = sample.reference.acceleration - self.pull(sample) / self._inertia
        # With α = q̇ the regressor X has no e2: it is that of the inverse dynamics.
        regressor = self._arm.X(sample.q, sample.qd, sample.qd, wanted)
        return LawAnswer(regressor @ sample.theta, sample.qd - sample.reference.velocity, None)
