# SPDX-License-Identifier: Apache-2.0
"""One sample of the safety filter: the torque nearest to the wanted one that keeps the limits.

In the acceleration a of the model, M_c a + h_c = τ, and with e the bound of |a* − a|:

    min ½ (a − a_w)ᵀ M_c (a − a_w)   subject to
    a̲ + e ≤ a ≤ a̅ − e     velocity, and position that braking keeps inside (`viability`)
    b(a) ≥ b₀ − γ max(b₀ − β, 0)   b what the stop after a leaves free (`stop_path`), linearised,
                           and b₀ what the stop that is left does
    τ̲ ≤ M_c a + h_c ≤ τ̅    the torque box, always

What is wanted passes bit for bit where it keeps every row by itself. Where there is no such a, the
rows but for the torque box give way, as little as they have to (SOFTENED). Where the stop after
the solution is not free, it goes back towards the stop that the sample before has left, which is,
and to that where nothing less does (BRAKING).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.limits.acceleration_error import Posture
from adaptive_blf_control.limits.filter_look import (
    clear,
    ERROR,
    JointLimits,
    left_free,
    Look,
    looked_at,
    LOWER,
    passes,
    PLACE,
    RESERVE,
    reserve_of,
    SPEED,
    stopped,
    UPPER,
    WANTED,
)
from adaptive_blf_control.limits.quadratic_program import solve
from adaptive_blf_control.limits.stop_path import FAR

__all__ = ['ACTIVE', 'BRAKING', 'filter_step', 'FilterParts', 'IDLE', 'narrowed', 'Report',
           'SOFTENED', 'Stop']

IDLE, ACTIVE, BRAKING, SOFTENED = 0, 1, 2, 3
ROUNDS = 4  # solutions, each with the bound of the error of the one before
PARTS = (0.7, 0.4, 0.2, 0.1, 0.05, 0.0)  # of the way from braking to a solution
GAMMA = 0.05  # γ, part of the free way that a sample may use up
BUFFER = 1e-4  # β, what no sample uses up: for the curvature of b, which the rows leave out [m]
ROUNDING = 1e-9  # of a clearance [m]
NEEDED = (1.0 - GAMMA) * FAR + GAMMA * BUFFER  # no stop has to be freer than that [m]
NEAREST = 8  # rows of obstacles at a time
SOFT = 1e-6  # softness of a row that gives way, in units of its own curvature
SLACK = 1e-9  # growth of the bound of the error that counts as none [rad/s²]


class FilterParts(NamedTuple):
    """A safety filter.

    Attributes:
        model: Handle of the arm with the set of its parameters, see `Model`.
        scene: Handle of spheres and obstacles, see `Scene`.
        pairs: Number of pairs that may come close.
        limits: Of the joints.
        period: Longest time that a torque is held [s].
        exact: Matrices of a motion whose acceleration is exactly what it is told, in place of
            the model; None for an arm.
    """

    model: Any
    scene: Any
    pairs: int
    limits: JointLimits
    period: float
    exact: Posture | None = None


class Stop(NamedTuple):
    """Where the joints are on the stop that the sample before has left.

    Attributes:
        position: At the begin of this sample, shape (n,) [rad].
        velocity: Likewise, shape (n,) [rad/s].
    """

    position: np.ndarray
    velocity: np.ndarray

    def braking(self, limits: JointLimits, period: float) -> np.ndarray:
        """Return the acceleration of this sample on it, shape (n,) [rad/s²]."""
        return np.minimum(np.maximum(-self.velocity / period, -limits.braking), limits.braking)

    def after(self, a: np.ndarray, period: float) -> Stop:
        """Return where the joints are after a sample with ``a``, shape (n,) [rad/s²]."""
        return Stop(self.position + period * (self.velocity + 0.5 * period * a),
                    self.velocity + period * a)


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
        stop: What the next sample may fall back on.
    """

    torque: np.ndarray
    kind: int
    acceleration: np.ndarray
    error: np.ndarray
    reserve: np.ndarray
    clearance: float
    stop_clearance: float
    stop: Stop


def filter_step(parts: FilterParts, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                least: np.ndarray, most: np.ndarray, left: Stop | None = None) -> Report:
    """Answer a sample.

    Args:
        parts: The filter.
        q: Positions, shape (n,) [rad].
        qd: Velocities, shape (n,) [rad/s].
        torque: Wanted, shape (n,) [N·m].
        least: τ̲, shape (n,) [N·m].
        most: τ̅, shape (n,) [N·m].
        left: The stop that the sample before has left; None where there was none.
    """
    limits, period = parts.limits, parts.period
    room = _room(parts, q.size)
    given = parts.exact or _no_posture(q.size)
    look = Look(*looked_at(parts.model, parts.scene, parts.exact is not None, given, limits,
                           period, q, qd, torque, least, most, room.found, room.now,
                           room.gradients))
    values, idle, braked = look.values, look.passes, None
    if room.found.size and (not idle or look.free < NEEDED):
        found = room.found.copy()
        braked = _braked(parts, look.posture, q, qd, Stop(q, qd) if left is None else left, room)
        idle = idle and _uses_its_part(found, room.before)
    if idle:
        return Report(torque, IDLE, values[WANTED], values[ERROR], values[RESERVE], look.near,
                      look.free, Stop(values[PLACE], values[SPEED]))
    posture, wanted, error = look.posture, values[WANTED], values[ERROR]
    lower, upper = values[LOWER], values[UPPER]
    a = np.minimum(np.maximum(wanted, lower), upper)
    if braked is not None:  # braking keeps the rows of obstacles: there they are linearised first
        a = braked.a
    kind, rounds = ACTIVE, 0
    while True:
        rounds += 1
        a, kind = solved(posture, wanted, *narrowed(lower, upper, error), least, most, a,
                         room, NEAREST)
        needed = _leaves(parts, posture, q, qd, a, room)
        growth = np.maximum(needed - error, 0.0)
        certain = not (growth > SLACK).any()
        # With twice the growth: what follows from the larger error is then within it.
        error = error + 2.0 * growth
        free = _may_go_on(room, qd, limits, period)
        if rounds == ROUNDS or (certain and free):
            break
    if not certain:
        kind = SOFTENED
    stop = Stop(q, qd).after(a, period)
    # Where rows of several obstacles contradict each other the stop that is left keeps all.
    if braked is not None and (not free or kind == SOFTENED):
        a, kind, error, stop = _backed_off(parts, posture, q, qd, a, braked, lower, upper, least,
                                           most, room)
    answer = posture.inertia @ a + posture.bias
    if not np.isfinite(answer).all():  # from what is not a number; then no torque but what must be
        answer, kind, stop = np.zeros_like(q), SOFTENED, Stop(q, np.zeros_like(q))
    answer = np.minimum(np.maximum(answer, least), most)
    return Report(answer, kind, a, error,
                  reserve_of(posture, limits.braking, error, least, most),
                  float(room.now.min(initial=np.inf)), float(room.found.min(initial=np.inf)), stop)


@lru_cache
def _no_posture(n: int) -> Posture:
    """Return what stands for no posture where compiled functions ask for one."""
    none = np.zeros((n, n))
    return Posture(none, np.zeros(n), none, none, none)


class Braked(NamedTuple):
    """The stop that the sample before has left.

    Attributes:
        a: Acceleration that keeps it, shape (n,) [rad/s²].
        error: Bound of how far the arm's may be from that, shape (n,) [rad/s²].
        after: Where the joints are on it after this sample.
    """

    a: np.ndarray
    error: np.ndarray
    after: Stop


def _braked(parts: FilterParts, posture: Posture, q: np.ndarray, qd: np.ndarray, stop: Stop,
            room: Room) -> Braked:
    """Return the stop that is left; what it leaves free is `Room.before`, and in ``room``."""
    onwards = stop.braking(parts.limits, parts.period)
    brake, error = stopped(parts.model, parts.scene, parts.exact is not None, posture,
                           parts.limits, parts.period, q, qd, onwards, stop.position,
                           stop.velocity, room.found, room.now, room.gradients)
    room.before[:] = room.found
    return Braked(brake, error, stop.after(onwards, parts.period))


def _may_go_on(room: Room, qd: np.ndarray, limits: JointLimits, period: float) -> bool:
    """Return whether all of a stop is free.

    An arm that stands closer than that already may go where it does not come closer still.
    """
    if (np.abs(qd) <= 2.0 * period * limits.braking).all():
        return bool((room.found >= np.minimum(room.before - ROUNDING, 0.0)).all())
    return bool((room.found >= 0.0).all())


def _backed_off(parts: FilterParts, posture: Posture, q: np.ndarray, qd: np.ndarray,
                a: np.ndarray, braked: Braked, lower: np.ndarray, upper: np.ndarray,
                least: np.ndarray, most: np.ndarray, room: Room,
                ) -> tuple[np.ndarray, int, np.ndarray, Stop]:
    """Return what is as far from the stop that is left towards ``a`` as leaves a stop free."""
    period = parts.period
    low, high = narrowed(lower, upper, braked.error)
    brake = np.minimum(np.maximum(braked.a, low), high)
    tight, solution = np.full_like(q, SLACK), ACTIVE
    if not passes(posture.inertia @ brake + posture.bias, least, most, np.zeros_like(q)):
        brake, solution = solved(posture, brake, brake - tight, brake + tight, least, most, brake,
                                 room, 0)
    for part in PARTS[:-1]:
        tried = brake + part * (a - brake)
        needed = _leaves(parts, posture, q, qd, tried, room)
        if _may_go_on(room, qd, parts.limits, period) and passes(tried, lower, upper, needed):
            return tried, solution, needed, Stop(q, qd).after(tried, period)
    if room.found.size:
        clear(parts.scene, q, qd, brake, braked.error, parts.limits, period, room.found, room.now,
              room.gradients)
    return (brake, BRAKING if solution == ACTIVE else SOFTENED, braked.error, braked.after)


def _room(parts: FilterParts, n: int) -> Room:
    count = parts.pairs
    return Room(np.empty(count), np.zeros(count), np.empty(count), np.empty((count, n)))


def _leaves(parts: FilterParts, posture: Posture, q: np.ndarray, qd: np.ndarray, a: np.ndarray,
            room: Room) -> np.ndarray:
    """Write what a stop after a leaves free, and its change with a; return `error_of` a."""
    error: np.ndarray = left_free(parts.model, parts.scene, parts.exact is not None, posture,
                                  parts.limits, parts.period, q, qd, a, room.found, room.now,
                                  room.gradients)
    return error


def narrowed(lower: np.ndarray, upper: np.ndarray,
             error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the bounds less the error; their mean where they cross."""
    low, high = lower + error, upper - error
    middle, crossed = 0.5 * (low + high), low > high
    return np.where(crossed, middle, low), np.where(crossed, middle, high)


@jit
def _least_of(before: float) -> float:
    """Return how free a stop has to be where the one that is left has ``before`` [m].

    Beyond `FAR` nobody has looked closer, so that more than that is never asked for.
    """
    known = min(before, FAR)
    return known - GAMMA * max(known - BUFFER, 0.0)


@jit
def _uses_its_part(found: np.ndarray, before: np.ndarray) -> bool:
    """Return whether a sample uses up no more of the free way than it may."""
    kept = True
    for p in range(found.size):
        kept = kept and found[p] >= max(_least_of(before[p]), 0.0)
    return kept


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
    nearest = -1
    for p in range(found.size):
        if found[p] > past and (nearest < 0 or found[p] < found[nearest]):
            nearest = p
    row = np.zeros(a.size)
    row[0] = 1.0
    if nearest < 0:
        return row, -1e30, past
    bound, square = _least_of(before[nearest]) - found[nearest], 0.0
    for j in range(a.size):
        square += gradients[nearest, j] * gradients[nearest, j]
        bound += gradients[nearest, j] * a[j]
    if square <= 0.0:
        return row, -1e30, found[nearest]
    scale = 1.0 / np.sqrt(square)
    for j in range(a.size):
        row[j] = gradients[nearest, j] * scale
    return row, bound * scale, found[nearest]


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
