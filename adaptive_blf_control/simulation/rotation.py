# SPDX-License-Identifier: Apache-2.0
"""Rotation matrices from the angles that URDF and REP 103 use."""

from __future__ import annotations

import numpy as np

__all__ = ['rotation']


def rotation(roll_pitch_yaw: np.ndarray) -> np.ndarray:
    """Return the rotation matrix Rz(yaw) Ry(pitch) Rx(roll) of a URDF's rpy, shape (3, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(roll_pitch_yaw), np.sin(roll_pitch_yaw)
    return np.array([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                     [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                     [-sp, cp * sr, cp * cr]])
