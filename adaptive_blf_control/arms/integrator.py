# SPDX-License-Identifier: Apache-2.0
"""Runge-Kutta integration of an arm under a torque that is held over the step.

The true arm is a NamedTuple of its own type. What there is to know about it is `acceleration`,
to which every arm adds its own implementation:

    class Pendulum(NamedTuple):
        theta: np.ndarray

    @jit
    def pendulum_acceleration(arm: Pendulum, q, qd, tau): ...

    acceleration.register(Pendulum, pendulum_acceleration)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptive_blf_control.arrays import are_vectors, checked_count, checked_number, checked_vectors
from adaptive_blf_control.compiled import by_type, jit

__all__ = ['acceleration', 'advance', 'CompiledDynamics']


@by_type
def acceleration(arm: Any, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Forward dynamics of an arm, q̈ = M⁻¹(τ − C q̇ − G − F q̇), shape (n,) [rad/s²]."""
    raise TypeError(f'no forward dynamics are registered for {type(arm).__name__}')


@jit
def advance(arm: Any, q: np.ndarray, qd: np.ndarray, tau: np.ndarray, dt: float,
            substeps: int) -> tuple[np.ndarray, np.ndarray]:
    """Integrate with the classic fourth-order Runge-Kutta method.

    Args:
        arm: The true arm, of a type that `acceleration` knows.
        q: Joint positions, shape (n,) [rad].
        qd: Joint velocities, shape (n,) [rad/s].
        tau: Joint torques, shape (n,) [N·m].
        dt: Time to integrate over [s].
        substeps: Runge-Kutta steps it is divided into.

    Returns:
        Positions and velocities after ``dt``.
    """
    h = dt / substeps
    for _ in range(substeps):
        a1 = acceleration(arm, q, qd, tau)
        v2 = qd + 0.5 * h * a1
        a2 = acceleration(arm, q + 0.5 * h * qd, v2, tau)
        v3 = qd + 0.5 * h * a2
        a3 = acceleration(arm, q + 0.5 * h * v2, v3, tau)
        v4 = qd + h * a3
        a4 = acceleration(arm, q + h * v3, v4, tau)
        q = q + h / 6.0 * (qd + 2.0 * v2 + 2.0 * v3 + v4)
        qd = qd + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return q, qd


class CompiledDynamics:
    """`ForwardDynamics` of a true arm that `acceleration` knows.

    Attributes:
        arm: The true arm as compiled functions take it.
    """

    def __init__(self, arm: Any, joints: Sequence[str]) -> None:
        """Take the true arm, and the names of its joints for messages."""
        self.arm = arm
        self._joints = tuple(joints)
        self._shape = (len(self._joints),)

    def acceleration(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return q̈ = M⁻¹(τ − C q̇ − G − F q̇), shape (n,) [rad/s²].

        Raises:
            ParameterError: An array is not of shape (n,).
        """
        if not are_vectors(self._shape, q, qd, tau):
            q, qd, tau = checked_vectors(self._joints, q=q, qd=qd, tau=tau)
        result: np.ndarray = acceleration(self.arm, q, qd, tau)
        return result

    def advance(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray, dt: float,
                substeps: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Integrate over ``dt`` [s] under a held torque with RK4 sub-steps; return new (q, q̇).

        Raises:
            ParameterError: An array is not of shape (n,), or a number cannot be used.
        """
        if not are_vectors(self._shape, q, qd, tau):
            q, qd, tau = checked_vectors(self._joints, q=q, qd=qd, tau=tau)
        return advance(self.arm, q, qd, tau, checked_number('dt', dt),
                       checked_count('substeps', substeps))
