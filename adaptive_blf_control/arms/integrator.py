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
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.compiled import borrowed, by_type, jit, local_zeros
from adaptive_blf_control.parameters.guided import Guided

__all__ = ['acceleration', 'advance', 'CompiledDynamics', 'move']


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
    q, qd = q.copy(), qd.copy()
    move(arm, q, qd, tau, dt, substeps)
    return q, qd


@jit
def move(arm: Any, q: np.ndarray, qd: np.ndarray, tau: np.ndarray, dt: float,
         substeps: int) -> None:
    """Change positions and velocities in place to those after ``dt``, see `advance`."""
    arm = borrowed(arm)
    h = dt / substeps
    stages = local_zeros((4, q.size))
    at, v2, v3, v4 = stages[0], stages[1], stages[2], stages[3]
    for _ in range(substeps):
        a1 = acceleration(arm, q, qd, tau)
        _stage(at, v2, q, qd, qd, a1, 0.5 * h)
        a2 = acceleration(arm, at, v2, tau)
        _stage(at, v3, q, qd, v2, a2, 0.5 * h)
        a3 = acceleration(arm, at, v3, tau)
        _stage(at, v4, q, qd, v3, a3, h)
        a4 = acceleration(arm, at, v4, tau)
        for i in range(q.size):
            q[i] += h / 6.0 * (qd[i] + 2.0 * v2[i] + 2.0 * v3[i] + v4[i])
            qd[i] += h / 6.0 * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i])


@jit
def _stage(position: np.ndarray, velocity: np.ndarray, q: np.ndarray, qd: np.ndarray,
           slope: np.ndarray, acceleration: np.ndarray, h: float) -> None:
    """Write the state ``h`` [s] from (q, q̇) on along a slope (q̇, q̈)."""
    for i in range(q.size):
        position[i] = q[i] + h * slope[i]
        velocity[i] = qd[i] + h * acceleration[i]


class CompiledDynamics(Guided, instead={
        '()': 'acceleration(q, qd, tau) returns qdd, advance(q, qd, tau, dt) the next q and qd',
        **dict.fromkeys(('gravity', 'gravity_vector', 'G', 'g', 'gravload'),
                        'inverse_dynamics(arm, theta, q, 0 * q, 0 * q) of the package is the '
                        'torque at rest'),
        **dict.fromkeys(('inverse_dynamics', 'rnea', 'rne', 'torque', 'tau'),
                        'inverse_dynamics(arm, theta, q, qd, qdd) of the package'),
        **dict.fromkeys(('mass_matrix', 'M', 'crba', 'inertia'),
                        'mass_matrix(q, theta) of the arm of a URDF; Y1(q, e) @ theta of any arm '
                        'is the product of M(q) with a vector e'),
        'step': 'advance(q, qd, tau, dt) returns the next q and qd',
        'q': 'no state is kept: advance(q, qd, tau, dt) returns the next q and qd',
        'qd': 'no state is kept: advance(q, qd, tau, dt) returns the next q and qd',
        'reset': 'no state is kept: advance(q, qd, tau, dt) returns the next q and qd'}):
    """`ForwardDynamics` of a true arm that `acceleration` knows.

    Attributes:
        arm: The true arm as compiled functions take it.
    """

    def __init__(self, arm: Any, joints: Sequence[str]) -> None:
        """Take the true arm, and the names of its joints for messages."""
        self.arm = arm
        self._joints = tuple(joints)
        self._shape = (len(self._joints),)

    def __repr__(self) -> str:
        """Name the joints."""
        return f'<{type(self).__name__} of {len(self._joints)} joints ({", ".join(self._joints)})>'

    def acceleration(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return q̈ = M⁻¹(τ − C q̇ − G − F q̇), shape (n,) [rad/s²].

        Raises:
            ParameterError: An array is not of shape (n,).
        """
        if not are_vectors(self._shape, q, qd, tau):
            q, qd, tau = checked_vectors(self._joints, q=q, qd=qd, tau=tau)
        result: np.ndarray = acceleration(self.arm, q, qd, tau)
        return result

    @checked_call
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
