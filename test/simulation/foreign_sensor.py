# SPDX-License-Identifier: Apache-2.0
"""A sensor that shares no code with ours: it shows positions in steps of 10 mrad."""

from __future__ import annotations

import numpy as np

STEP = 0.01  # rad


class Coarse:
    """Rounds positions; velocities and torques are perfect."""

    def __init__(self, settings, arm) -> None:
        self.n = arm.n

    def position(self, q):
        return STEP * np.round(np.asarray(q) / STEP)

    def measure(self, q, qd, torque, dt):
        return self.position(q), qd, torque


class NoSensor:
    """Lacks all that a sensor has."""

    def __init__(self, settings, arm) -> None:
        pass
