# SPDX-License-Identifier: Apache-2.0
"""How the reference keeps away from obstacles that move, and gives way to those that come.

A stop is no way out of the path of what moves: an arm that stands is run over. With h the distance
of a sphere of a link from an obstacle that moves with its velocity v_o, u the direction away from
it, and p that sphere's centre,

    ḣ = uᵀ(J ẏ − v_o),    ḧ ≥ uᵀ(J ÿ + J̇ ẏ)     (an obstacle is convex, and v_o constant),

so that ḧ + 2 α ḣ + α² h ≥ 0 keeps h ≥ 0 from any h ≥ 0 with ḣ + α h ≥ 0 on (an exponential
barrier: Nguyen and Sreenath, American Control Conference 2016). Where it comes, T uᵀv_o is taken
off h, so that the arm still has the time T to stop in before the obstacle is where it was. What
stands begins to give way to what comes at the speed v as far off as (T + 2 / α) v, and with
accelerations of no more than α v.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import Handle, jit
from adaptive_blf_control.limits.filter_look import Scene
from adaptive_blf_control.limits.link_spheres import sphere_motion
from adaptive_blf_control.limits.obstacles import distance
from adaptive_blf_control.limits.quadratic_program import solve

__all__ = ['evading', 'without_moving']

QUICKNESS = 5.0  # α [1/s]
TO_STOP = 0.4  # T [s]
SOFT = 1e-6  # softness of a row: several at once may contradict each other
SHORTEST = 1e-6  # of uᵀ J, below which a link cannot give way [m/rad]


def without_moving(scene: Scene) -> Scene:
    """Return the scene with the pairs of what stands and of spheres with each other alone."""
    moving = np.flatnonzero(scene.obstacles.velocity.any(axis=1))
    return scene._replace(pairs=scene.pairs[~np.isin(scene.pairs[:, 1], moving)])


@jit
def evading(scene: Handle, y: np.ndarray, yd: np.ndarray, wanted: np.ndarray, least: np.ndarray,
            most: np.ndarray) -> np.ndarray:
    """Return the acceleration nearest to the wanted one that keeps away from what moves.

    Of shape (n,); the wanted one itself where that does so already, or where nothing moves.

    Args:
        scene: Handle of spheres and obstacles, see `Scene`.
        y: Positions, shape (n,) [rad].
        yd: Velocities, shape (n,) [rad/s].
        wanted: Acceleration, shape (n,) [rad/s²].
        least: Smallest acceleration, shape (n,) [rad/s²].
        most: Largest acceleration, shape (n,) [rad/s²].
    """
    parts: Scene = scene.value
    n = y.size
    spheres, obstacles = parts.spheres, parts.obstacles
    centres, jacobians, velocities, drifts = sphere_motion(parts.chain, spheres, y, yd)
    count = parts.pairs.shape[0]
    rows, bounds = np.zeros((2 * n + count, n)), np.empty(2 * n + count)
    normal, used, kept = np.empty(3), 2 * n, True
    for p in range(count):
        s, k = parts.pairs[p, 0], parts.pairs[p, 1]
        if k < 0 or not obstacles.velocity[k].any():
            continue
        h = distance(obstacles, k, centres[s], normal) - spheres.radius[s]
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
        bound = -drift - QUICKNESS * (2.0 * rate + QUICKNESS * (h - TO_STOP * max(coming, 0.0)))
        kept = kept and given >= bound
        scale = 1.0 / np.sqrt(square)
        for j in range(n):
            rows[used, j] *= scale
        bounds[used] = bound * scale
        used += 1
    if kept:
        return wanted
    softness, unit = np.zeros(used), np.zeros((n, n))
    softness[2 * n:] = SOFT
    for j in range(n):
        unit[j, j] = rows[j, j] = 1.0
        rows[n + j, j] = -1.0
        bounds[j], bounds[n + j] = least[j], -most[j]
    answer, _ = solve(unit, wanted, rows[:used], bounds[:used], softness, np.empty(used))
    return np.minimum(np.maximum(answer, least), most)
