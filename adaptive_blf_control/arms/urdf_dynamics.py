# SPDX-License-Identifier: Apache-2.0
"""Forward dynamics of a URDF arm with one fixed set of parameters."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.chain import joint_vector
from adaptive_blf_control.arms.chain_dynamics import (
    chain_acceleration,
    chain_mass,
    ChainInertias,
)
from adaptive_blf_control.arms.integrator import CompiledDynamics
from adaptive_blf_control.errors import ArmError

__all__ = ['UrdfDynamics']


class UrdfDynamics(CompiledDynamics):
    """`ForwardDynamics` of a chain, with friction: q̈ = M⁻¹(τ − C q̇ − G − F q̇)."""

    def __init__(self, arm: ChainInertias) -> None:
        """Take a chain with the inertias to simulate.

        Raises:
            ArmError: If the mass matrix is not positive definite.
        """
        super().__init__(arm)
        self._n = arm.chain.place.size
        self._check_mass_matrix()

    def acceleration(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return q̈ = M⁻¹(τ − C q̇ − G − F q̇ − f_c tanh(q̇/v_s) − f_0), shape (n,) [rad/s²].

        Raises:
            ParameterError: An array is not of shape (n,).
        """
        n = self._n
        return chain_acceleration(self.arm, joint_vector('q', q, n), joint_vector('qd', qd, n),
                                  joint_vector('tau', tau, n))

    def advance(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray, dt: float,
                substeps: int) -> tuple[np.ndarray, np.ndarray]:
        """Integrate over ``dt`` [s] under a held torque with RK4 sub-steps; return new (q, q̇).

        Raises:
            ParameterError: An array is not of shape (n,).
        """
        n = self._n
        return super().advance(joint_vector('q', q, n), joint_vector('qd', qd, n),
                               joint_vector('tau', tau, n), float(dt), int(substeps))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M(q), shape (n, n) [kg·m²].

        Raises:
            ParameterError: ``q`` is not of shape (n,).
        """
        return chain_mass(self.arm, joint_vector('q', q, self._n))

    def _check_mass_matrix(self) -> None:
        random = np.random.default_rng(0)
        for q in random.uniform(-np.pi, np.pi, size=(20, self._n)):
            values = np.linalg.eigvalsh(self.mass_matrix(q))
            if not values[0] > 1e-12 * abs(values[-1]):
                raise ArmError('mass matrix is not positive definite with these parameters: '
                               f'eigenvalues from {values[0]:.3g} to {values[-1]:.3g} at q = '
                               f'{np.round(q, 3).tolist()}')
