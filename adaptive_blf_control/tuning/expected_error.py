# SPDX-License-Identifier: Apache-2.0
"""The tracking error that a torque leaves which the model does not have."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.control.barrier import barrier_gradient, INTERIOR
from adaptive_blf_control.control.law import stabilising_function

__all__ = ['static_error']

STEPS = 2000


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
