# SPDX-License-Identifier: Apache-2.0
"""Mass matrix and forward dynamics of an open kinematic chain with one set of inertias.

Composite rigid bodies for M, recursive Newton-Euler for C q̇ + G, and a factorisation of M:
Featherstone, Rigid Body Dynamics Algorithms (2008), chapters 5 and 6.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.chain import Chain, write_placements
from adaptive_blf_control.arms.integrator import acceleration
from adaptive_blf_control.arms.spatial import (
    dot6,
    momentum,
    motion_product,
    world_inertia,
    wrench_product,
)
from adaptive_blf_control.compiled import borrowed, jit, local_zeros

__all__ = ['chain_acceleration', 'chain_mass', 'chain_mass_and_bias', 'ChainInertias']


class ChainInertias(NamedTuple):
    """A chain with the inertias and the friction to simulate.

    Attributes:
        chain: The kinematics.
        inertia: Pseudo-inertia of each body in its joint's frame, shape (n, 4, 4).
        friction: Viscous [N·m·s/rad], Coulomb [N·m], constant [N·m] and square-root
            [N·m·(s/rad)^½] coefficients in rows, in the user's order, shape (4, n).
        coulomb_velocity: v_s of tanh(q̇/v_s) [rad/s].
        rotor: Inertia of each joint's rotor, seen from the joint, in the user's order, shape
            (n,) [kg·m²].
    """

    chain: Chain
    inertia: np.ndarray
    friction: np.ndarray
    coulomb_velocity: float
    rotor: np.ndarray


@jit
def chain_acceleration(arm: ChainInertias, q: np.ndarray, qd: np.ndarray,
                       tau: np.ndarray) -> np.ndarray:
    """q̈ = M⁻¹(τ − C q̇ − G − F q̇ − (f_c + f_s √|q̇|) tanh(q̇/v_s) − f_0), (n,) [rad/s²].

    Args:
        arm: The chain and its inertias.
        q: Joint positions in the user's order, shape (n,) [rad or m].
        qd: Joint velocities, shape (n,) [rad/s or m/s].
        tau: Joint torques, shape (n,) [N·m or N].
    """
    arm = borrowed(arm)
    chain = arm.chain
    n = chain.parent.size
    frames, axes, bodies = local_zeros((n + 1, 3, 4)), local_zeros((n, 6)), local_zeros(
        (n + 1, 4, 4))
    mass, drive = local_zeros((n, n)), local_zeros(n)
    write_placements(chain, q, frames, axes)
    _write_bodies(bodies, arm, frames)
    _write_drive(drive, arm, qd, tau)
    _take_away_bias(drive, chain, axes, bodies, qd)
    _write_composite_mass(mass, arm, axes, bodies)
    _solve(mass, drive)
    qdd = np.empty(n)
    for i in range(n):
        qdd[chain.place[i]] = drive[i]
    return qdd


acceleration.register(ChainInertias, chain_acceleration)


@jit
def chain_mass(arm: ChainInertias, q: np.ndarray) -> np.ndarray:
    """M(q) in the user's order, shape (n, n) [kg·m², kg·m, kg]."""
    arm = borrowed(arm)
    chain = arm.chain
    n = chain.parent.size
    frames, axes, bodies = local_zeros((n + 1, 3, 4)), local_zeros((n, 6)), local_zeros(
        (n + 1, 4, 4))
    lower, mass = local_zeros((n, n)), np.empty((n, n))
    write_placements(chain, q, frames, axes)
    _write_bodies(bodies, arm, frames)
    _write_composite_mass(lower, arm, axes, bodies)
    for i in range(n):
        for j in range(i + 1):
            a, b = chain.place[i], chain.place[j]
            mass[a, b] = mass[b, a] = lower[i, j]
    return mass


@jit
def _write_bodies(bodies: np.ndarray, arm: ChainInertias, frames: np.ndarray) -> None:
    """Pseudo-inertias in world axes about the world's origin, row 0 empty, (n + 1, 4, 4)."""
    arm = borrowed(arm)
    for i in range(arm.inertia.shape[0]):
        world_inertia(bodies[i + 1], frames[i + 1], arm.inertia[i])


@jit
def _write_drive(drive: np.ndarray, arm: ChainInertias, qd: np.ndarray,
                 tau: np.ndarray) -> None:
    """Torque less friction, in the chain's order, shape (n,)."""
    arm = borrowed(arm)
    for i in range(qd.size):
        j = arm.chain.place[i]
        drive[i] = tau[j] - arm.friction[0, j] * qd[j] - arm.friction[2, j]
        if arm.friction[1, j] != 0.0 or arm.friction[3, j] != 0.0:
            dry = arm.friction[1, j] + arm.friction[3, j] * math.sqrt(abs(qd[j]))
            drive[i] -= dry * math.tanh(qd[j] / arm.coulomb_velocity)


@jit
def _take_away_bias(drive: np.ndarray, chain: Chain, axes: np.ndarray, bodies: np.ndarray,
                    qd: np.ndarray) -> None:
    """Subtract C q̇ + G: Newton-Euler with q̈ = 0, f_i = I A_i + V_i ×* I V_i."""
    chain = borrowed(chain)
    n = chain.parent.size
    twists, rates = local_zeros((n + 1, 6)), local_zeros((n + 1, 6))
    wrenches, own = local_zeros((n + 1, 6)), local_zeros(6)
    for r in range(3):
        rates[0, r] = -chain.gravity[r]
    for i in range(n):
        parent, body, speed = chain.parent[i], i + 1, qd[chain.place[i]]
        for r in range(6):
            twists[body, r] = twists[parent, r] + axes[i, r] * speed
            rates[body, r] = rates[parent, r]
        motion_product(rates[body], twists[body], axes[i], speed)
        momentum(own, bodies[body], twists[body])
        momentum(wrenches[body], bodies[body], rates[body])
        wrench_product(wrenches[body], twists[body], own)
    for i in range(n - 1, -1, -1):
        drive[i] -= dot6(axes[i], wrenches[i + 1])
        for r in range(6):
            wrenches[chain.parent[i], r] += wrenches[i + 1, r]


@jit
def _write_composite_mass(mass: np.ndarray, arm: ChainInertias, axes: np.ndarray,
                          bodies: np.ndarray) -> None:
    """M in the chain's order, its lower triangle, into zeros of shape (n, n).

    M_ij = J_jᵀ I_i J_i for a joint j that carries joint i, I_i the inertia of all that joint i
    moves; ``bodies`` is summed up to these. Rotors add to the diagonal.
    """
    arm = borrowed(arm)
    chain = arm.chain
    own = local_zeros(6)
    for i in range(chain.parent.size - 1, -1, -1):
        body = i + 1
        momentum(own, bodies[body], axes[i])
        while body > 0:
            mass[i, body - 1] = dot6(axes[body - 1], own)
            body = chain.parent[body - 1]
        mass[i, i] += arm.rotor[chain.place[i]]
        carried = bodies[chain.parent[i]]
        for r in range(4):
            for c in range(4):
                carried[r, c] += bodies[i + 1, r, c]


@jit
def _solve(mass: np.ndarray, b: np.ndarray) -> None:
    """Solve M x = b in place by M = L D Lᵀ; only the lower triangle of M is read.

    Unlike Cholesky's L Lᵀ it needs no square root, so a matrix that is not quite positive
    definite in some posture causes no error.
    """
    n = b.size
    for i in range(n):
        for j in range(i):
            for k in range(j):
                mass[i, j] -= mass[i, k] * mass[j, k]
        # Up to here row i holds L D.
        for j in range(i):
            scaled = mass[i, j] / mass[j, j]
            mass[i, i] -= mass[i, j] * scaled
            mass[i, j] = scaled
            b[i] -= scaled * b[j]
    for i in range(n - 1, -1, -1):
        b[i] /= mass[i, i]
        for k in range(i + 1, n):
            b[i] -= mass[k, i] * b[k]


@jit
def chain_mass_and_bias(arm: ChainInertias, q: np.ndarray,
                        qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """M(q) and h with M q̈ + h = τ, friction included, in the user's order, (n, n) and (n,).

    Args:
        arm: The chain and its inertias.
        q: Joint positions in the user's order, shape (n,) [rad or m].
        qd: Joint velocities, shape (n,) [rad/s or m/s].
    """
    chain = arm.chain
    n = chain.parent.size
    frames, axes, bodies = local_zeros((n + 1, 3, 4)), local_zeros((n, 6)), local_zeros(
        (n + 1, 4, 4))
    lower, negative = local_zeros((n, n)), local_zeros(n)
    write_placements(chain, q, frames, axes)
    _write_bodies(bodies, arm, frames)
    _write_drive(negative, arm, qd, local_zeros(n))
    _take_away_bias(negative, chain, axes, bodies, qd)
    _write_composite_mass(lower, arm, axes, bodies)
    mass, bias = np.empty((n, n)), np.empty(n)
    for i in range(n):
        a = chain.place[i]
        bias[a] = -negative[i]
        for j in range(i + 1):
            b = chain.place[j]
            mass[a, b] = mass[b, a] = lower[i, j]
    return mass, bias
