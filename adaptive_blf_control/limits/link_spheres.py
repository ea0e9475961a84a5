# SPDX-License-Identifier: Apache-2.0
"""Spheres that cover the links of a chain: where they are, and how they move with the joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.chain import Chain, placements
from adaptive_blf_control.arms.spatial import cross, motion_product
from adaptive_blf_control.compiled import jit

__all__ = ['LinkSpheres', 'place_sphere', 'sphere_centres', 'sphere_motion']


class LinkSpheres(NamedTuple):
    """Spheres fixed to the bodies of a chain.

    Attributes:
        body: Row of the body in the chain's order, 0 for the base, shape (k,).
        centre: In the body's frame, shape (k, 3) [m].
        radius: Shape (k,) [m].
    """

    body: np.ndarray
    centre: np.ndarray
    radius: np.ndarray


@jit
def sphere_centres(chain: Chain, spheres: LinkSpheres, q: np.ndarray) -> np.ndarray:
    """Return the centres in the base's frame, shape (k, 3) [m]."""
    frames, _ = placements(chain, q)
    centres = np.empty((spheres.body.size, 3))
    for s in range(spheres.body.size):
        place_sphere(centres[s], frames[spheres.body[s]], spheres.centre[s])
    return centres


@jit
def sphere_motion(chain: Chain, spheres: LinkSpheres, q: np.ndarray, qd: np.ndarray,
                  ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return how the centres move: p, J, v = J q̇ and the part J̇ q̇ of v̇ = J q̈ + J̇ q̇.

    Args:
        chain: The chain.
        spheres: The spheres, k of them.
        q: Joint positions in the user's order, shape (n,) [rad or m].
        qd: Joint velocities, shape (n,) [rad/s or m/s].

    Returns:
        p (k, 3) [m]; J (k, 3, n) in the user's order; v (k, 3) [m/s]; J̇ q̇ (k, 3) [m/s²].
    """
    n, count = chain.parent.size, spheres.body.size
    frames, axes = placements(chain, q)
    twists, rates = np.zeros((n + 1, 6)), np.zeros((n + 1, 6))
    for i in range(n):
        parent, speed = chain.parent[i], qd[chain.place[i]]
        for r in range(6):
            twists[i + 1, r] = twists[parent, r] + axes[i, r] * speed
            rates[i + 1, r] = rates[parent, r]
        motion_product(rates[i + 1], twists[i + 1], axes[i], speed)
    centres, jacobians = np.empty((count, 3)), np.zeros((count, 3, n))
    velocities, drifts = np.empty((count, 3)), np.empty((count, 3))
    for s in range(count):
        body = spheres.body[s]
        place_sphere(centres[s], frames[body], spheres.centre[s])
        _at_point(velocities[s], twists[body], centres[s])
        _at_point(drifts[s], rates[body], centres[s])
        turning = cross((twists[body, 3], twists[body, 4], twists[body, 5]),
                        (velocities[s, 0], velocities[s, 1], velocities[s, 2]))
        column = np.empty(3)
        for r in range(3):
            drifts[s, r] += turning[r]
        while body > 0:
            _at_point(column, axes[body - 1], centres[s])
            for r in range(3):
                jacobians[s, r, chain.place[body - 1]] = column[r]
            body = chain.parent[body - 1]
    return centres, jacobians, velocities, drifts


@jit
def place_sphere(out: np.ndarray, frame: np.ndarray, local: np.ndarray) -> None:
    """Write where a point of a body is, (3,) [m]; ``frame`` is the body's [R p], shape (3, 4)."""
    for r in range(3):
        out[r] = (frame[r, 0] * local[0] + frame[r, 1] * local[1] + frame[r, 2] * local[2]
                  + frame[r, 3])


@jit
def _at_point(out: np.ndarray, twist: np.ndarray, point: np.ndarray) -> None:
    """Write v + ω × p, the linear part of a twist at a point."""
    moved = cross((twist[3], twist[4], twist[5]), (point[0], point[1], point[2]))
    for r in range(3):
        out[r] = twist[r] + moved[r]
