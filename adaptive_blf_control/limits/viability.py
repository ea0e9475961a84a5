# SPDX-License-Identifier: Apache-2.0
"""Accelerations after which a joint can still be stopped inside its limits.

A joint at distance d from a limit that moves towards it with v can be stopped in time by the
braking a_b if and only if v² ≤ 2 a_b d. An acceleration a that is held over one sample of length h
keeps that true at its end,

    (v + a h)² ≤ 2 a_b (d − v h − ½ a h²),

which is quadratic in a (Del Prete, IEEE Robotics and Automation Letters 3(1), 2018, has the exact
set for a held acceleration; braking that is itself held over samples costs the slack that
`sampled_distance` takes off d). The position is inside between the samples as well: where v + a h
does not change sign it is monotonic, and where it does it turns before a joint that could be
stopped would.
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.compiled import jit

__all__ = ['acceleration_bounds', 'is_viable', 'sampled_distance']


@jit
def sampled_distance(distance: float, braking: float, period: float) -> float:
    """Return the distance that is left for braking that can only begin and end at samples.

    A joint that brakes with a_b stops within a sample; held to the end of that sample the last
    braking is reduced so that v = 0 there, on at most ⅛ a_b h² more than the continuous stop.

    Args:
        distance: To the limit [rad].
        braking: a_b [rad/s²].
        period: h [s].
    """
    return distance - 0.125 * braking * period * period


@jit
def is_viable(distance: float, speed: float, braking: float, period: float) -> bool:
    """Return whether a joint can be stopped before a limit.

    Args:
        distance: To the limit [rad].
        speed: Towards the limit [rad/s].
        braking: a_b [rad/s²].
        period: h [s].
    """
    room = sampled_distance(distance, braking, period)
    return room >= 0.0 and (speed <= 0.0 or speed * speed <= 2.0 * braking * room)


@jit
def _largest(distance: float, speed: float, speed_limit: float, braking: float,
             period: float) -> float:
    """Return the largest acceleration towards a limit after which the joint is still viable."""
    room = sampled_distance(distance, braking, period)
    for_speed = (speed_limit - speed) / period
    # h² a² + (2 v h + a_b h²) a + v² − 2 a_b (d − v h) ≤ 0
    half = speed * period + 0.5 * braking * period * period
    rest = speed * speed - 2.0 * braking * (room - speed * period)
    discriminant = half * half - period * period * rest
    for_position = -speed / period  # stop within the sample: no more can be done
    if discriminant >= 0.0:
        for_position = (math.sqrt(discriminant) - half) / (period * period)
    if speed + for_position * period < 0.0:
        # It moves away from the limit at the end of the sample: only the position counts there.
        for_position = max(for_position, min(2.0 * (room - speed * period) / (period * period),
                                             -speed / period))
    return min(for_speed, for_position)


@jit
def acceleration_bounds(q: np.ndarray, qd: np.ndarray, lower: np.ndarray, upper: np.ndarray,
                        speed_limit: np.ndarray, braking: np.ndarray, period: float,
                        ) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest and the largest acceleration of each joint, shape (n,) [rad/s²].

    Where the state is not viable the two may cross; their mean is then the fastest way back.

    Args:
        q: Positions, shape (n,) [rad].
        qd: Velocities, shape (n,) [rad/s].
        lower: Position limits, shape (n,) [rad].
        upper: Position limits, shape (n,) [rad].
        speed_limit: Shape (n,) [rad/s].
        braking: a_b of each joint, shape (n,) [rad/s²].
        period: h [s].
    """
    smallest, largest = np.empty(q.size), np.empty(q.size)
    for i in range(q.size):
        largest[i] = _largest(upper[i] - q[i], qd[i], speed_limit[i], braking[i], period)
        smallest[i] = -_largest(q[i] - lower[i], -qd[i], speed_limit[i], braking[i], period)
    return smallest, largest
