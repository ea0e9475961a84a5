# SPDX-License-Identifier: Apache-2.0
"""A sample of the safety filter: its model in a posture, and what a stop after it leaves free."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.chain import Chain
from adaptive_blf_control.arms.mass_and_bias import mass_and_bias
from adaptive_blf_control.compiled import jit
from adaptive_blf_control.limits.acceleration_error import (
    acceleration_error,
    model_inverses,
    Posture,
)
from adaptive_blf_control.limits.link_spheres import LinkSpheres
from adaptive_blf_control.limits.obstacles import Obstacles
from adaptive_blf_control.limits.stop_clearance import stop_clearances
from adaptive_blf_control.limits.stop_path import held_by_limits, kept_to, stop_path
from adaptive_blf_control.linear_algebra import inverse, product

__all__ = ['clear', 'FilterParts', 'JointLimits', 'left_free', 'Moment', 'passes', 'posture_of',
           'reserve_of', 'Room', 'Scene', 'standing', 'Stop', 'stop_after',
           'stopped']


class JointLimits(NamedTuple):
    """What the joints may do; arrays of shape (n,).

    Attributes:
        lower: Positions [rad].
        upper: Positions [rad].
        speed: Velocities [rad/s].
        braking: a_b, how hard each joint can brake at any time [rad/s²].
    """

    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    braking: np.ndarray


class Scene(NamedTuple):
    """What must not touch.

    Attributes:
        chain: Kinematics of the arm.
        spheres: On its links.
        obstacles: In the base's frame.
        pairs: Which may come close and stand still: a sphere, and an obstacle or −1 less another
            sphere, shape (p, 2).
        coming: Which may come close because the obstacle moves, likewise, shape (m, 2).
    """

    chain: Chain
    spheres: LinkSpheres
    obstacles: Obstacles
    pairs: np.ndarray
    coming: np.ndarray


class FilterParts(NamedTuple):
    """A safety filter, or what leads a reference round obstacles.

    Attributes:
        model: Handle of the arm with the set of its parameters, see `Model`.
        scene: Handle of spheres and obstacles, see `Scene`.
        limits: Of the joints.
        lead: T of `evasion` [s].
        exact: Whether an acceleration is exactly what it is told to be, as that of a reference.
        given: Matrices in place of the model's where it is.
    """

    model: Any
    scene: Any
    limits: JointLimits
    lead: float
    exact: bool
    given: Posture


class Moment(NamedTuple):
    """A state, and which torques are held for how long after it.

    Attributes:
        q: Positions, shape (n,) [rad].
        qd: Velocities, shape (n,) [rad/s].
        least: τ̲, shape (n,) [N·m].
        most: τ̅, shape (n,) [N·m].
        period: h [s].
    """

    q: np.ndarray
    qd: np.ndarray
    least: np.ndarray
    most: np.ndarray
    period: float


class Stop(NamedTuple):
    """A sample on a stop.

    Attributes:
        position: Where the joints are on it at the begin, shape (n,) [rad].
        velocity: Likewise, shape (n,) [rad/s].
        acceleration: On it until the next sample, however soon that is, shape (n,) [rad/s²].
    """

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


class Room(NamedTuple):
    """What a stop leaves free of the p pairs that may come close, see `stop_clearances`.

    Attributes:
        found: Least clearance until all joints stand, shape (p,) [m].
        before: The same on the stop that is left, shape (p,) [m].
        now: Clearance now, shape (p,) [m].
        gradients: Change of ``found`` with the acceleration, shape (p, n) [m·s²/rad].
    """

    found: np.ndarray
    before: np.ndarray
    now: np.ndarray
    gradients: np.ndarray


@jit
def standing(q: np.ndarray) -> Stop:
    """Return the stop of joints that stand at q, shape (n,) [rad]."""
    return Stop(q, np.zeros_like(q), np.zeros_like(q))


@jit
def stop_after(stop: Stop, time: float) -> Stop:
    """Return a stop as it stands after ``time`` [s]."""
    return Stop(stop.position + time * (stop.velocity + 0.5 * time * stop.acceleration),
                stop.velocity + time * stop.acceleration, stop.acceleration)


@jit
def posture_of(parts: FilterParts, q: np.ndarray, qd: np.ndarray) -> Posture:
    """Return the matrices of the model in a state, shape (n,) [rad] and [rad/s]."""
    if parts.exact:
        given = parts.given
        return Posture(given.inertia, given.bias, given.compliance, given.middle, given.radius)
    model = parts.model.value
    inertia, bias = mass_and_bias(model.centre, q, qd)
    middle, radius = model_inverses(model, q)
    return Posture(inertia, bias, inverse(inertia), middle, radius)


@jit
def _error_of(parts: FilterParts, posture: Posture, at: Moment, a: np.ndarray) -> np.ndarray:
    """Return the bound of |a* − a| under the torque of a, shape (n,) [rad/s²]."""
    if parts.exact:
        return np.zeros(a.size)
    torque = product(posture.inertia, a)
    for i in range(a.size):
        torque[i] += posture.bias[i]
    return acceleration_error(parts.model.value, posture, at.q, at.qd, a, torque, at.period)


@jit
def clear(parts: FilterParts, at: Moment, a: np.ndarray, error: np.ndarray, room: Room) -> None:
    """Write `stop_clearances` of the `stop_path` after a."""
    limits, scene = parts.limits, parts.scene.value
    held = held_by_limits(at.q, at.qd, a, error, limits.lower, limits.upper, limits.speed,
                          limits.braking, at.period)
    path = stop_path(at.qd, a, error, limits.braking, at.period, held)
    stop_clearances(scene.chain, scene.spheres, scene.obstacles, scene.pairs, at.q, path,
                    room.found, room.now, room.gradients)


@jit
def left_free(parts: FilterParts, posture: Posture, at: Moment, a: np.ndarray,
              room: Room) -> np.ndarray:
    """Return the bound of |a* − a|, (n,); where there are pairs, write what a stop leaves free."""
    error = _error_of(parts, posture, at, a)
    if room.found.size:
        clear(parts, at, a, error, room)
    return error


@jit
def stopped(parts: FilterParts, posture: Posture, at: Moment, onwards: np.ndarray, stop: Stop,
            room: Room) -> tuple[np.ndarray, np.ndarray]:
    """Return the acceleration that keeps to a stop, and the bound of how far the arm's is off it.

    Both of shape (n,) [rad/s²]; what that leaves free is written.

    Args:
        parts: The filter.
        posture: Matrices of the model.
        at: State and period.
        onwards: Acceleration on the stop in this sample, shape (n,) [rad/s²].
        stop: Where the joints are on it.
        room: Is written.
    """
    error = _error_of(parts, posture, at, onwards)
    brake = kept_to(onwards, stop.position, stop.velocity, at.q, at.qd, error, at.period)
    clear(parts, at, brake, error, room)
    return brake, error


@jit
def reserve_of(posture: Posture, braking: np.ndarray, error: np.ndarray, least: np.ndarray,
               most: np.ndarray) -> np.ndarray:
    """Return the torque that braking of all joints at once leaves, shape (n,) [N·m]."""
    reserve = np.empty(error.size)
    for i in range(error.size):
        reserve[i] = min(most[i] - posture.bias[i], posture.bias[i] - least[i])
        for j in range(error.size):
            reserve[i] -= abs(posture.inertia[i, j]) * (braking[j] + error[j])
    return reserve


@jit
def passes(values: np.ndarray, low: np.ndarray, high: np.ndarray, margin: np.ndarray) -> bool:
    """Return whether values are within bounds that are narrowed by a margin, shape (n,) each."""
    all_in = True
    for i in range(values.size):
        all_in = all_in and low[i] + margin[i] <= values[i] <= high[i] - margin[i]
    return all_in
