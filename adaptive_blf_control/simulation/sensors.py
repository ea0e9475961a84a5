# SPDX-License-Identifier: Apache-2.0
"""What the driver's sensors make of the true state: encoder counts, differences, noise."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.simulation.settings import SensorSettings

__all__ = ['Measurement', 'Sensors', 'resolution']


class Measurement(NamedTuple):
    """Measured q [rad], q̇ [rad/s] and τ [N·m], each of shape (n,)."""

    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray


def resolution(settings: SensorSettings) -> float:
    """Return the position step of one count at the joint [rad]; 0 where it is perfect."""
    if settings.model != 'encoder':
        return 0.0
    return 2.0 * math.pi / (settings.encoder_counts * settings.gear_ratio)


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
        step = resolution(self.settings)
        return np.round(q / step) * step if step > 0.0 else q

    def measure(self, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                dt: float) -> Measurement:
        """Measure the true state ``dt`` [s] after the last one; arrays of shape (n,)."""
        settings = self.settings
        if settings.torque_noise > 0.0:
            torque = torque + settings.torque_noise * self._random.standard_normal(q.size)
        if settings.model != 'encoder':
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
