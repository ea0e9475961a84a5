# SPDX-License-Identifier: Apache-2.0
"""Γ, k_t and k_h from what is known of the arm, the noise of the torque and the delay.

A Gaussian θ with the nominal values and the standard deviations s, seen through pairs with the
noise σ [N·m], has the mean that minimises Σ_j (θ_j − θ_nom,j)²/s_j² + Σ_pairs |Y_f θ − τ_f|²/σ².
After the time t the update law (37) has weighted the pairs with t k_h against Γ⁻¹, so

    Γ = γ diag(s²),    k_h = 1/(γ σ² HORIZON)

make it that mean at t = HORIZON: what the data do not tell stays near the URDF's values, and what
they tell well is learned at once. γ is the largest for which the adaptation, which acts on the
torque as a stiffness X Γ Xᵀ late by D, keeps its part of the budget (`gains`):
max (M⁻¹ X Γ Xᵀ)_ii = Λ²/8 along the reference.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.tuning.gains import ADAPTATION, adaptation_stiffness, total_rate
from adaptive_blf_control.tuning.inertia import ReferenceStates
from adaptive_blf_control.tuning.loop_delay import LoopDelay

__all__ = ['Adaptation', 'adaptation_for', 'parameter_deviation', 'stuck_error']

LINKS = 0.25  # part by which inertial parameters of a URDF's links are usually wrong
FRICTION, LEAST_FRICTION = 0.5, 0.002  # of the URDF's friction; of the torque limit at full speed
MOST_FRICTION = 0.5  # of the damping, where the URDF has none
STUCK = 0.3  # of the Coulomb friction: how wrong tanh is about a joint that sticks
ROTOR = 1e-3  # s², inertia of a rotor as seen from its joint, over the torque limit
HORIZON = 30.0  # s
INTEGRATION = 5e-5  # part of the torque by which even exact samples contradict each other
SHARE = 1e-4  # k_t/k_h: the pairs decide, not the noise of the present sample


class Adaptation(NamedTuple):
    """Gains of the update law.

    Attributes:
        gamma: Diagonal of Γ, shape (m,).
        kt: k_t.
        kh: k_h.
    """

    gamma: np.ndarray
    kt: float
    kh: float


def adaptation_for(arm: UrdfArm, deviation: np.ndarray, masses: np.ndarray,
                   states: ReferenceStates, delay: LoopDelay, noise: float,
                   torque: float) -> Adaptation:
    """Return the gains of the update law; see the module.

    Args:
        arm: The arm.
        deviation: Standard deviations s of the parameters, > 0, shape (m,).
        masses: M(q) along the reference, shape (K, n, n) [kg·m²].
        states: The reference.
        delay: Of the loop.
        noise: σ of a pair [N·m].
        torque: RMS torque along the reference, > 0 [N·m].
    """
    stiffness = adaptation_stiffness(arm, masses, states, deviation ** 2).max()
    scale = ADAPTATION * total_rate(delay) ** 2 / stiffness
    square = noise ** 2 + (INTEGRATION * torque) ** 2
    kh = 1.0 / (scale * square * HORIZON)
    return Adaptation(scale * deviation ** 2, SHARE * kh, kh)


def parameter_deviation(arm: UrdfArm, speed: np.ndarray, torque_limit: np.ndarray,
                        payload: float, damping: np.ndarray, *,
                        from_zero: bool = False) -> np.ndarray:
    """Return standard deviations of θ around its start, shape (m,).

    Mass, first moments and inertia of every link are off by a quarter of m, m l and m l², with l
    its distance from the joint axis or its radius of gyration, whichever is larger; a base
    parameter sums what is lumped into it. What the URDF leaves at zero, as all of a link without
    an inertial, is as uncertain as the smallest value of its kind that it states. Rotors count
    where their inertia is learned: a stated one is off by a quarter, another by ROTOR times the
    torque limit. A viscous
    friction that the URDF does not have is at most half of the damping: what noise makes of it in
    a joint that needs next to no torque must not drive that joint.

    Args:
        arm: The arm.
        speed: Speed limits, shape (n,) [rad/s].
        torque_limit: Torque limits, shape (n,) [N·m].
        payload: Mass that may be at the tip besides [kg].
        damping: k2 without the share of friction in it, shape (n,) [N·m·s/rad].
        from_zero: Whether θ̂ starts at 0, off by all of the URDF's values instead.
    """
    mass, moment = arm.inertial[:, :1], arm.inertial[:, 1:4]
    # Half of Ixx + Iyy + Izz: that of a mass m in the distance l about either axis across, m l².
    inertia = 0.5 * arm.inertial[:, [4, 6, 9]].sum(axis=1, keepdims=True)
    first = np.maximum(np.linalg.norm(moment, axis=1, keepdims=True), np.sqrt(mass * inertia))
    sizes = np.hstack([mass, np.repeat(first, 3, axis=1), np.repeat(inertia, 6, axis=1)])
    stated = np.min(sizes, axis=0, where=sizes > 0.0, initial=np.inf)
    sizes = np.where((sizes > 0.0) | np.isinf(stated), sizes, stated)
    links, part = (1.0, 1.0) if from_zero else (LINKS, FRICTION)
    base = arm.base_from_standard ** 2 @ (links * sizes.reshape(arm.n * PER_BODY)) ** 2
    rotor = np.where(arm.rotor > 0.0, links * arm.rotor, ROTOR * torque_limit)
    base = base + arm.base_from_rotor ** 2 @ rotor ** 2
    nominal = arm.nominal[arm.base_count:]
    least = LEAST_FRICTION * torque_limit
    viscous = np.minimum(least / speed, MOST_FRICTION * damping)
    smallest = np.concatenate([np.zeros(0), *(
        viscous if name == 'fv' else least for name in _friction_kinds(arm))])
    friction = np.maximum(part * np.abs(nominal), smallest)
    square = np.concatenate([base, friction ** 2])
    if arm.payload_direction is not None:
        square = square + (payload * arm.payload_direction) ** 2
    return np.asarray(np.sqrt(square))


def stuck_error(arm: UrdfArm, torque_limit: np.ndarray) -> float:
    """Return what a pair of a joint that sticks is wrong by, RMS over joints [N·m].

    There friction is whatever holds the joint, and tanh(q̇/v_s) next to nothing: as exact data it
    would make a Coulomb friction of many times the true one. 0 where none is learned.
    """
    if 'fc' not in _friction_kinds(arm):
        return 0.0
    size = np.maximum(arm.friction(arm.nominal)[1], LEAST_FRICTION * torque_limit)
    return STUCK * float(np.sqrt(np.mean(size ** 2)))


def _friction_kinds(arm: UrdfArm) -> list[str]:
    names = (name.partition('_')[0] for name in arm.parameters[arm.base_count:])
    return list(dict.fromkeys(names))
