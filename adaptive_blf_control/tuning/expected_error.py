# SPDX-License-Identifier: Apache-2.0
"""The tracking errors to expect from what the model does not have."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.control.barrier import barrier_gradient, INTERIOR
from adaptive_blf_control.control.law import stabilising_function
from adaptive_blf_control.tuning.gains import Gains
from adaptive_blf_control.tuning.loop_delay import LoopDelay

__all__ = ['Start', 'start_error', 'static_error']

STEPS = 2000
START_TIME = 1.0  # s


class Start(NamedTuple):
    """The arm at rest where a motion begins, and the loop around it; see `gains`.

    Attributes:
        mass: M, shape (n, n) [kg·m²].
        regressor: X, shape (n, m).
        gains: Of the law.
        bound: Bounds of e1, shape (n,) [rad].
        friction: Viscous coefficients of the arm, shape (n,) [N·m·s/rad].
        known: Those that θ̂ compensates at first, shape (n,) [N·m·s/rad].
        gamma: Diagonal of Γ, shape (m,).
        delay: Of the loop.
    """

    mass: np.ndarray
    regressor: np.ndarray
    gains: Gains
    bound: np.ndarray
    friction: np.ndarray
    known: np.ndarray
    gamma: np.ndarray
    delay: LoopDelay


def start_error(start: Start, missing: np.ndarray) -> np.ndarray:
    """Return how far e1 gets before the adaptation has caught up, shape (n,) [rad].

    M ë1 = −K2 e2 − C/b² e1 − X Γ ∫Xᵀe2 + F̂ ė1 − F ė1 − X θ̃ with e2 = ė1 + p e1, all of the right
    side but the last two terms late by D, from e1 = ė1 = 0: the loop at rest in one posture.

    Args:
        start: Where.
        missing: Parts of θ̃ that are independent of each other, in columns, shape (m, k); their
            largest errors are summed in squares.
    """
    mass, x, gains, bound, friction, known, gamma, delay = start
    outer = (gains.k1 * bound ** 4)[:, None]
    inverse = np.linalg.inv(mass + delay.period * np.diag(friction))  # friction: backward Euler
    stiffness, k2 = (gains.barrier_weight / bound ** 2)[:, None], gains.k2[:, None]
    adaptation, disturbance = (x * gamma) @ x.T, x @ missing
    e1, speed, learned = (np.zeros_like(disturbance) for _ in range(3))
    late = [np.zeros_like(disturbance)] * max(1, round(delay.total / delay.period))
    peak = np.zeros_like(disturbance)
    for _ in range(math.ceil(START_TIME / delay.period)):
        e2 = speed + outer * e1
        learned = learned + delay.period * adaptation @ e2
        late.append(known[:, None] * speed - k2 * e2 - stiffness * e1 - learned)
        speed = inverse @ (mass @ speed + delay.period * (late.pop(0) - disturbance))
        e1 = e1 + delay.period * speed
        peak = np.maximum(peak, np.abs(e1))
    return np.asarray(np.linalg.norm(peak, axis=1))


def static_error(torque: np.ndarray, bound: np.ndarray, k1: np.ndarray, k2: np.ndarray,
                 weight: np.ndarray) -> np.ndarray:
    """Return where e1 comes to rest under a constant torque, shape (n,) [rad]; NaN: at the bound.

    There q̇ = ẏ_d, so e2 = −(α − ẏ_d) = k1 w² e1 and k2 e2 + g(e1) (38) equals the torque.

    Args:
        torque: That θ̂ does not have, ≥ 0, shape (n,) [N·m].
        bound: Bounds of e1, shape (n,) [rad].
        k1: Gains, shape (n,) [1/(s·rad⁴)].
        k2: Gains, shape (n,) [N·m·s/rad].
        weight: Weights of the barrier, shape (n,) [J].
    """
    rest = np.zeros_like(bound)
    result = np.full_like(bound, np.nan)
    for part in np.linspace(INTERIOR, 0.0, STEPS):
        e1 = part * bound
        alpha, _ = stabilising_function(e1, rest, rest, rest, bound, k1)
        enough = barrier_gradient(e1, bound, weight) - k2 * alpha >= torque
        result = np.where(enough, e1, result)
    return result
