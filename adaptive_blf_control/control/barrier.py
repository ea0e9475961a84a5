# SPDX-License-Identifier: Apache-2.0
"""Asymmetric barrier Lyapunov function (ABLF), per joint: equations (10), (11), (23), (24).

The symmetric one (SBLF) is the case of equal bounds. The functions are defined for every e1: at
and beyond a bound the error is replaced by ``INTERIOR`` of that bound, so that the barrier is
large, finite and still pushes inward. Inside, nothing is changed.

V (30) adds the barrier to a kinetic energy, so the paper's barrier stands for 1 J in every joint,
a stiffness of 1 J/b² at e1 = 0, whatever the joint moves. A weight per joint says how many joules;
(23) to (29), (57) and the proofs hold for any positive one, with g scaled alike.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.control.settings import INTERIOR

__all__ = ['INTERIOR', 'Each', 'active_bound', 'barrier', 'barrier_gradient', 'bound_towards',
           'interior', 'joint_barrier']

Each = TypeVar('Each', float, np.ndarray)
"""The value of one joint, or those of all, shape (n,): what holds joint by joint."""


@jit
def active_bound(e1: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Bound on the side where the error is (11): k_b where e1 > 0, else k_a, both > 0.

    Args:
        e1: Tracking error q − y_d, shape (n,) [rad].
        lower: Lower end of the performance set, −k_a < 0, shape (n,) [rad].
        upper: Upper end, k_b > 0, shape (n,) [rad].
    """
    b = np.empty_like(e1)
    for i in range(b.size):
        b[i] = bound_towards(e1[i], lower[i], upper[i])
    return b


@jit
def bound_towards(e1: float, lower: float, upper: float) -> float:
    """`active_bound` of one joint [rad]."""
    return upper if e1 > 0.0 else -lower


@jit
def interior(e1: Each, b: Each) -> Each:
    """Return e1 limited to ±``INTERIOR`` b, shape (n,) [rad]: where the barrier is evaluated."""
    return np.maximum(np.minimum(e1, INTERIOR * b), -INTERIOR * b)


@jit
def barrier(e1: np.ndarray, b: np.ndarray, weight: np.ndarray) -> float:
    """Equation (23) with a weight per joint: V1 = ½ Σ c e1² / (b² − e1²) [J].

    Args:
        e1: Tracking error, shape (n,) [rad].
        b: Active bound (11), shape (n,) [rad].
        weight: c > 0, shape (n,) [J]; 1 J in the paper.
    """
    value = 0.0
    for i in range(b.size):
        value += joint_barrier(e1[i], b[i], weight[i])
    return value


@jit
def joint_barrier(e1: float, b: float, weight: float) -> float:
    """`barrier` of one joint [J]."""
    e = interior(e1, b)
    return 0.5 * weight * e * e / (b * b - e * e)


@jit
def barrier_gradient(e1: Each, b: Each, weight: Each) -> Each:
    """Gradient of `barrier`: g = c b² e1 / (b² − e1²)², shape (n,) [N·m]."""
    e = interior(e1, b)
    w = b * b - e * e
    return weight * b * b * e / (w * w)
