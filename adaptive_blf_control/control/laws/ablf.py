# SPDX-License-Identifier: Apache-2.0
"""The ABLF law (38); with θ* as θ̂ it is (34)."""

from __future__ import annotations

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.law import growing_errors, torque
from adaptive_blf_control.control.laws.protocol import LawAnswer, LawSample
from adaptive_blf_control.control.settings import ControllerSettings

__all__ = ['AblfLaw']


class AblfLaw:
    """Equation (38): τ = X θ̂ − k2 e2 − coupling, with the barrier in α and in the coupling."""

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Take the arm and the gains."""
        self._arm = arm
        # Copies that may be written to: the law is compiled for those.
        self._k1, self._k2 = settings.k1.copy(), settings.k2.copy()
        self._weight = settings.barrier_weight.copy()
        self._smooth = settings.coupling == 'per_joint'

    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample; see `Law`."""
        point, bounds = sample.reference, sample.bounds
        e1, e2, alpha, alpha_dot, b = growing_errors(
            sample.q, sample.qd, point.position, point.velocity, point.acceleration,
            bounds.lower, bounds.upper, bounds.lower_rate, bounds.upper_rate, self._k1)
        x = self._arm.X(sample.q, sample.qd, alpha, alpha_dot)
        return LawAnswer(torque(x, sample.theta, self._k2, e1, e2, b, self._weight, self._smooth),
                         e2, x)
