# SPDX-License-Identifier: Apache-2.0
"""Whether parameters are those of a possible robot: M(q) > 0 at random postures."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm

__all__ = ['POSTURES', 'positive_postures']

POSTURES = 1000


def positive_postures(arm: Arm, theta: np.ndarray, count: int = POSTURES) -> int:
    """Return at how many of ``count`` random postures the mass matrix is positive definite.

    Postures are uniform within the arm's position limits, a turn where it has none.

    Args:
        arm: The arm.
        theta: Parameters, shape (m,).
        count: Number of postures.
    """
    lower, upper = (np.asarray(getattr(arm, name, np.full(arm.n, bound)), dtype=float)
                    for name, bound in (('position_lower', -np.inf), ('position_upper', np.inf)))
    lower = np.where(np.isfinite(lower), lower, -np.pi)
    upper = np.where(np.isfinite(upper), upper, np.pi)
    postures = np.random.default_rng(0).uniform(lower, upper, (count, arm.n))
    mass = np.array([[arm.Y1(q, axis) @ theta for axis in np.eye(arm.n)] for q in postures])
    return int(np.count_nonzero(np.linalg.eigvalsh(mass)[:, 0] > 0.0))
