# SPDX-License-Identifier: Apache-2.0
"""One sample of the safety filter: the torque nearest to the wanted one that keeps the limits.

In the acceleration a of the model, M_c a + h_c = τ, and with e the bound of |a* − a|:

    min ½ (a − a_w)ᵀ M_c (a − a_w)   subject to
    a̲ + e ≤ a ≤ a̅ − e     velocity, and position that braking keeps inside (`viability`)
    b(a) ≥ (1 − γ) b(a_b)   what a stop leaves free of each obstacle (`stop_box`), linearised
    τ̲ ≤ M_c a + h_c ≤ τ̅    the torque box, always

What is wanted passes bit for bit where it keeps every row by itself. Where there is no such a, the
rows but for the torque box give way, as little as they have to (SOFTENED). Where the solution does
not leave every sphere free until all joints stand, it goes back towards braking of all joints, and
to that where nothing less does (BRAKING): braking keeps them in the box of postures that was free.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.chain import Chain
from adaptive_blf_control.arms.mass_and_bias import mass_and_bias
from adaptive_blf_control.compiled import Handle, jit
from adaptive_blf_control.limits.acceleration_error import (
    acceleration_error,
    inverse,
    model_inverses,
    Posture,
)
from adaptive_blf_control.limits.link_spheres import LinkSpheres
from adaptive_blf_control.limits.obstacles import Obstacles
from adaptive_blf_control.limits.quadratic_program import solve
from adaptive_blf_control.limits.stop_box import clearances, stop_box
from adaptive_blf_control.limits.viability import acceleration_bounds

__all__ = ['ACTIVE', 'BRAKING', 'filter_step', 'FilterParts', 'IDLE', 'JointLimits', 'Report',
           'Scene', 'SOFTENED']

IDLE, ACTIVE, BRAKING, SOFTENED = 0, 1, 2, 3
ROUNDS = 4  # solutions, each with the bound of the error of the one before
PARTS = (0.7, 0.4, 0.2, 0.1, 0.05, 0.0)  # of the way from braking to a solution
WIDER = 1.5  # times the error at braking: the one that braking is solved with
GAMMA = 0.05  # part of the free way that a sample may use up
NEAREST = 8  # rows of obstacles at a time
SOFT = 1e-6  # softness of a row that gives way, in units of its own curvature
SLACK = 1e-9  # growth of the bound of the error that counts as none [rad/s²]


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
    """

    chain: Chain
    spheres: LinkSpheres
    obstacles: Obstacles


class FilterParts(NamedTuple):
    """A safety filter.

    Attributes:
        model: Handle of the arm with the set of its parameters, see `Model`.
        scene: Handle of spheres and obstacles, see `Scene`.
        shape: Number of spheres and of obstacles.
        limits: Of the joints.
        period: Longest time that a torque is held [s].
        exact: Matrices of a motion whose acceleration is exactly what it is told, in place of
            the model; None for an arm.
    """

    model: Any
    scene: Any
    shape: tuple[int, int]
    limits: JointLimits
    period: float
    exact: Posture | None = None


class Room(NamedTuple):
    """What a stop leaves free of k spheres and l obstacles, see `clearances`.

    Attributes:
        found: Least clearance until all joints stand, shape (k, l) [m].
        before: The same where every joint brakes at once, shape (k, l) [m].
        now: Clearance now, shape (k, l) [m].
        gradients: Change of ``found`` with the acceleration, shape (k, l, n) [m·s²/rad].
    """

    found: np.ndarray
    before: np.ndarray
    now: np.ndarray
    gradients: np.ndarray


class Report(NamedTuple):
    """What a sample found out.

    Attributes:
        torque: To be commanded, shape (n,) [N·m].
        kind: IDLE, ACTIVE, BRAKING or SOFTENED.
        acceleration: Of the model under it, shape (n,) [rad/s²].
        error: Bound of how far the arm's may be from that, shape (n,) [rad/s²].
        reserve: Torque that braking of all joints at once leaves, shape (n,) [N·m]; where it is
            nowhere negative the limits of the joints can be kept.
        clearance: Smallest distance of a sphere from an obstacle now [m]; inf without.
        stop_clearance: A bound of it from below until all joints stand [m]; inf without.
    """

    torque: np.ndarray
    kind: int
    acceleration: np.ndarray
    error: np.ndarray
    reserve: np.ndarray
    clearance: float
    stop_clearance: float


def filter_step(parts: FilterParts, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                least: np.ndarray, most: np.ndarray) -> Report:
    """Answer a sample.

    Args:
        parts: The filter.
        q: Positions, shape (n,) [rad].
        qd: Velocities, shape (n,) [rad/s].
        torque: Wanted, shape (n,) [N·m].
        least: τ̲, shape (n,) [N·m].
        most: τ̅, shape (n,) [N·m].
    """
    limits, period = parts.limits, parts.period
    posture = parts.exact or posture_of(parts.model, q, qd)
    wanted = posture.compliance @ (torque - posture.bias)
    lower, upper = acceleration_bounds(q, qd, *limits, period)
    room = _room(parts, q.size)
    brake = np.minimum(np.maximum(-qd / period, -limits.braking), limits.braking)
    if room.found.size:
        error = _error(parts, posture, q, qd, brake)
        _leaves(parts, q, qd, brake, error, room)
        room.before[:] = room.found
    a = np.minimum(np.maximum(wanted, lower), upper)
    error = _error(parts, posture, q, qd, a)
    free = _leaves(parts, q, qd, a, error, room)
    if (_passes(wanted, lower, upper, error) and _passes(torque, least, most, np.zeros_like(q))
            and _uses_its_part(room.found, room.before)):
        return _report(posture, torque, IDLE, wanted, error, limits, least, most, room, free)
    if room.found.size:  # braking keeps the rows of obstacles: there they are linearised first
        a = brake
        _leaves(parts, q, qd, a, error, room)
    kind, rounds = ACTIVE, 0
    while True:
        rounds += 1
        a, kind = solved(posture, wanted, *narrowed(lower, upper, error), least, most, a,
                         room, NEAREST)
        needed = _error(parts, posture, q, qd, a)
        free = _leaves(parts, q, qd, a, needed, room)
        growth = np.maximum(needed - error, 0.0)
        certain = not (growth > SLACK).any()
        # With twice the growth: what follows from the larger error is then within it.
        error = error + 2.0 * growth
        if rounds == ROUNDS or (certain and free >= 0.0):
            break
    if not certain:
        kind = SOFTENED
    if free < 0.0:
        a, kind, error, free = _backed_off(parts, posture, q, qd, wanted, a, brake, lower, upper,
                                           least, most, room)
    answer = posture.inertia @ a + posture.bias
    if not np.isfinite(answer).all():  # from what is not a number; then no torque but what must be
        answer, kind = np.zeros_like(q), SOFTENED
    answer = np.minimum(np.maximum(answer, least), most)
    return _report(posture, answer, kind, a, error, limits, least, most, room, free)


def _backed_off(parts: FilterParts, posture: Posture, q: np.ndarray, qd: np.ndarray,
                wanted: np.ndarray, a: np.ndarray, brake: np.ndarray, lower: np.ndarray,
                upper: np.ndarray, least: np.ndarray, most: np.ndarray, room: Room,
                ) -> tuple[np.ndarray, int, np.ndarray, float]:
    """Return what is as far from braking of all joints towards ``a`` as leaves a stop free.

    What a stop leaves free is concave in a, so that a part of the way always does where braking
    leaves something.
    """
    error = WIDER * _error(parts, posture, q, qd, brake)
    braked, solution = solved(posture, wanted, *_braking_bounds(qd, brake, error, parts.period),
                              least, most, brake, room, 0)
    for part in PARTS:
        tried = braked + part * (a - braked)
        needed = _error(parts, posture, q, qd, tried)
        free = _leaves(parts, q, qd, tried, needed, room)
        if part == 0.0 or (free >= 0.0 and _passes(tried, lower, upper, needed)):
            break
    kind = BRAKING if part == 0.0 else ACTIVE
    if solution == SOFTENED or (part == 0.0 and (needed > error + SLACK).any()):
        kind = SOFTENED
    return tried, kind, needed, free


def _room(parts: FilterParts, n: int) -> Room:
    shape = parts.shape
    return Room(np.empty(shape), np.zeros(shape), np.empty(shape), np.empty((*shape, n)))


def _error(parts: FilterParts, posture: Posture, q: np.ndarray, qd: np.ndarray,
           a: np.ndarray) -> np.ndarray:
    """Return the bound of |a* − a| under the torque of a, shape (n,) [rad/s²]."""
    if parts.exact is not None:
        return np.zeros_like(q)
    error: np.ndarray = error_of(parts.model, posture, q, qd, a,
                                 posture.inertia @ a + posture.bias, parts.period)
    return error


def _leaves(parts: FilterParts, q: np.ndarray, qd: np.ndarray, a: np.ndarray, error: np.ndarray,
            room: Room) -> float:
    """Write what a stop after a leaves free, and its change with a; return the least [m]."""
    if not room.found.size:
        return np.inf
    braking, period = parts.limits.braking, parts.period
    low, high, slope = stop_box(qd, a, error, braking, period)
    standstill = period + float(((np.abs(qd) + period * (np.abs(a) + error)) / braking).max())
    clear(parts.scene, q, low, high, standstill, room.found, room.now, room.gradients)
    np.multiply(room.gradients, slope, out=room.gradients)
    return float(room.found.min())


def _report(posture: Posture, torque: np.ndarray, kind: int, a: np.ndarray, error: np.ndarray,
            limits: JointLimits, least: np.ndarray, most: np.ndarray, room: Room,
            free: float) -> Report:
    bias = posture.bias
    reserve = (np.minimum(most - bias, bias - least)
               - np.abs(posture.inertia) @ (limits.braking + error))
    return Report(torque, kind, a, error, reserve, float(room.now.min(initial=np.inf)), free)


def narrowed(lower: np.ndarray, upper: np.ndarray,
             error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the bounds less the error; their mean where they cross."""
    low, high = lower + error, upper - error
    middle, crossed = 0.5 * (low + high), low > high
    return np.where(crossed, middle, low), np.where(crossed, middle, high)


def _braking_bounds(qd: np.ndarray, brake: np.ndarray, error: np.ndarray,
                    period: float) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds within which every joint brakes, and if that allows it does not turn."""
    forth, stop = qd > 0.0, -qd / period
    low = np.where(forth, np.minimum(stop + error, brake - error), brake + error)
    high = np.where(forth, brake - error, np.maximum(stop - error, brake + error))
    return low, high


@jit
def posture_of(model: Handle, q: np.ndarray, qd: np.ndarray) -> Posture:
    """Return the matrices of the model in a state, shape (n,) [rad] and [rad/s]."""
    inertia, bias = mass_and_bias(model.value.centre, q, qd)
    middle, radius = model_inverses(model.value, q)
    return Posture(inertia, bias, inverse(inertia), middle, radius)


@jit
def error_of(model: Handle, posture: Posture, q: np.ndarray, qd: np.ndarray, a: np.ndarray,
             torque: np.ndarray, period: float) -> np.ndarray:
    """Return `acceleration_error`."""
    return acceleration_error(model.value, posture, q, qd, a, torque, period)


@jit
def clear(scene: Handle, q: np.ndarray, low: np.ndarray, high: np.ndarray, standstill: float,
          found: np.ndarray, now: np.ndarray, gradients: np.ndarray) -> None:
    """Write `clearances`."""
    parts = scene.value
    clearances(parts.chain, parts.spheres, parts.obstacles, q, low, high, standstill, found, now,
               gradients)


@jit
def _passes(values: np.ndarray, low: np.ndarray, high: np.ndarray, margin: np.ndarray) -> bool:
    passes = True
    for i in range(values.size):
        passes = passes and low[i] + margin[i] <= values[i] <= high[i] - margin[i]
    return passes


@jit
def _uses_its_part(found: np.ndarray, before: np.ndarray) -> bool:
    """Return whether a sample leaves 1 − γ of the way that is free before each obstacle."""
    for s in range(found.shape[0]):
        for k in range(found.shape[1]):
            if found[s, k] < max((1.0 - GAMMA) * before[s, k], 0.0):
                return False
    return True


@jit
def _rows(inertia: np.ndarray, bias: np.ndarray, lower: np.ndarray, upper: np.ndarray,
          least: np.ndarray, most: np.ndarray, a: np.ndarray, found: np.ndarray,
          before: np.ndarray, gradients: np.ndarray, nearest: int,
          ) -> tuple[np.ndarray, np.ndarray]:
    """Return C and b of C a ≥ b: torque box, joints, and the obstacles that a stop is nearest."""
    n, pairs = bias.size, min(nearest, found.size)
    rows, bounds = np.zeros((4 * n + pairs, n)), np.empty(4 * n + pairs)
    for i in range(n):
        rows[2 * n + i, i], rows[3 * n + i, i] = 1.0, -1.0
        bounds[2 * n + i], bounds[3 * n + i] = lower[i], -upper[i]
        for j in range(n):
            rows[i, j], rows[n + i, j] = inertia[i, j], -inertia[i, j]
        bounds[i], bounds[n + i] = least[i] - bias[i], bias[i] - most[i]
    past = -np.inf
    for r in range(4 * n, 4 * n + pairs):
        row, bound, past = _obstacle_row(a, found, before, gradients, past)
        rows[r], bounds[r] = row, bound
    return rows, bounds


@jit
def _obstacle_row(a: np.ndarray, found: np.ndarray, before: np.ndarray, gradients: np.ndarray,
                  past: float) -> tuple[np.ndarray, float, float]:
    """Return the row of the pair that is nearest but for those up to ``past``, and its way."""
    s, k = -1, -1
    for i in range(found.shape[0]):
        for j in range(found.shape[1]):
            if found[i, j] > past and (s < 0 or found[i, j] < found[s, k]):
                s, k = i, j
    row = np.zeros(a.size)
    row[0] = 1.0
    if s < 0:
        return row, -1e30, past
    bound, square = max((1.0 - GAMMA) * before[s, k], 0.0) - found[s, k], 0.0
    for j in range(a.size):
        square += gradients[s, k, j] * gradients[s, k, j]
        bound += gradients[s, k, j] * a[j]
    if square <= 0.0:
        return row, -1e30, found[s, k]
    scale = 1.0 / np.sqrt(square)
    for j in range(a.size):
        row[j] = gradients[s, k, j] * scale
    return row, bound * scale, found[s, k]


@jit
def solved(posture: Posture, wanted: np.ndarray, lower: np.ndarray, upper: np.ndarray,
           least: np.ndarray, most: np.ndarray, a: np.ndarray, room: Room,
           nearest: int) -> tuple[np.ndarray, int]:
    """Return the solution with all rows hard, else with the torque box hard and the rest soft.

    Args:
        posture: Matrices of the model.
        wanted: a_w, shape (n,) [rad/s²].
        lower: Least acceleration of each joint, shape (n,) [rad/s²].
        upper: Largest acceleration, shape (n,) [rad/s²].
        least: τ̲, shape (n,) [N·m].
        most: τ̅, shape (n,) [N·m].
        a: Where the rows of obstacles are linearised, shape (n,) [rad/s²].
        room: At ``a``.
        nearest: Number of rows of obstacles.
    """
    n, compliance = wanted.size, posture.compliance
    rows, bounds = _rows(posture.inertia, posture.bias, lower, upper, least, most, a, room.found,
                         room.before, room.gradients, nearest)
    softness, multipliers = np.zeros(bounds.size), np.empty(bounds.size)
    answer = wanted
    for kind in (ACTIVE, SOFTENED):
        answer, steps = solve(compliance, wanted, rows, bounds, softness, multipliers)
        if steps >= 0 and kind == ACTIVE:
            return answer, ACTIVE
        for r in range(2 * n, bounds.size):
            softness[r] = 0.0
            for i in range(n):
                for j in range(n):
                    softness[r] += SOFT * rows[r, i] * compliance[i, j] * rows[r, j]
    return answer, SOFTENED
