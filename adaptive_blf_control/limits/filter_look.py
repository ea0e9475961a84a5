# SPDX-License-Identifier: Apache-2.0
"""What a sample of the safety filter is before anything is solved, and what a stop leaves free."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.chain import Chain
from adaptive_blf_control.arms.mass_and_bias import mass_and_bias
from adaptive_blf_control.compiled import Handle, jit
from adaptive_blf_control.limits.acceleration_error import (
    acceleration_error,
    model_inverses,
    Posture,
)
from adaptive_blf_control.limits.link_spheres import LinkSpheres
from adaptive_blf_control.limits.obstacles import Obstacles
from adaptive_blf_control.limits.stop_path import (
    held_by_limits,
    kept_to,
    stop_clearances,
    stop_path,
)
from adaptive_blf_control.limits.viability import acceleration_bounds
from adaptive_blf_control.linear_algebra import inverse, product

__all__ = ['BIAS', 'clear', 'ERROR', 'JointLimits', 'left_free', 'Look', 'looked_at', 'LOWER',
           'passes', 'PLACE', 'RESERVE', 'reserve_of', 'Scene', 'SPEED', 'stopped', 'UPPER',
           'WANTED']

BIAS, WANTED, LOWER, UPPER, ERROR, RESERVE, PLACE, SPEED = range(8)
"""Rows of `Look.values`: h_c [N·m], a_w, a̲, a̅ and e of a_w within these [rad/s²], the reserve as
in `Report` [N·m], positions [rad] and velocities [rad/s] after the sample."""


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
        pairs: Which may come close: a sphere, and an obstacle or −1 less another sphere,
            shape (p, 2).
    """

    chain: Chain
    spheres: LinkSpheres
    obstacles: Obstacles
    pairs: np.ndarray


@jit
def posture_of(model: Handle, q: np.ndarray, qd: np.ndarray) -> Posture:
    """Return the matrices of the model in a state, shape (n,) [rad] and [rad/s]."""
    inertia, bias = mass_and_bias(model.value.centre, q, qd)
    middle, radius = model_inverses(model.value, q)
    return Posture(inertia, bias, inverse(inertia), middle, radius)


@jit
def error_of(model: Handle, exact: bool, posture: Posture, q: np.ndarray, qd: np.ndarray,
             a: np.ndarray, period: float) -> np.ndarray:
    """Return the bound of |a* − a| under the torque of a, shape (n,) [rad/s²]."""
    if exact:
        return np.zeros(q.size)
    torque = product(posture.inertia, a)
    for i in range(q.size):
        torque[i] += posture.bias[i]
    return acceleration_error(model.value, posture, q, qd, a, torque, period)


@jit
def clear(scene: Handle, q: np.ndarray, qd: np.ndarray, a: np.ndarray, error: np.ndarray,
          limits: JointLimits, period: float, found: np.ndarray, now: np.ndarray,
          gradients: np.ndarray) -> None:
    """Write `stop_clearances` of the `stop_path` after a."""
    parts = scene.value
    held = held_by_limits(q, qd, a, error, limits.lower, limits.upper, limits.speed,
                          limits.braking, period)
    path = stop_path(qd, a, error, limits.braking, period, held)
    stop_clearances(parts.chain, parts.spheres, parts.obstacles, parts.pairs, q, path, found, now,
                    gradients)


@jit
def left_free(model: Handle, scene: Handle, exact: bool, posture: Posture, limits: JointLimits,
              period: float, q: np.ndarray, qd: np.ndarray, a: np.ndarray, found: np.ndarray,
              now: np.ndarray, gradients: np.ndarray) -> np.ndarray:
    """Return `error_of` a; where there are pairs, write what the stop after a leaves free."""
    error = error_of(model, exact, posture, q, qd, a, period)
    if found.size:
        clear(scene, q, qd, a, error, limits, period, found, now, gradients)
    return error


@jit
def stopped(model: Handle, scene: Handle, exact: bool, posture: Posture, limits: JointLimits,
            period: float, q: np.ndarray, qd: np.ndarray, onwards: np.ndarray,
            place: np.ndarray, speed: np.ndarray, found: np.ndarray, now: np.ndarray,
            gradients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the acceleration that keeps a stop, and `error_of` it; write as `left_free`."""
    error = error_of(model, exact, posture, q, qd, onwards, period)
    brake = kept_to(onwards, place, speed, q, qd, error, period)
    clear(scene, q, qd, brake, error, limits, period, found, now, gradients)
    return brake, error


class Look(NamedTuple):
    """A sample before anything is solved.

    Attributes:
        values: See `Row`, shape (8, n).
        matrices: M_c, M_c⁻¹, N and R of `Posture`, shape (4, n, n).
        passes: Whether a_w keeps the rows of the joints, and its torque the box.
        near: Smallest clearance now [m]; inf without pairs.
        free: Smallest clearance of a stop after a_w within the bounds [m]; inf without pairs.
    """

    values: np.ndarray
    matrices: np.ndarray
    passes: bool
    near: float
    free: float

    @property
    def posture(self) -> Posture:
        """Matrices of the model."""
        return Posture(self.matrices[0], self.values[BIAS], *self.matrices[1:])


@jit
def looked_at(model: Handle, scene: Handle, exact: bool, given: Posture, limits: JointLimits,
              period: float, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
              least: np.ndarray, most: np.ndarray, found: np.ndarray, now: np.ndarray,
              gradients: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool, float, float]:
    """Return the fields of `Look`; write as `left_free`.

    All in one call, and in few arrays: each costs a call from Python a microsecond.
    """
    n = q.size
    posture = given if exact else posture_of(model, q, qd)
    values, matrices = np.empty((8, n)), np.empty((4, n, n))
    matrices[0], matrices[1] = posture.inertia, posture.compliance
    matrices[2], matrices[3] = posture.middle, posture.radius
    wanted = product(posture.compliance, torque - posture.bias)
    lower, upper = acceleration_bounds(q, qd, limits.lower, limits.upper, limits.speed,
                                       limits.braking, period)
    a = np.minimum(np.maximum(wanted, lower), upper)
    error = left_free(model, scene, exact, posture, limits, period, q, qd, a, found, now,
                      gradients)
    values[BIAS], values[WANTED], values[LOWER], values[UPPER] = posture.bias, wanted, lower, upper
    values[ERROR] = error
    values[RESERVE] = reserve_of(posture, limits.braking, error, least, most)
    values[PLACE] = q + period * (qd + 0.5 * period * wanted)
    values[SPEED] = qd + period * wanted
    kept = (passes(wanted, lower, upper, error)
            and passes(torque, least, most, np.zeros(n)))
    near, free = np.inf, np.inf
    for p in range(found.size):
        near, free = min(near, now[p]), min(free, found[p])
    return values, matrices, kept, near, free


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
