# SPDX-License-Identifier: Apache-2.0
"""Joints at a position limit, where a mechanical stop may carry what no drive has measured.

The torque of a stop acts between the two links of its joint, so of the equation Y_f θ = τ_f the
row of that joint is wrong, and no other: it would say that what the stop carries weighs nothing.
While a joint is within a margin of a position limit of its URDF, or beyond it, and until the
filters have forgotten it, its row is therefore left out of the pair, and Xᵀe2, to which an error
that no torque can reduce adds more and more, does not move θ̂.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.compiled import borrowed, jit

__all__ = ['PositionLimits', 'any_limited', 'follow_limits', 'position_limits_of', 'true_rows']


class PositionLimits(NamedTuple):
    """Between which positions the drives alone move an arm, and when it last was beyond them.

    Attributes:
        lower: Up to which a joint counts as at its lower limit, shape (n,) [rad]; minus infinity
            where it has none.
        upper: Likewise from which on at its upper limit, shape (n,) [rad]; infinity.
        since: Time since each joint was at a limit, changed in place, shape (n,) [s]; infinity
            where the filters have seen none.
        forgetting: Time after which the filters have forgotten it [s].
    """

    lower: np.ndarray
    upper: np.ndarray
    since: np.ndarray
    forgetting: float


def position_limits_of(arm: Arm, margin: float, forgetting: float,
                       since: np.ndarray) -> PositionLimits:
    """Return the limits of an arm; infinite where it has no ``position_lower`` and ``_upper``.

    Args:
        arm: The arm.
        margin: Distance to a limit within which a joint counts as at it [rad]; below zero: only
            that far beyond it.
        forgetting: Time after which the filters have forgotten it [s].
        since: See `PositionLimits`.
    """
    lower, upper = (np.broadcast_to(np.asarray(getattr(arm, name, none), dtype=float), arm.n)
                    for name, none in (('position_lower', -np.inf), ('position_upper', np.inf)))
    return PositionLimits(lower + margin, upper - margin, since, float(forgetting))


@jit
def follow_limits(limits: PositionLimits, dt: float, q: np.ndarray) -> bool:
    """Take a measured position; return whether any joint is at a limit.

    Args:
        limits: The limits; ``since`` is changed in place.
        dt: Time since the last sample [s]; 0 where the filters restart.
        q: Positions, shape (n,) [rad].
    """
    limits = borrowed(limits)
    at = False
    for i in range(q.size):
        limits.since[i] = limits.since[i] + dt if dt > 0.0 else math.inf
        if q[i] <= limits.lower[i] or q[i] >= limits.upper[i]:
            limits.since[i] = 0.0
            at = True
    return at


@jit
def any_limited(limits: PositionLimits) -> bool:
    """Return whether the filters still remember a joint at a limit."""
    limits = borrowed(limits)
    return bool(np.min(limits.since) <= limits.forgetting)


@jit
def true_rows(limits: PositionLimits, regressor: np.ndarray,
              torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a pair, (n, m) and (n,) [N·m], whose rows of joints at a limit are zero."""
    limits = borrowed(limits)
    if not any_limited(limits):
        return regressor, torque
    regressor, torque = regressor.copy(), torque.copy()
    for i in range(torque.size):
        if limits.since[i] <= limits.forgetting:
            regressor[i] = 0.0
            torque[i] = 0.0
    return regressor, torque
