# SPDX-License-Identifier: Apache-2.0
"""Gains of the law and of the update law from inertia, friction and delay.

Near e1 = 0, with b the bound of e1, c the weight of the barrier and p = k1 b⁴, the law (38) with
the update law's −Γ Xᵀe2 (37) is a damping and a stiffness that act late by D (`loop_delay`):

    M ë1 = −(K2 + pM) ė1(t − D) − (p K2 + C/b² + X Γ Xᵀ) e1(t − D) − p XΓXᵀ ∫e1

The damping gets a third of what the delay allows, Λ = λ_limit/3: a gain margin of 3 and a phase
margin of 60° before there is any stiffness. The stiffness gets Λ²/4, which without delay damps
critically; with the delay 45° of phase remain. In parts:

* p = λ/10 and λ_max(M⁻¹ K2) = λ with λ + p = Λ: k2_i = λ least_i/coupling (`SeenInertia`);
* the barrier, Λ²/16 at e1 = 0, so that up to half the bound, where its slope is 4 times as
  steep, it stays within the budget: c_i = b_i² k2_i Λ/16;
* the adaptation, Λ²/8: see `adaptation`.

Beyond half the bound the barrier is stiffer than that, and from 0.7 of it stiffer than such a loop
can damp: where a contact has held a joint there, it is thrown from bound to bound and never comes
to rest. With a delay its torque therefore stops growing at ``REACH`` of the bound. Then it is
nowhere more than a spring of g/e1 = 13 times the stiffness at e1 = 0, 0.8 Λ², which with the
adaptation and p leaves 13° of phase: by its describing function, at most the largest g/e1, no
oscillation of any size sustains itself. At ``REACH`` the torque is 11 c/b.

Viscous friction F that the arm has and θ̂ knows allows more damping. Its compensation is late, too:
M ė2 = −F q̇ + F̂ q̇(t − D) − K2 e2(t − D). With K2 = K + βF, 0 < β ≤ 1, there is a vector x on the
stability limit whose m = x*Mx, f = x*Fx and k = x*Kx make

    jω m + f (1 − (1 − β) e^(−jωD)) + k e^(−jωD) = 0.

The real part needs cos ωD < 0, so ωD > π/2, and k > f; the imaginary part ω m ≤ k sin ωD < ω m as
long as k D/m < π/2: a contradiction. What K has by itself is enough, and βF comes on top of it.
With β = ½ that holds even where the true friction is half the nominal one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.tuning.inertia import ReferenceStates, SeenInertia
from adaptive_blf_control.tuning.loop_delay import LoopDelay

__all__ = ['ADAPTATION', 'FRICTION', 'GAIN_MARGIN', 'Gains', 'REACH', 'adaptation_stiffness',
           'barrier_weight', 'law_gains', 'total_rate']

GAIN_MARGIN = 3.0
OUTER = 0.1  # p/λ
BARRIER, ADAPTATION = 1.0 / 16.0, 1.0 / 8.0  # parts of Λ²
FRICTION = 0.5  # β
REACH = 0.85  # part of a bound up to which the barrier pushes back harder, with a delay


class Gains(NamedTuple):
    """Gains of the law; arrays of shape (n,).

    Attributes:
        k1: [1/(s·rad⁴)].
        k2: [N·m·s/rad].
        barrier_weight: [J].
    """

    k1: np.ndarray
    k2: np.ndarray
    barrier_weight: np.ndarray


def total_rate(delay: LoopDelay) -> float:
    """Return Λ, the damping that a loop with this delay gets [1/s]."""
    return delay.largest_rate / GAIN_MARGIN


def law_gains(inertia: SeenInertia, friction: np.ndarray, bound: np.ndarray,
              delay: LoopDelay) -> Gains:
    """Return the gains of the law; see the module.

    Args:
        inertia: That the joints see along the reference.
        friction: Viscous coefficients that the model knows, ≥ 0, shape (n,) [N·m·s/rad].
        bound: Bounds of e1, > 0, shape (n,) [rad].
        delay: Of the loop.
    """
    total = total_rate(delay)
    rate = total / (1.0 + OUTER)
    k2 = rate * inertia.least / inertia.coupling + FRICTION * friction
    return Gains(OUTER * rate / bound ** 4, k2, barrier_weight(k2, bound, delay))


def barrier_weight(k2: np.ndarray, bound: np.ndarray, delay: LoopDelay) -> np.ndarray:
    """Return the weights of a barrier that k2 damps, shape (n,) [J]; arguments as above."""
    return np.asarray(BARRIER * total_rate(delay) * bound ** 2 * k2)


def adaptation_stiffness(arm: Arm, masses: np.ndarray, states: ReferenceStates,
                         gamma: np.ndarray) -> np.ndarray:
    """Return max (M⁻¹ X Γ Xᵀ)_ii along the reference, shape (n,) [1/s²].

    Args:
        arm: The arm.
        masses: M(q) along the reference, shape (K, n, n) [kg·m²].
        states: The reference.
        gamma: Diagonal of Γ, shape (m,).
    """
    regressors = (arm.X(q, qd, qd, qdd) for q, qd, qdd in zip(*states))
    products = [np.linalg.solve(mass, x * gamma @ x.T) for x, mass in zip(regressors, masses)]
    return np.asarray(np.diagonal(products, axis1=1, axis2=2).max(axis=0))
