# SPDX-License-Identifier: Apache-2.0
"""Torque of a motion under given parameters: equation (2) for any arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm, checked_arm
from adaptive_blf_control.arrays import checked_array, checked_theta, dimensions
from adaptive_blf_control.calls import checked_call

__all__ = ['inverse_dynamics']


@checked_call
def inverse_dynamics(arm: Arm, theta: Any, q: Any, qd: Any, qdd: Any) -> np.ndarray:
    """Return τ = M(q) q̈ + C(q, q̇) q̇ + G(q) + F q̇ = Y(q, q̇, q̈) θ (2) [N·m].

    With α = q̇ and α̇ = q̈ the regressor X of (35) has no e2 and equals Y.

    Args:
        arm: The arm.
        theta: Parameters, shape (m,); or by name, as the ``estimate`` of an identifier;
            or what has one, such as what `identify` returns.
        q: Positions, shape (n,) or (N, n) [rad]; of one joint also (N,), or a number.
        qd: Velocities, likewise [rad/s].
        qdd: Accelerations, likewise [rad/s²].

    Returns:
        Torques, of the shape of ``q``.

    Raises:
        ParameterError: an array has another shape.
    """
    arm = checked_arm('arm', arm)
    theta = checked_theta('theta', theta, arm.parameters)
    axes, one = dimensions(q), arm.n == 1
    shape = (arm.n,) if axes == (0 if one else 1) else (-1, arm.n)
    q = checked_array('q', q, shape, arm.joints)
    qd = checked_array('qd', qd, q.shape, arm.joints)
    qdd = checked_array('qdd', qdd, q.shape, arm.joints)
    rows = [arm.X(*row) @ theta for row in zip(*(
        each.reshape(-1, arm.n) for each in (q, qd, qd, qdd)))]
    return np.array(rows, dtype=float).reshape(q.shape[:axes])
