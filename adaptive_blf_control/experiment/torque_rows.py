# SPDX-License-Identifier: Apache-2.0
"""The torque regressor along a motion, and how a function of it depends on the motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.regressors import law_regressor
from adaptive_blf_control.compiled import borrowed, jit

__all__ = ['torque_rows', 'torque_sensitivity']

STEP = 1e-4  # rad, rad/s: of central differences
UNIT = 1.0  # rad/s²: the torque is linear in the accelerations


@jit
def torque_rows(arm: Any, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Return Y of N states, shape (N, n, m), with Y θ = M q̈ + C q̇ + G + F q̇ (2).

    Args:
        arm: The arm's arrays.
        q: Shape (N, n) [rad].
        qd: Shape (N, n) [rad/s].
        qdd: Shape (N, n) [rad/s²].
    """
    arm = borrowed(arm)
    first = law_regressor(arm, q[0], qd[0], qd[0], qdd[0])
    rows = np.empty((q.shape[0], first.shape[0], first.shape[1]))
    for k in range(q.shape[0]):
        rows[k] = law_regressor(arm, q[k], qd[k], qd[k], qdd[k])
    return rows


@jit
def torque_sensitivity(arm: Any, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray,
                       weight: np.ndarray) -> np.ndarray:
    """Return the gradient of Σ weight · Y in q, q̇ and q̈ of each state, shape (3, N, n).

    Args:
        arm: The arm's arrays.
        q: Shape (N, n) [rad].
        qd: Shape (N, n) [rad/s].
        qdd: Shape (N, n) [rad/s²].
        weight: Shape (N, n, m).
    """
    arm = borrowed(arm)
    count, n = q.shape
    result = np.zeros((3, count, n))
    state = np.empty((3, n))
    for k in range(count):
        state[0], state[1], state[2] = q[k], qd[k], qdd[k]
        for kind in range(3):
            step = STEP if kind < 2 else UNIT
            for i in range(n):
                middle = state[kind, i]
                state[kind, i] = middle + step
                above = _weighted(law_regressor(arm, state[0], state[1], state[1], state[2]),
                                  weight[k])
                state[kind, i] = middle - step
                below = _weighted(law_regressor(arm, state[0], state[1], state[1], state[2]),
                                  weight[k])
                state[kind, i] = middle
                result[kind, k, i] = (above - below) / (2.0 * step)
    return result


@jit
def _weighted(rows: np.ndarray, weight: np.ndarray) -> float:
    total = 0.0
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            total += rows[i, j] * weight[i, j]
    return total
