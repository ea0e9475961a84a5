# SPDX-License-Identifier: Apache-2.0
"""What the driver's sensors make of the true state: encoder counts, differences, noise."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.errors import ParameterError

__all__ = ['Measurement', 'SensorSettings', 'Sensors']


class Measurement(NamedTuple):
    """Measured q [rad], q̇ [rad/s] and τ [N·m], each of shape (n,)."""

    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray


@dataclass(frozen=True)
class SensorSettings:
    """How the joints are measured.

    Attributes:
        encoder_counts: Counts per motor turn, > 0; None measures positions and velocities
            perfectly.
        gear_ratio: Motor turns per joint turn.
        velocity_time_constant: T_v of the first-order filter 1/(T_v s + 1) behind the difference
            of two positions [s]; 0 leaves the bare difference.
        torque_noise: Standard deviation of the torque measurement [N·m].
        seed: Of the noise.
    """

    encoder_counts: int | None = None
    gear_ratio: float = 1.0
    velocity_time_constant: float = 0.005
    torque_noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Check signs; ParameterError names the setting."""
        if self.encoder_counts is not None and self.encoder_counts <= 0:
            raise ParameterError('arm_driver.sensors.encoder_counts', self.encoder_counts,
                                 'at least 1 count per turn')
        for name, value, least in (('gear_ratio', self.gear_ratio, 1e-12),
                                   ('velocity_time_constant', self.velocity_time_constant, 0.0),
                                   ('torque_noise', self.torque_noise, 0.0)):
            if not (math.isfinite(value) and value >= least):
                raise ParameterError(f'arm_driver.sensors.{name}', value,
                                     f'a finite value >= {least:g}')

    @property
    def resolution(self) -> float:
        """Position step of one count at the joint [rad]; 0 where it is perfect."""
        if self.encoder_counts is None:
            return 0.0
        return 2.0 * math.pi / (self.encoder_counts * self.gear_ratio)


class Sensors:
    """The sensors of a simulated arm, with the state of the velocity filter."""

    def __init__(self, settings: SensorSettings) -> None:
        """Start with the filter at the first true velocity that is measured."""
        self.settings = settings
        self._random = np.random.default_rng(settings.seed)
        self._q: np.ndarray | None = None
        self._qd = np.zeros(0)

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return true positions (n,) [rad] in whole encoder counts."""
        step = self.settings.resolution
        return np.round(q / step) * step if step > 0.0 else q

    def measure(self, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                dt: float) -> Measurement:
        """Measure the true state ``dt`` [s] after the last one; arrays of shape (n,)."""
        settings = self.settings
        if settings.torque_noise > 0.0:
            torque = torque + settings.torque_noise * self._random.standard_normal(q.size)
        if settings.encoder_counts is None:
            return Measurement(q, qd, torque)
        measured = self.position(q)
        if self._q is None or dt <= 0.0:
            self._qd = np.array(qd)
        else:
            rate = (measured - self._q) / dt
            constant = settings.velocity_time_constant
            keep = math.exp(-dt / constant) if constant > 0.0 else 0.0
            self._qd = keep * self._qd + (1.0 - keep) * rate
        self._q = measured
        return Measurement(measured, self._qd, torque)
