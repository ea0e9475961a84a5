# SPDX-License-Identifier: Apache-2.0
"""Torque of a motion under given parameters: equation (2) for any arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.errors import ParameterError

__all__ = ['inverse_dynamics', 'described']


def inverse_dynamics(arm: Arm, theta: Any, q: Any, qd: Any, qdd: Any) -> np.ndarray:
    """Return τ = M(q) q̈ + C(q, q̇) q̇ + G(q) + F q̇ = Y(q, q̇, q̈) θ (2) [N·m].

    With α = q̇ and α̇ = q̈ the regressor X of (35) has no e2 and equals Y.

    Args:
        arm: The arm.
        theta: Parameters, shape (m,).
        q: Positions, shape (n,) or (N, n) [rad].
        qd: Velocities, likewise [rad/s].
        qdd: Accelerations, likewise [rad/s²].

    Returns:
        Torques, shape (n,) or (N, n) like ``q``.

    Raises:
        ParameterError: an array has another shape.
    """
    theta = checked_array('theta', theta, (arm.m,), 'one for each of the parameters')
    shape = (arm.n,) if np.ndim(q) == 1 else (-1, arm.n)
    states = [checked_array(name, value, shape, f'one for each of {", ".join(arm.joints)}')
              for name, value in (('q', q), ('qd', qd), ('qdd', qdd))]
    if len({len(state) for state in states}) != 1:
        raise ParameterError('q, qd, qdd', [len(state) for state in states], 'one length')
    if states[0].ndim == 1:
        position, velocity, acceleration = states
        return np.asarray(arm.X(position, velocity, velocity, acceleration) @ theta)
    return np.array([arm.X(position, velocity, velocity, acceleration) @ theta
                     for position, velocity, acceleration in zip(*states)]).reshape(-1, arm.n)


def described(arm: Arm) -> str:
    """Return an arm in one line, for its ``repr``."""
    return (f'<{type(arm).__name__}: {arm.n} joints ({", ".join(arm.joints)}), '
            f'{arm.m} parameters>')
