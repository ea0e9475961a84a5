# SPDX-License-Identifier: Apache-2.0
"""Regressors of an open kinematic chain in base parameters, rotor inertias and friction.

With J_i the axis of joint i as a twist and w_j the wrench that moves body j as a regressor, row i
of every regressor is the sum of J_iᵀ w_j over the bodies j that joint i moves. All is in world
axes about the world's origin, so that w_j serves every joint.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.chain import Chain, subtree_ends, write_placements
from adaptive_blf_control.arms.joint_friction import JointFriction
from adaptive_blf_control.arms.regressors import law_regressor, regressors
from adaptive_blf_control.arms.spatial import cross, motion_product
from adaptive_blf_control.compiled import borrowed, jit, local_zeros

__all__ = ['chain_parameters', 'chain_X', 'chain_Y12', 'ChainParameters']


class ChainParameters(NamedTuple):
    """A chain, and the parameters that are the columns of its regressors.

    Attributes:
        chain: The kinematics.
        kind: Which of its body's ten inertial parameters each base column is, shape (b,); the
            columns of a body follow each other, bodies in the chain's order.
        first: First base column of each body and b, shape (n + 1,).
        end: First column after those of the bodies that each joint moves, shape (n,).
        rotor: Column of each joint's rotor inertia in the user's order, −1 without it, (n,).
        friction: First column of viscous, Coulomb, constant and square-root friction, −1 without
            it, shape (4,).
        coulomb_velocity: v_s of tanh(q̇/v_s) [rad/s].
        width: Number of columns m.
    """

    chain: Chain
    kind: np.ndarray
    first: np.ndarray
    end: np.ndarray
    rotor: np.ndarray
    friction: np.ndarray
    coulomb_velocity: float
    width: int


def chain_parameters(chain: Chain, base: np.ndarray, friction: JointFriction) -> ChainParameters:
    """Choose the columns: base parameters with the rotors' first, then friction.

    Args:
        chain: The kinematics.
        base: Columns that are kept of the ten inertial parameters per body and the rotor inertias
            behind them, ascending, bodies and joints in the chain's order, shape (b,).
        friction: Kinds of friction.
    """
    n = chain.parent.size
    inertial = base[base < PER_BODY * n]
    body, kind = np.divmod(inertial, PER_BODY)
    first = np.searchsorted(body, np.arange(n + 1))
    rotor = np.full(n, -1)
    rotor[chain.place[base[inertial.size:] - PER_BODY * n]] = np.arange(inertial.size, base.size)
    return ChainParameters(chain, kind, first, first[subtree_ends(chain.parent)], rotor,
                           friction.first_columns(base.size), friction.coulomb_velocity,
                           base.size + len(friction.names))


@jit
def chain_Y12(arm: ChainParameters, q: np.ndarray,
              qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Y1 θ = M q̇ and Y2 θ = −Ṁ q̇ + C q̇ + G + F q̇ (12), shapes (n, m).

    Ṁ = C + Cᵀ for the Christoffel matrix, and (Cᵀ q̇)_i = ½ q̇ᵀ (∂M/∂q_i) q̇ = ∂T/∂q_i with T the
    kinetic energy. The momentum h_j of body j gives (M q̇)_i = J_iᵀ Σ h_j and, as J_i moves with
    joint i, ∂T/∂q_i = J̇_iᵀ Σ h_j with J̇_i = V_i × J_i: exact, no differences.

    Args:
        arm: The chain and its parameters.
        q: Joint positions in the user's order, shape (n,) [rad or m].
        qd: Joint velocities, shape (n,) [rad/s or m/s].
    """
    arm = borrowed(arm)
    chain = arm.chain
    n = chain.parent.size
    frames, axes = local_zeros((n + 1, 3, 4)), local_zeros((n, 6))
    twists, rates, lift = local_zeros((n + 1, 6)), local_zeros((n, 6)), local_zeros(6)
    momenta, weights = local_zeros((6, arm.kind.size)), local_zeros((6, arm.kind.size))
    block = local_zeros((6, PER_BODY))
    write_placements(chain, q, frames, axes)
    for r in range(3):
        lift[r] = -chain.gravity[r]
    for i in range(n):
        _add_joint(twists, chain.parent[i], i, axes, qd[chain.place[i]])
        motion_product(rates[i], twists[i + 1], axes[i], -1.0)
        _momentum_columns(block, frames[i + 1], twists[i + 1])
        _keep(momenta, arm, i, block)
        _momentum_columns(block, frames[i + 1], lift)
        _keep(weights, arm, i, block)
    y1, y2 = np.zeros((n, arm.width)), np.zeros((n, arm.width))
    _project(y1, arm, axes, momenta)
    _project(y2, arm, axes, weights)
    _project(y2, arm, rates, momenta)
    _rotor_columns(y1, arm, qd)
    _friction_columns(y2, arm, qd)
    return y1, y2


@jit
def chain_X(arm: ChainParameters, q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
            alpha_dot: np.ndarray) -> np.ndarray:
    """X θ = M α̇ + C α + G + F q̇ with the Christoffel matrix C, shape (n, m).

    C(q, q̇) α is the symmetric bilinear form whose value at α = q̇ is C q̇ (Slotine and Li, On the
    Adaptive Control of Robot Manipulators, 1987). So every product of two velocities in the
    Newton-Euler equations, A_i = A_p + J_i q̈_i + V_i × J_i q̇_i and w_i = I A_i + V_i ×* I V_i,
    is halved between the twists V of q̇ and U of α.

    Args:
        arm: The chain and its parameters.
        q: Joint positions in the user's order, shape (n,) [rad or m].
        qd: Joint velocities, shape (n,) [rad/s or m/s].
        alpha: Shape (n,) [rad/s or m/s].
        alpha_dot: Shape (n,) [rad/s² or m/s²].
    """
    arm = borrowed(arm)
    chain = arm.chain
    n = chain.parent.size
    frames, axes = local_zeros((n + 1, 3, 4)), local_zeros((n, 6))
    twists, wanted = local_zeros((n + 1, 6)), local_zeros((n + 1, 6))
    rates, wrenches = local_zeros((n + 1, 6)), local_zeros((6, arm.kind.size))
    block, other = local_zeros((6, PER_BODY)), local_zeros((6, PER_BODY))
    write_placements(chain, q, frames, axes)
    for r in range(3):
        rates[0, r] = -chain.gravity[r]
    for i in range(n):
        parent, place, body = chain.parent[i], chain.place[i], i + 1
        _add_joint(twists, parent, i, axes, qd[place])
        _add_joint(wanted, parent, i, axes, alpha[place])
        _add_joint(rates, parent, i, axes, alpha_dot[place])
        motion_product(rates[body], twists[body], axes[i], 0.5 * alpha[place])
        motion_product(rates[body], wanted[body], axes[i], 0.5 * qd[place])
        _momentum_columns(block, frames[body], rates[body])
        _momentum_columns(other, frames[body], wanted[body])
        _add_half_product(block, twists[body], other)
        _momentum_columns(other, frames[body], twists[body])
        _add_half_product(block, wanted[body], other)
        _keep(wrenches, arm, i, block)
    x = np.zeros((n, arm.width))
    _project(x, arm, axes, wrenches)
    _rotor_columns(x, arm, alpha_dot)
    _friction_columns(x, arm, qd)
    return x


regressors.register(ChainParameters, chain_Y12)
law_regressor.register(ChainParameters, chain_X)


@jit
def _add_joint(twists: np.ndarray, parent: int, i: int, axes: np.ndarray, speed: float) -> None:
    """Twist of joint i's body: that of its parent and the joint's own."""
    for r in range(6):
        twists[i + 1, r] = twists[parent, r] + axes[i, r] * speed


@jit
def _momentum_columns(out: np.ndarray, frame: np.ndarray, twist: np.ndarray) -> None:
    """Momentum of a body per unit of its ten inertial parameters.

    Linear in the twist; of the spatial acceleration −g it is the body's weight.

    Args:
        out: Wrenches that are written, shape (6, 10).
        frame: [R p] of the body's frame, in which its parameters are, shape (3, 4).
        twist: (v, ω) about the world's origin, shape (6,).
    """
    p = (frame[0, 3], frame[1, 3], frame[2, 3])
    w = (twist[3], twist[4], twist[5])
    turned = cross(w, p)
    v = (twist[0] + turned[0], twist[1] + turned[1], twist[2] + turned[2])
    moment = cross(p, v)
    for r in range(3):
        out[r, 0] = v[r]
        out[3 + r, 0] = moment[r]
    for k in range(3):  # first moments: ω × h, h × v
        x = (frame[0, k], frame[1, k], frame[2, k])
        force = cross(w, x)
        own, lever = cross(x, v), cross(p, force)
        for r in range(3):
            out[r, 1 + k] = force[r]
            out[3 + r, 1 + k] = own[r] + lever[r]
    column = 4
    for k in range(3):  # second moments, in the order xx, xy, yy, xz, yz, zz
        for m in range(k + 1):
            along_k = frame[0, k] * w[0] + frame[1, k] * w[1] + frame[2, k] * w[2]
            along_m = frame[0, m] * w[0] + frame[1, m] * w[1] + frame[2, m] * w[2]
            if k == m:
                along_m = 0.0
            for r in range(3):
                out[r, column] = 0.0
                out[3 + r, column] = frame[r, m] * along_k + frame[r, k] * along_m
            column += 1


@jit
def _add_half_product(out: np.ndarray, twist: np.ndarray, columns: np.ndarray) -> None:
    """Add half of twist ×* each column, shapes (6, 10)."""
    v = (0.5 * twist[0], 0.5 * twist[1], 0.5 * twist[2])
    w = (0.5 * twist[3], 0.5 * twist[4], 0.5 * twist[5])
    for c in range(PER_BODY):
        force = (columns[0, c], columns[1, c], columns[2, c])
        moment = (columns[3, c], columns[4, c], columns[5, c])
        turning, turned, carried = cross(w, force), cross(w, moment), cross(v, force)
        for r in range(3):
            out[r, c] += turning[r]
            out[3 + r, c] += turned[r] + carried[r]


@jit
def _keep(out: np.ndarray, arm: ChainParameters, i: int, block: np.ndarray) -> None:
    """Write the base columns among a body's ten columns, (6, 10) → (6, b)."""
    arm = borrowed(arm)
    for c in range(arm.first[i], arm.first[i + 1]):
        for r in range(6):
            out[r, c] = block[r, arm.kind[c]]


@jit
def _project(out: np.ndarray, arm: ChainParameters, axes: np.ndarray,
             wrenches: np.ndarray) -> None:
    """Add to each joint's row the power of its axis on the wrenches of the bodies it moves.

    Args:
        out: Regressor in the user's order, shape (n, m).
        arm: The chain and its parameters.
        axes: Twist per joint, shape (n, 6).
        wrenches: Per base column, shape (6, b).
    """
    arm = borrowed(arm)
    for i in range(axes.shape[0]):
        row = out[arm.chain.place[i]]
        a0, a1, a2 = axes[i, 0], axes[i, 1], axes[i, 2]
        a3, a4, a5 = axes[i, 3], axes[i, 4], axes[i, 5]
        for c in range(arm.first[i], arm.end[i]):
            row[c] += (a0 * wrenches[0, c] + a1 * wrenches[1, c] + a2 * wrenches[2, c]
                       + a3 * wrenches[3, c] + a4 * wrenches[4, c] + a5 * wrenches[5, c])


@jit
def _rotor_columns(out: np.ndarray, arm: ChainParameters, rate: np.ndarray) -> None:
    """Write the columns of diag(Ia) q̇ or diag(Ia) α̇."""
    arm = borrowed(arm)
    for j in range(rate.size):
        if arm.rotor[j] >= 0:
            out[j, arm.rotor[j]] = rate[j]


@jit
def _friction_columns(out: np.ndarray, arm: ChainParameters, qd: np.ndarray) -> None:
    """Write the columns of diag(fv) q̇ + diag(fc + fs √|q̇|) tanh(q̇/v_s) + f0."""
    arm = borrowed(arm)
    viscous, coulomb, offset, root = (arm.friction[0], arm.friction[1], arm.friction[2],
                                      arm.friction[3])
    for j in range(qd.size):
        if viscous >= 0:
            out[j, viscous + j] = qd[j]
        if offset >= 0:
            out[j, offset + j] = 1.0
        if coulomb >= 0 or root >= 0:
            sign = math.tanh(qd[j] / arm.coulomb_velocity)
            if coulomb >= 0:
                out[j, coulomb + j] = sign
            if root >= 0:
                out[j, root + j] = sign * math.sqrt(abs(qd[j]))
