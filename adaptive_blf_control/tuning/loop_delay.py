# SPDX-License-Identifier: Apache-2.0
"""How much damping a sampled loop with a delay can have.

The damping −k2 e2 of (38) reaches the arm late by D. With X θ̂ cancelling the arm and M frozen,

    ė2(t) = −M⁻¹ K2 e2(t − D).

M⁻¹ K2 is similar to the symmetric K2^½ M⁻¹ K2^½: its eigenvalues λ are real and positive, and the
modes are ż = −λ z(t − D), one by one. The open loop λ e^(−jωD)/(jω) has the gain 1 at ω = λ, where
its phase is −π/2 − λD. Hence the loop is stable if and only if λ D < π/2; its phase margin is
π/2 − λD and its gain margin π/(2 λD).

Sampled with the period T and a command that acts N periods later, z[k+1] = z[k] − λT z[k−N], which
is stable if and only if λT < 2 cos(Nπ/(2N+1)) (Levin and May, Theoretical Population Biology 9,
1976). The held torque is on average half a period old, D = (N + ½)T, and with it both are

    λ < (2/T) sin(πT/(4D)):      2/T without a delay, π/(2D) where D is long.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arrays import checked_finite
from adaptive_blf_control.errors import ParameterError

__all__ = ['LoopDelay', 'loop_delay', 'phase_margin']


class LoopDelay(NamedTuple):
    """What lies between a motion and the torque that answers it.

    Attributes:
        period: Sampling period T [s].
        delay: From the sample of a state until the command that answers it acts [s].
        velocity_lag: By which the measured velocity is late [s].
    """

    period: float
    delay: float
    velocity_lag: float

    @property
    def total(self) -> float:
        """D [s]: delay, lag of the velocity, and half a period for the held torque."""
        return self.delay + self.velocity_lag + 0.5 * self.period

    @property
    def largest_rate(self) -> float:
        """Damping rate λ_max(M⁻¹ K2) at which the loop starts to oscillate [1/s]."""
        return 2.0 / self.period * math.sin(0.25 * math.pi * self.period / self.total)

    def delay_margin(self, rate: float) -> float:
        """Return the delay that a loop with the damping rate λ [1/s] bears in addition [s].

        Negative where it is unstable as it is; minus infinity for λT ≥ 2, where no delay is
        short enough.
        """
        part = 0.5 * rate * self.period
        if part >= 1.0:
            return -math.inf
        if part <= 0.0:
            return math.inf
        return 0.25 * math.pi * self.period / math.asin(part) - self.total

    def longer(self, other: LoopDelay) -> LoopDelay:
        """Return the larger of each part."""
        return LoopDelay(*map(max, self, other))


def loop_delay(rate: float, delay: float = 0.0, velocity_lag: float = 0.0) -> LoopDelay:
    """Return the delay of a loop.

    Args:
        rate: Samples per second [Hz].
        delay: From the sample of a state until the command that answers it acts [s].
        velocity_lag: Time constant of the filter behind which the velocity is measured [s], with
            half a period where it is a difference of positions.

    Raises:
        ParameterError: a value is not finite, or below 0.
    """
    rate = checked_finite('loop.rate', rate, 'a rate > 0 Hz', above=0.0)
    return LoopDelay(1.0 / rate, _time('loop.delay', delay),
                     _time('loop.velocity_lag', velocity_lag))


def _time(name: str, value: float) -> float:
    if checked_finite(name, value, 'a time >= 0 s') < 0.0:
        raise ParameterError(name, value, 'a time >= 0 s')
    return float(value)


def phase_margin(rate: np.ndarray, stiffness: np.ndarray, delay: LoopDelay) -> np.ndarray:
    """Return the phase margin of ë = −rate ė(t − D) − stiffness e(t − D) [rad]; < 0: unstable.

    The open loop (rate s + stiffness) e^(−sD)/s² has the gain 1 at
    ω² = ½ (rate² + √(rate⁴ + 4 stiffness²)), where its phase is −π + atan(ω rate/stiffness) − ωD.
    For D stands what gives the sampled loop without stiffness its exact limit.

    Args:
        rate: Damping per inertia, > 0, of any shape [1/s].
        stiffness: Stiffness per inertia, ≥ 0, likewise [1/s²].
        delay: Of the loop.
    """
    with np.errstate(over='ignore'):  # beyond the largest number: no margin
        square = rate * rate
        omega = np.sqrt(0.5 * (square + np.hypot(square, 2.0 * stiffness)))
        late = omega * (0.5 * math.pi / delay.largest_rate)
        return np.asarray(np.arctan2(omega * rate, stiffness) - late)
