# SPDX-License-Identifier: Apache-2.0
"""The ABLF law (38); with θ* as θ̂ it is (34)."""

from __future__ import annotations

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.law import growing_errors, torque
from adaptive_blf_control.control.laws.protocol import LawAnswer, LawSample
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.control.step import AblfGains

__all__ = ['AblfLaw', 'ablf_gains']


def ablf_gains(settings: ControllerSettings) -> AblfGains:
    """Return the gains of (38) from settings with arrays of full length."""
    # Copies that may be written to: the law is compiled for those.
    return AblfGains(settings.k1.copy(), settings.k2.copy(), settings.barrier_weight.copy(),
                     settings.coupling == 'per_joint', float(settings.coupling_reach))


class AblfLaw:
    """Equation (38): τ = X θ̂ − k2 e2 − coupling, with the barrier in α and in the coupling.

    Attributes:
        gains: As compiled functions take them.
    """

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Take the arm and the gains."""
        self._arm = arm
        self.gains = ablf_gains(settings)

    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample; see `Law`."""
        point, bounds, gains = sample.reference, sample.bounds, self.gains
        e1, e2, alpha, alpha_dot, b = growing_errors(
            sample.q, sample.qd, point.position, point.velocity, point.acceleration,
            bounds.lower, bounds.upper, bounds.lower_rate, bounds.upper_rate, gains.k1)
        x = self._arm.X(sample.q, sample.qd, alpha, alpha_dot)
        return LawAnswer(torque(x, sample.theta, gains.k2, e1, e2, b, gains.weight, gains.smooth,
                                gains.reach), e2, x)
