# SPDX-License-Identifier: Apache-2.0
"""One sample of the safety filter: the torque nearest to the wanted one that keeps the limits.

In the acceleration a of the model, M_c a + h_c = τ, and with e the bound of |a* − a|:

    min ½ (a − a_w)ᵀ M_c (a − a_w)   subject to
    a̲ + e ≤ a ≤ a̅ − e     velocity, and position that braking keeps inside (`viability`)
    b(a) ≥ b₀ − γ max(b₀ − β, 0)   b what the stop after a leaves free (`stop_path`), linearised,
                           and b₀ what the stop that is left does
    c a ≥ d                away from what moves (`evasion`), always soft
    τ̲ ≤ M_c a + h_c ≤ τ̅    the torque box, always

What is wanted passes bit for bit where it keeps every row by itself. Where there is no such a, the
rows but for the torque box give way, as little as they have to (SOFTENED). Where the stop after
the solution is not free, it goes back towards the stop that the sample before has left, which is,
and to that where nothing less does (BRAKING).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, Handle, jit
from adaptive_blf_control.limits.acceleration_error import Posture
from adaptive_blf_control.limits.evasion import Evasion, evasion_of, gives_way, no_evasion
from adaptive_blf_control.limits.filter_look import (
    clear,
    FilterParts,
    left_free,
    Moment,
    passes,
    posture_of,
    reserve_of,
    Room,
    standing,
    Stop,
    stop_after,
    stopped,
)
from adaptive_blf_control.limits.quadratic_program import solve
from adaptive_blf_control.limits.stop_clearance import FAR
from adaptive_blf_control.limits.viability import acceleration_bounds
from adaptive_blf_control.linear_algebra import product

__all__ = ['ACTIVE', 'BRAKING', 'filter_step', 'IDLE', 'narrowed', 'Report', 'SOFTENED']

IDLE, ACTIVE, BRAKING, SOFTENED = 0, 1, 2, 3
ROUNDS = 4  # solutions, each with the bound of the error of the one before
PARTS = (0.7, 0.4, 0.2, 0.1, 0.05)  # of the way from braking to a solution
GAMMA = 0.05  # γ, part of the free way that a sample may use up
BUFFER = 1e-4  # β, what no sample uses up: for the curvature of b, which the rows leave out [m]
ROUNDING = 1e-9  # of a clearance [m]
NEEDED = (1.0 - GAMMA) * FAR + GAMMA * BUFFER  # no stop has to be freer than that [m]
NEAREST = 8  # rows of obstacles at a time
SOFT = 1e-6  # softness of a row that gives way, in units of its own curvature
SLACK = 1e-9  # growth of the bound of the error that counts as none [rad/s²]


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


class Braked(NamedTuple):
    """The stop that the sample before has left.

    Attributes:
        a: Acceleration that keeps it, shape (n,) [rad/s²].
        error: Bound of how far the arm's may be from that, shape (n,) [rad/s²].
        stop: This sample on it.
    """

    a: np.ndarray
    error: np.ndarray
    stop: Stop


class Answer(NamedTuple):
    """An acceleration that is chosen.

    Attributes:
        a: Shape (n,) [rad/s²].
        kind: As in `Report`.
        error: Bound of how far the arm's may be from it, shape (n,) [rad/s²].
        stop: What the next sample may fall back on.
    """

    a: np.ndarray
    kind: int
    error: np.ndarray
    stop: Stop


@jit
def filter_step(parts: Handle, at: Moment, torque: np.ndarray, left: Stop,
                elapsed: float) -> Report:
    """Answer a sample.

    Args:
        parts: Handle of the filter, see `FilterParts`.
        at: State, torque box and how long a torque is held.
        torque: Wanted, shape (n,) [N·m].
        left: The stop that the sample before has left; where there was none, the state.
        elapsed: How long ago that sample was, however long its torque might have been held [s].
    """
    filter_: FilterParts = parts.value
    at = borrowed(at)
    limits, n = filter_.limits, torque.size
    pairs = filter_.scene.value.pairs.shape[0]
    room = Room(np.empty(pairs), np.zeros(pairs), np.empty(pairs), np.empty((pairs, n)))
    posture = posture_of(filter_, at.q, at.qd)
    wanted = product(posture.compliance, torque - posture.bias)
    lower, upper = acceleration_bounds(at.q, at.qd, limits.lower, limits.upper, limits.speed,
                                       limits.braking, at.period)
    within = np.minimum(np.maximum(wanted, lower), upper)
    error = left_free(filter_, posture, at, within, room)
    evasion = evasion_of(filter_.scene.value, at.q, at.qd, wanted, filter_.lead)
    near, free = min(_smallest(room.now), evasion.clearance), _smallest(room.found)
    idle = (passes(wanted, lower, upper, error)
            and passes(torque, at.least, at.most, np.zeros(n)) and gives_way(evasion, wanted))
    left = stop_after(left, elapsed)
    braked = Braked(within, error, left)
    if pairs and (not idle or free < NEEDED):
        found = room.found.copy()
        braked = _braked(filter_, posture, at, left, room)
        within = braked.a  # it keeps the rows of obstacles: they are linearised there first
        idle = idle and _uses_its_part(found, room.before)
    if idle:
        reserve = reserve_of(posture, limits.braking, error, at.least, at.most)
        return Report(torque.copy(), IDLE, wanted, error, reserve, near, free,
                      Stop(at.q.copy(), at.qd.copy(), wanted))
    answer = _chosen(filter_, posture, at, wanted, lower, upper, error, within, braked, room,
                     evasion)
    return _commanded(posture, limits.braking, at, answer, room, near)


@jit
def _commanded(posture: Posture, braking: np.ndarray, at: Moment, answer: Answer,
               room: Room, near: float) -> Report:
    """Return the torque of an answer, within the box whatever the answer is."""
    given, kind, stop = product(posture.inertia, answer.a) + posture.bias, answer.kind, answer.stop
    if not np.isfinite(given).all():  # from what is not a number; then no torque but what must be
        given, kind, stop = np.zeros_like(given), SOFTENED, standing(at.q.copy())
    given = np.minimum(np.maximum(given, at.least), at.most)
    return Report(given, kind, answer.a, answer.error,
                  reserve_of(posture, braking, answer.error, at.least, at.most),
                  near, _smallest(room.found), stop)


@jit
def _chosen(parts: FilterParts, posture: Posture, at: Moment, wanted: np.ndarray,
            lower: np.ndarray, upper: np.ndarray, error: np.ndarray, a: np.ndarray,
            braked: Braked, room: Room, evasion: Evasion) -> Answer:
    """Return the acceleration nearest to the wanted one after which a stop is free.

    Args:
        parts: The filter.
        posture: Matrices of the model.
        at: State and torque box.
        wanted: a_w, shape (n,) [rad/s²].
        lower: a̲, shape (n,) [rad/s²].
        upper: a̅, shape (n,) [rad/s²].
        error: e of ``a``, shape (n,) [rad/s²].
        a: Where the rows of obstacles are linearised first, shape (n,) [rad/s²].
        braked: The stop that is left.
        room: At ``a``.
        evasion: What keeps away from what moves.
    """
    kind, certain, free, first = ACTIVE, False, False, a
    for k in range(ROUNDS):
        low, high = narrowed(lower, upper, error)
        a, kind = solved(posture, wanted, low, high, at.least, at.most, a, room, NEAREST,
                         evasion)
        if k == 0:
            first = a
        needed = left_free(parts, posture, at, a, room)
        growth = np.maximum(needed - error, 0.0)
        certain = not (growth > SLACK).any()
        # With twice the growth: what follows from the larger error is then within it.
        error = error + 2.0 * growth
        free = _may_go_on(room, at, parts.limits.braking)
        if certain and free:
            break
    if not certain:
        kind = SOFTENED
    # Where rows of several obstacles contradict each other the stop that is left keeps all. From
    # it on the first solution counts, where errors grow with it: the later ones are linearised
    # where no stop is free. Where nothing is uncertain they come nearer and nearer to what is.
    if room.found.size and (not free or kind == SOFTENED):
        towards = a if parts.exact else first
        return _backed_off(parts, posture, at, towards, braked, lower, upper, room)
    return Answer(a, kind, error, Stop(at.q.copy(), at.qd.copy(), a))


@jit
def _braked(parts: FilterParts, posture: Posture, at: Moment, stop: Stop, room: Room) -> Braked:
    """Return the stop that is left; what it leaves free is `Room.before`, and in ``room``."""
    hardest, period = parts.limits.braking, at.period
    onwards = np.minimum(np.maximum(-stop.velocity / period, -hardest), hardest)
    brake, error = stopped(parts, posture, at, onwards, stop, room)
    room.before[:] = room.found
    return Braked(brake, error, Stop(stop.position, stop.velocity, onwards))


@jit
def _smallest(values: np.ndarray) -> float:
    """Return the smallest value, inf of none."""
    least = np.inf
    for p in range(values.size):
        least = min(least, values[p])
    return least


@jit
def _may_go_on(room: Room, at: Moment, braking: np.ndarray) -> bool:
    """Return whether all of a stop is free.

    An arm that stands closer than that already may go where it does not come closer still.
    """
    stands, free = True, True
    for j in range(braking.size):
        stands = stands and abs(at.qd[j]) <= 2.0 * at.period * braking[j]
    for p in range(room.found.size):
        needed = min(room.before[p] - ROUNDING, 0.0) if stands else 0.0
        free = free and room.found[p] >= needed
    return free


@jit
def _backed_off(parts: FilterParts, posture: Posture, at: Moment, a: np.ndarray, braked: Braked,
                lower: np.ndarray, upper: np.ndarray, room: Room) -> Answer:
    """Return what is as far from the stop that is left towards ``a`` as leaves a stop free."""
    low, high = narrowed(lower, upper, braked.error)
    brake = np.minimum(np.maximum(braked.a, low), high)
    solution = ACTIVE
    if not passes(product(posture.inertia, brake) + posture.bias, at.least, at.most,
                  np.zeros(brake.size)):
        brake, solution = solved(posture, brake, brake - SLACK, brake + SLACK, at.least, at.most,
                                 brake, room, 0, no_evasion(brake.size))
    for part in PARTS:
        tried = brake + part * (a - brake)
        needed = left_free(parts, posture, at, tried, room)
        if (_may_go_on(room, at, parts.limits.braking)
                and passes(tried, lower, upper, needed)):
            return Answer(tried, solution, needed, Stop(at.q.copy(), at.qd.copy(), tried))
    clear(parts, at, brake, braked.error, room)
    return Answer(brake, BRAKING if solution == ACTIVE else SOFTENED, braked.error, braked.stop)


@jit
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
          before: np.ndarray, gradients: np.ndarray, nearest: int, evasion: Evasion,
          ) -> tuple[np.ndarray, np.ndarray]:
    """Return C and b of C a ≥ b: torque box, joints, obstacles nearest to a stop, evasion."""
    n, pairs = bias.size, min(nearest, found.size)
    used = 4 * n + pairs
    rows, bounds = np.zeros((used + evasion.bounds.size, n)), np.empty(used + evasion.bounds.size)
    rows[used:], bounds[used:] = evasion.rows, evasion.bounds
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
           nearest: int, evasion: Evasion) -> tuple[np.ndarray, int]:
    """Return the solution with all rows but evasion hard, else with the torque box alone.

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
        evasion: Rows that are soft in any case.
    """
    n, compliance = wanted.size, posture.compliance
    rows, bounds = _rows(posture.inertia, posture.bias, lower, upper, least, most, a, room.found,
                         room.before, room.gradients, nearest, evasion)
    softness, multipliers = np.zeros(bounds.size), np.empty(bounds.size)
    answer, hard = wanted, bounds.size - evasion.bounds.size
    for kind in (ACTIVE, SOFTENED):
        for r in range(hard if kind == ACTIVE else 2 * n, bounds.size):
            softness[r] = 0.0
            for i in range(n):
                for j in range(n):
                    softness[r] += SOFT * rows[r, i] * compliance[i, j] * rows[r, j]
        answer, steps = solve(compliance, wanted, rows, bounds, softness, multipliers)
        if steps >= 0 and kind == ACTIVE:
            return answer, ACTIVE
    return answer, SOFTENED
