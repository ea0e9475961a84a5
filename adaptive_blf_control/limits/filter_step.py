# SPDX-License-Identifier: Apache-2.0
"""One sample of the safety filter: the torque nearest to the wanted one that keeps the limits.

In the acceleration a of the model, M_c a + h_c = τ, and with e the bound of |a* − a|:

    min ½ (a − a_w)ᵀ M_c (a − a_w)   subject to
    a̲ + e ≤ a ≤ a̅ − e     velocity, and position that braking keeps inside (`viability`)
    b(a) ≥ (1 − γ) b(a_b)   what a stop leaves free of each obstacle (`stop_box`), linearised
    τ̲ ≤ M_c a + h_c ≤ τ̅    the torque box, always

What is wanted passes bit for bit where it keeps every row by itself. Where there is no such a, the
rows but for the torque box give way, as little as they have to (SOFTENED). Where the solution does
not leave every sphere free until all joints stand, all joints brake instead (BRAKING), which keeps
them in the box of postures that was free before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.chain import Chain
from adaptive_blf_control.arms.mass_and_bias import mass_and_bias
from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.limits.acceleration_error import (
    acceleration_error,
    inverse,
    Model,
    model_inverses,
    product,
)
from adaptive_blf_control.limits.link_spheres import LinkSpheres
from adaptive_blf_control.limits.obstacles import Obstacles
from adaptive_blf_control.limits.quadratic_program import solve
from adaptive_blf_control.limits.stop_box import clearances, stop_box
from adaptive_blf_control.limits.viability import acceleration_bounds

__all__ = ['ACTIVE', 'BRAKING', 'FilterArrays', 'filter_step', 'IDLE', 'JointLimits', 'Report',
           'Scene', 'SOFTENED']

IDLE, ACTIVE, BRAKING, SOFTENED = 0, 1, 2, 3
FIRST, LAW, LAST = -1, 0, 5
"""Stages: what braking leaves free, what the law does, solutions with the bound of the error of
the one before, and at last braking of all joints."""
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


class FilterArrays(NamedTuple):
    """A safety filter as compiled functions take it.

    Attributes:
        model: The arm with the set of its parameters.
        limits: Of the joints.
        scene: Spheres and obstacles.
        period: Longest time that a torque is held [s].
    """

    model: Model
    limits: JointLimits
    scene: Scene
    period: float


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


@jit
def filter_step(filter_: FilterArrays, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                least: np.ndarray, most: np.ndarray) -> Report:
    """Answer a sample.

    Args:
        filter_: The filter.
        q: Positions, shape (n,) [rad].
        qd: Velocities, shape (n,) [rad/s].
        torque: Wanted, shape (n,) [N·m].
        least: τ̲, shape (n,) [N·m].
        most: τ̅, shape (n,) [N·m].
    """
    f = borrowed(filter_)
    n, limits, period = q.size, f.limits, f.period
    inertia, bias = mass_and_bias(f.model.centre, q, qd)
    compliance, inverses = inverse(inertia), model_inverses(f.model, q)
    wanted, brake = np.empty(n), np.empty(n)
    for i in range(n):
        wanted[i] = torque[i] - bias[i]
        brake[i] = min(max(-qd[i] / period, -limits.braking[i]), limits.braking[i])
    wanted = product(compliance, wanted)
    lower, upper = acceleration_bounds(q, qd, limits.lower, limits.upper, limits.speed,
                                       limits.braking, period)
    shape = (f.scene.spheres.body.size, f.scene.obstacles.radius.size)
    found, before, now = np.empty(shape), np.zeros(shape), np.empty(shape)
    gradients = np.empty((*shape, n))
    a, held, error = brake, np.empty(n), np.zeros(n)
    kind, free, passed = IDLE, np.inf, False
    for stage in range(FIRST if found.size else LAW, LAST + 1):
        if stage == LAW:
            a = _within(wanted, lower, upper)
        elif stage > LAW:
            low, high = _joint_bounds(qd, brake, lower, upper, error, period, stage == LAST)
            rows, bounds = _rows(inertia, bias, low, high, least, most, a, found, before,
                                 gradients, 0 if stage == LAST else NEAREST)
            a, kind = _solved(compliance, wanted, rows, bounds)
        held = product(inertia, a)
        for i in range(n):
            held[i] += bias[i]
        needed = acceleration_error(f.model, inverses, q, qd, a, held, period)
        free = _clear(f, q, qd, a, needed, found, now, gradients)
        if stage == FIRST:
            before[:] = found
        elif stage == LAW:
            for i in range(n):
                error[i] = needed[i]
            passed = (_passes(wanted, lower, upper, error)
                      and _passes(torque, least, most, np.zeros(n))
                      and _uses_its_part(found, before))
            if passed:
                break
        elif stage == LAST:
            kind = SOFTENED if kind == SOFTENED else BRAKING
            break
        else:
            grown = False
            for i in range(n):
                grown = grown or needed[i] > error[i] + SLACK
                # With twice the growth: what follows from the larger error is then within it.
                error[i] += 2.0 * max(needed[i] - error[i], 0.0)
            if free >= 0.0 and (stage == LAST - 1 or not grown):
                kind = SOFTENED if grown else kind
                break
    reserve = _reserve(inertia, bias, limits.braking, error, most, least)
    clearance = np.inf
    for value in now.ravel():
        clearance = min(clearance, value)
    if passed:
        return Report(torque, IDLE, wanted, error, reserve, clearance, free)
    return Report(_within(held, least, most), kind, a, error, reserve, clearance, free)


@jit
def _within(values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    result = np.empty_like(values)
    for i in range(values.size):
        result[i] = min(max(values[i], low[i]), high[i])
    return result


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
def _clear(f: FilterArrays, q: np.ndarray, qd: np.ndarray, a: np.ndarray, error: np.ndarray,
           found: np.ndarray, now: np.ndarray, gradients: np.ndarray) -> float:
    """Write what a stop after a leaves free, and its change with a; return the least [m]."""
    least = np.inf
    if found.size == 0:
        return least
    braking = f.limits.braking
    low, high, slope = stop_box(qd, a, error, braking, f.period)
    standstill = f.period
    for i in range(qd.size):
        standstill = max(standstill, f.period + (abs(qd[i]) + f.period * (abs(a[i]) + error[i]))
                         / braking[i])
    clearances(f.scene.chain, f.scene.spheres, f.scene.obstacles, q, low, high, standstill,
               found, now, gradients)
    for s in range(found.shape[0]):
        for k in range(found.shape[1]):
            least = min(least, found[s, k])
            for j in range(qd.size):
                gradients[s, k, j] *= slope[j]
    return least


@jit
def _reserve(inertia: np.ndarray, bias: np.ndarray, braking: np.ndarray, error: np.ndarray,
             most: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Return min(τ̅ − h, h − τ̲) − |M| (a_b + e), shape (n,) [N·m]."""
    result = np.empty_like(bias)
    for i in range(bias.size):
        result[i] = min(most[i] - bias[i], bias[i] - least[i])
        for j in range(bias.size):
            result[i] -= abs(inertia[i, j]) * (braking[j] + error[j])
    return result


@jit
def _joint_bounds(qd: np.ndarray, brake: np.ndarray, lower: np.ndarray, upper: np.ndarray,
                  error: np.ndarray, period: float, braking: bool,
                  ) -> tuple[np.ndarray, np.ndarray]:
    """Return the bounds of a: those of the joints, or those within which every joint brakes."""
    low, high = np.empty_like(qd), np.empty_like(qd)
    for i in range(qd.size):
        if not braking:
            low[i], high[i] = lower[i] + error[i], upper[i] - error[i]
        elif qd[i] > 0.0:
            low[i], high[i] = -qd[i] / period + error[i], brake[i] - error[i]
        else:
            low[i], high[i] = brake[i] + error[i], -qd[i] / period - error[i]
        if braking and qd[i] > 0.0:  # that it brakes is what counts
            low[i] = min(low[i], high[i])
        elif braking:
            high[i] = max(low[i], high[i])
        elif low[i] > high[i]:
            low[i] = high[i] = 0.5 * (low[i] + high[i])
    return low, high


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
def _solved(compliance: np.ndarray, wanted: np.ndarray, rows: np.ndarray,
            bounds: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the solution with all rows hard, else with the torque box hard and the rest soft."""
    n = wanted.size
    softness, multipliers = np.zeros(bounds.size), np.empty(bounds.size)
    a = wanted
    for kind in (ACTIVE, SOFTENED):
        a, steps = solve(compliance, wanted, rows, bounds, softness, multipliers)
        if steps >= 0 and kind == ACTIVE:
            return a, ACTIVE
        for r in range(2 * n, bounds.size):
            softness[r] = 0.0
            for i in range(n):
                for j in range(n):
                    softness[r] += SOFT * rows[r, i] * compliance[i, j] * rows[r, j]
    return a, SOFTENED
