# SPDX-License-Identifier: Apache-2.0
"""A plant that shares no code with ours and has no θ*: two pendulums, semi-implicit Euler."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.simulation.sensors import Measurement


class Pendulums:
    """Joints that do not feel one another: I q̈ = τ − b q̇ − k sin q."""

    def __init__(self, settings, arm) -> None:
        self.q = np.array(settings.initial_position, dtype=float)
        self.qd = np.zeros(arm.n)
        self.torque = np.zeros(arm.n)

    def measure(self, torque, dt):
        return Measurement(self.q, self.qd, torque)

    def measured_position(self):
        return self.q

    def apply(self, torque):
        self.torque = np.array(torque)

    def advance(self, dt):
        acceleration = (self.torque - 2.0 * self.qd - 1.5 * np.sin(self.q)) / np.array([3.0, 0.5])
        self.qd = self.qd + dt * acceleration
        self.q = self.q + dt * self.qd

    def brake(self):
        self.qd = np.zeros_like(self.qd)
        self.apply(self.qd)


class NoPlant:
    """Lacks all that a plant needs."""

    def __init__(self, settings, arm) -> None:
        self.q = np.zeros(arm.n)
