# SPDX-License-Identifier: Apache-2.0
"""How an arm keeps away from obstacles that move, and gives way to those that come.

A stop is no way out of the path of what moves: an arm that stands is run over. With h the distance
of a sphere of a link from an obstacle that moves with its velocity v_o, u the direction away from
it, and p that sphere's centre,

    ḣ = uᵀ(J q̇ − v_o),    ḧ ≥ uᵀ(J a + J̇ q̇)     (an obstacle is convex, and v_o constant),

so that ḧ + 2 α ḣ + α² h ≥ 0 keeps h ≥ 0 from any h ≥ 0 with ḣ + α h ≥ 0 on (an exponential
barrier: Nguyen and Sreenath, American Control Conference 2016). h is taken 5 mm smaller than it
is. Where it comes, T uᵀv_o is taken off h, so that the arm still has the time T to stop in before
the obstacle is where it was. What stands begins to give way to what comes at the speed v as far
off as (T + 2 / α) v, and with accelerations of no more than α v.

These are rows of the acceleration a, to be kept together with those of joints and of stops before
what stands: an arm between the two gives way along what stands. The reference takes a T that the
filter does not, so that an arm that follows it is let through.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.limits.filter_look import Scene
from adaptive_blf_control.limits.link_spheres import sphere_motion
from adaptive_blf_control.limits.obstacles import distance

__all__ = ['Evasion', 'evasion_of', 'gives_way', 'no_evasion']

QUICKNESS = 5.0  # α [1/s]
KEPT = 0.005  # of h, for what is uncertain: the arm, and how obstacles move [m]
SHORTEST = 1e-6  # of uᵀ J, below which a link cannot give way [m/rad]
MOST = 8  # rows: the nearest to be broken


class Evasion(NamedTuple):
    """Rows c a ≥ b of an acceleration that keeps away from what moves.

    Attributes:
        rows: c, of length 1 each, shape (r, n).
        bounds: b, shape (r,) [rad/s²].
        clearance: Smallest distance of a sphere from what moves now [m]; inf without.
    """

    rows: np.ndarray
    bounds: np.ndarray
    clearance: float


@jit
def no_evasion(n: int) -> Evasion:
    """Return no rows, for n joints."""
    return Evasion(np.empty((0, n)), np.empty(0), np.inf)


@jit
def evasion_of(scene: Scene, q: np.ndarray, qd: np.ndarray, wanted: np.ndarray,
               lead: float) -> Evasion:
    """Return the rows that are the nearest to be broken.

    Args:
        scene: Spheres and obstacles.
        q: Positions, shape (n,) [rad].
        qd: Velocities, shape (n,) [rad/s].
        wanted: Acceleration for which that is asked, shape (n,) [rad/s²].
        lead: T [s].
    """
    n, count = q.size, scene.coming.shape[0]
    if count == 0:
        return no_evasion(n)
    spheres, obstacles = scene.spheres, scene.obstacles
    centres, jacobians, velocities, drifts = sphere_motion(scene.chain, spheres, q, qd)
    rows, bounds, slacks = np.zeros((count, n)), np.empty(count), np.empty(count)
    normal, used, nearest = np.empty(3), 0, np.inf
    for p in range(count):
        s, k = scene.coming[p, 0], scene.coming[p, 1]
        h = distance(obstacles, k, centres[s], normal) - spheres.radius[s]
        nearest = min(nearest, h)
        coming, rate, drift = 0.0, 0.0, 0.0
        for r in range(3):
            coming += normal[r] * obstacles.velocity[k, r]
            rate += normal[r] * (velocities[s, r] - obstacles.velocity[k, r])
            drift += normal[r] * drifts[s, r]
        square, given = 0.0, 0.0
        for j in range(n):
            value = 0.0
            for r in range(3):
                value += normal[r] * jacobians[s, r, j]
            rows[used, j] = value
            square += value * value
            given += value * wanted[j]
        if square <= SHORTEST * SHORTEST:
            continue
        scale = 1.0 / np.sqrt(square)
        free = h - KEPT - lead * max(coming, 0.0)
        bound = -drift - QUICKNESS * (2.0 * rate + QUICKNESS * free)
        for j in range(n):
            rows[used, j] *= scale
        bounds[used], slacks[used] = bound * scale, (given - bound) * scale
        used += 1
    if used > MOST:
        first = np.argsort(slacks[:used])[:MOST]
        return Evasion(rows[first], bounds[first], nearest)
    return Evasion(rows[:used].copy(), bounds[:used].copy(), nearest)


@jit
def gives_way(evasion: Evasion, a: np.ndarray) -> bool:
    """Return whether an acceleration keeps every row, shape (n,) [rad/s²]."""
    keeps = True
    for r in range(evasion.bounds.size):
        value = -evasion.bounds[r]
        for j in range(a.size):
            value += evasion.rows[r, j] * a[j]
        keeps = keeps and value >= 0.0
    return keeps
