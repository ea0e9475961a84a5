# SPDX-License-Identifier: Apache-2.0
"""What a motion must keep: positions, speeds, accelerations, torques of any arm that may be there.

All is measured as parts of limits: a value of 1 is at its limit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.limits.prior import Prior
from adaptive_blf_control.tuning.inertia import ReferenceStates

__all__ = ['MotionLimits', 'Use', 'limit_penalty', 'use_of', 'worst_torque']


class MotionLimits(NamedTuple):
    """Limits of a motion; arrays of shape (n,).

    Attributes:
        lower: Positions [rad].
        upper: Positions [rad].
        velocity: Speeds [rad/s].
        acceleration: Accelerations [rad/s²].
        torque: Torques [N·m].
        prior: Parameters that the arm may have.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray
    prior: Prior


class Use(NamedTuple):
    """Largest part of each limit that a motion uses, shape (n,) each; above 1 it is broken."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    torque: np.ndarray

    @property
    def largest(self) -> float:
        """The largest part of any limit."""
        return float(max(part.max() for part in self))


def worst_torque(rows: np.ndarray, prior: Prior) -> np.ndarray:
    """Return the largest |τ| that any arm of the prior needs, shape (N, n) [N·m].

    Args:
        rows: Y of N states, shape (N, n, m).
        prior: Parameters that the arm may have.
    """
    torque: np.ndarray = np.abs(rows @ prior.centre)
    return torque + np.abs(rows @ prior.generators).sum(axis=-1)


def _parts(states: ReferenceStates, rows: np.ndarray,
           limits: MotionLimits) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    middle = 0.5 * (limits.lower + limits.upper)
    return ((states.q - middle) / (limits.upper - middle), states.qd / limits.velocity,
            states.qdd / limits.acceleration, worst_torque(rows, limits.prior) / limits.torque)


def use_of(states: ReferenceStates, rows: np.ndarray, limits: MotionLimits) -> Use:
    """Return what a motion uses of its limits; ``rows`` as in `worst_torque`."""
    return Use(*(np.abs(part).max(axis=0) for part in _parts(states, rows, limits)))


def limit_penalty(states: ReferenceStates, rows: np.ndarray,
                  limits: MotionLimits) -> tuple[float, np.ndarray, np.ndarray]:
    """Return Σ max(0, part − 1)² over samples and joints, and its gradients.

    Args:
        states: N samples.
        rows: Y of them, shape (N, n, m).
        limits: What they must keep.

    Returns:
        The penalty; its gradient in q, q̇, q̈, shape (3, N, n), and in Y, shape (N, n, m).
    """
    position, velocity, acceleration, torque = _parts(states, rows, limits)
    half = 0.5 * (limits.upper - limits.lower)
    total, slopes = 0.0, []
    for part, scale in ((position, half), (velocity, limits.velocity),
                        (acceleration, limits.acceleration)):
        over = np.sign(part) * np.maximum(np.abs(part) - 1.0, 0.0)
        total += float(np.sum(over ** 2))
        slopes.append(2.0 * over / scale)
    over = np.maximum(torque - 1.0, 0.0)
    total += float(np.sum(over ** 2))
    in_rows, prior = np.zeros_like(rows), limits.prior
    some = np.nonzero(over)
    if some[0].size:
        broken = rows[some]
        slope = np.sign(broken @ prior.centre)[:, None] * prior.centre
        slope = slope + np.sign(broken @ prior.generators) @ prior.generators.T
        in_rows[some] = (2.0 * over[some] / limits.torque[some[1]])[:, None] * slope
    return total, np.array(slopes), in_rows
