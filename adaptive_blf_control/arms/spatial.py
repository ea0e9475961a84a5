# SPDX-License-Identifier: Apache-2.0
"""Spatial algebra of rigid bodies, in world axes about the origin of the world.

A twist (v, ω) holds the velocity of the body's point that is at the world's origin [m/s] and the
angular velocity [rad/s]; a wrench (f, n) the force [N] and the moment about the world's origin
[N·m]. Both are six numbers, the linear part first. Formulas: R. Featherstone, Rigid Body Dynamics
Algorithms (2008), chapter 2.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.compiled import jit

__all__ = ['cross', 'dot6', 'momentum', 'motion_product', 'world_inertia', 'wrench_product']

Vector = tuple[float, float, float]


@jit
def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@jit
def dot6(a: np.ndarray, b: np.ndarray) -> float:
    """Power of a wrench on a twist, shapes (6,)."""
    return (a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5])


@jit
def motion_product(out: np.ndarray, a: np.ndarray, b: np.ndarray, factor: float) -> None:
    """Add ``factor`` times the rate of twist b in a body that moves with twist a: a × b (2.31).

    Args:
        out: Array that is added to, shape (6,).
        a: Twist (v, ω), shape (6,).
        b: Twist, shape (6,).
        factor: Scalar.
    """
    v, w = (a[0], a[1], a[2]), (a[3], a[4], a[5])
    linear, angular = (b[0], b[1], b[2]), (b[3], b[4], b[5])
    turned, carried, turning = cross(w, linear), cross(v, angular), cross(w, angular)
    for r in range(3):
        out[r] += factor * (turned[r] + carried[r])
        out[3 + r] += factor * turning[r]


@jit
def wrench_product(out: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
    """Add the rate of wrench b in a body that moves with twist a: a ×* b (2.32).

    Args:
        out: Array that is added to, shape (6,).
        a: Twist (v, ω), shape (6,).
        b: Wrench (f, n), shape (6,).
    """
    v, w = (a[0], a[1], a[2]), (a[3], a[4], a[5])
    force, moment = (b[0], b[1], b[2]), (b[3], b[4], b[5])
    turned, carried, turning = cross(w, moment), cross(v, force), cross(w, force)
    for r in range(3):
        out[r] += turning[r]
        out[3 + r] += turned[r] + carried[r]


@jit
def world_inertia(out: np.ndarray, placement: np.ndarray, body: np.ndarray) -> None:
    """Pseudo-inertia of a body in world axes about the world's origin, T J Tᵀ.

    Pseudo-inertias [Σ h; hᵀ m], with Σ the second and h the first moment of mass, add up and
    transform like this whatever their definiteness: Wensing, Kim, Slotine, Linear Matrix
    Inequalities for Physically Consistent Inertial Parameter Identification (2018), (12).

    Args:
        out: Array that is written, shape (4, 4).
        placement: [R p] of the body's frame, shape (3, 4).
        body: J in the body's frame, shape (4, 4).
    """
    out[3, 3] = body[3, 3]
    for r in range(3):
        a, b, c, d = placement[r, 0], placement[r, 1], placement[r, 2], placement[r, 3]
        row = (a * body[0, 0] + b * body[1, 0] + c * body[2, 0] + d * body[3, 0],
               a * body[0, 1] + b * body[1, 1] + c * body[2, 1] + d * body[3, 1],
               a * body[0, 2] + b * body[1, 2] + c * body[2, 2] + d * body[3, 2],
               a * body[0, 3] + b * body[1, 3] + c * body[2, 3] + d * body[3, 3])
        for s in range(3):
            out[r, s] = (row[0] * placement[s, 0] + row[1] * placement[s, 1]
                         + row[2] * placement[s, 2] + row[3] * placement[s, 3])
        out[r, 3] = out[3, r] = row[3]


@jit
def momentum(out: np.ndarray, inertia: np.ndarray, twist: np.ndarray) -> None:
    """Momentum of a body with a twist: (m v + ω × h, h × v + (tr Σ) ω − Σ ω).

    Args:
        out: Wrench that is written, shape (6,).
        inertia: Pseudo-inertia in world axes about the world's origin, shape (4, 4).
        twist: (v, ω), shape (6,).
    """
    v, w = (twist[0], twist[1], twist[2]), (twist[3], twist[4], twist[5])
    h = (inertia[0, 3], inertia[1, 3], inertia[2, 3])
    turning, carried = cross(w, h), cross(h, v)
    trace = inertia[0, 0] + inertia[1, 1] + inertia[2, 2]
    for r in range(3):
        out[r] = inertia[3, 3] * v[r] + turning[r]
        out[3 + r] = carried[r] + trace * w[r] - (
            inertia[r, 0] * w[0] + inertia[r, 1] * w[1] + inertia[r, 2] * w[2])
