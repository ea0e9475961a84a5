# SPDX-License-Identifier: Apache-2.0
"""Periodic motions that begin and end at rest: finite Fourier series.

    q_i(t) = centre_i + Σ_k a_ik cos(k ω t) + b_ik sin(k ω t),    ω = 2π / period

(Swevers, Ganseman, Tükel, De Schutter, Van Brussel, IEEE T-RA 1997) with Σ_k k b_ik = 0 and
Σ_k k² a_ik = 0, so that velocity and acceleration are zero where a period begins: the motion can
be repeated, and joined to a posture, without a jump.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.control.reference import SumOfSinusoids
from adaptive_blf_control.control.settings import SinusoidSettings
from adaptive_blf_control.tuning.inertia import ReferenceStates

__all__ = ['PeriodicMotion', 'rest_basis', 'series']

_DIGITS = 6  # of a reference's amplitudes and phases


class PeriodicMotion(NamedTuple):
    """A Fourier series per joint.

    Attributes:
        period: [s].
        centre: Shape (n,) [rad].
        cosine: a, shape (n, harmonics) [rad].
        sine: b, shape (n, harmonics) [rad].
    """

    period: float
    centre: np.ndarray
    cosine: np.ndarray
    sine: np.ndarray

    def at(self, t: np.ndarray) -> ReferenceStates:
        """Evaluate at N times, (N,) [s]."""
        coefficients = np.hstack([self.cosine, self.sine])
        q, qd, qdd = (table @ coefficients.T for table in series(
            t, self.period, self.cosine.shape[1]))
        return ReferenceStates(self.centre + q, qd, qdd)

    def scaled(self, factor: float) -> PeriodicMotion:
        """Return the motion with all amplitudes scaled."""
        return self._replace(cosine=factor * self.cosine, sine=factor * self.sine)

    def sinusoids(self) -> tuple[SinusoidSettings, ...]:
        """Return the motion as the controller's reference, of each joint."""
        harmonics = 2.0 * np.pi / self.period * np.arange(1, self.cosine.shape[1] + 1)
        amplitude, phase = np.hypot(self.cosine, self.sine), np.arctan2(self.cosine, self.sine)
        return tuple(SinusoidSettings(
            offset=float(np.round(centre, _DIGITS)), amplitude=np.round(size, _DIGITS),
            frequency=harmonics, phase=np.round(angle, _DIGITS))
            for centre, size, angle in zip(self.centre, amplitude, phase))

    @property
    def reference(self) -> SumOfSinusoids:
        """The motion as a reference."""
        harmonics = 2.0 * np.pi / self.period * np.arange(1, self.cosine.shape[1] + 1)
        return SumOfSinusoids(
            self.centre, np.hypot(self.cosine, self.sine),
            np.broadcast_to(harmonics, self.cosine.shape), np.arctan2(self.cosine, self.sine))


def series(t: np.ndarray, period: float,
           harmonics: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what unit coefficients [a b] do to q, q̇ and q̈ at N times, (N, 2 harmonics) each."""
    w = 2.0 * np.pi / period * np.arange(1, harmonics + 1)
    angle = np.outer(t, w)
    c, s = np.cos(angle), np.sin(angle)
    return (np.hstack([c, s]), np.hstack([-w * s, w * c]), np.hstack([-w * w * c, -w * w * s]))


def rest_basis(harmonics: int) -> np.ndarray:
    """Return coefficients [a b] of motions at rest where a period begins, as rows.

    The rows, shape (2 harmonics − 2, 2 harmonics), have comparable velocities.
    """
    k = np.arange(1, harmonics + 1, dtype=float)
    zero = np.zeros(harmonics)
    # In terms of velocity amplitudes k a and k b: Σ k (k a) = 0, Σ (k b) = 0.
    _, _, rows = np.linalg.svd(np.array([np.append(k, zero), np.append(zero, np.ones(harmonics))]))
    result: np.ndarray = rows[2:] / np.tile(k, 2)
    return result
