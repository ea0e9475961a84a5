# SPDX-License-Identifier: Apache-2.0
"""Runge-Kutta integration of an arm under a torque that is held over the step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adaptive_blf_control.compiled import jit_closure

__all__ = ['Advance', 'make_rk4']

Advance = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float, int],
                   tuple[np.ndarray, np.ndarray]]


def make_rk4(acceleration: Callable[..., np.ndarray]) -> Advance:
    """Make ``advance(q, qd, tau, theta, dt, substeps) -> (q, qd)``, classic fourth-order RK.

    Args:
        acceleration: ``acceleration(q, qd, tau, theta) -> q̈``; compiled where numba is there.

    Returns:
        The integrator, compiled with ``acceleration`` in line.
    """
    @jit_closure
    def advance(q: np.ndarray, qd: np.ndarray, tau: np.ndarray, theta: np.ndarray, dt: float,
                substeps: int) -> tuple[np.ndarray, np.ndarray]:
        h = dt / substeps
        for _ in range(substeps):
            a1 = acceleration(q, qd, tau, theta)
            v2 = qd + 0.5 * h * a1
            a2 = acceleration(q + 0.5 * h * qd, v2, tau, theta)
            v3 = qd + 0.5 * h * a2
            a3 = acceleration(q + 0.5 * h * v2, v3, tau, theta)
            v4 = qd + h * a3
            a4 = acceleration(q + h * v3, v4, tau, theta)
            q = q + h / 6.0 * (qd + 2.0 * v2 + 2.0 * v3 + v4)
            qd = qd + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        return q, qd

    return advance  # type: ignore[return-value]
