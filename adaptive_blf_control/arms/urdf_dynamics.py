# SPDX-License-Identifier: Apache-2.0
"""Forward dynamics of a URDF arm with one fixed set of parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptive_blf_control.arms.chain_dynamics import chain_mass, ChainInertias
from adaptive_blf_control.arms.integrator import CompiledDynamics
from adaptive_blf_control.arrays import checked_vectors
from adaptive_blf_control.errors import ArmError

__all__ = ['UrdfDynamics']


class UrdfDynamics(CompiledDynamics):
    """`ForwardDynamics` of a chain, with friction: q̈ = M⁻¹(τ − C q̇ − G − F q̇)."""

    def __init__(self, arm: ChainInertias, joints: Sequence[str]) -> None:
        """Take a chain with the inertias to simulate, and the names of its joints.

        Raises:
            ArmError: If the mass matrix is not positive definite.
        """
        super().__init__(arm, joints)
        self._check_mass_matrix()

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M(q), shape (n, n) [kg·m²].

        Raises:
            ParameterError: ``q`` is not of shape (n,).
        """
        q, = checked_vectors(self._joints, q=q)
        return chain_mass(self.arm, q)

    def _check_mass_matrix(self) -> None:
        random = np.random.default_rng(0)
        for q in random.uniform(-np.pi, np.pi, size=(20, *self._shape)):
            values = np.linalg.eigvalsh(self.mass_matrix(q))
            if not values[0] > 1e-12 * abs(values[-1]):
                raise ArmError('mass matrix is not positive definite with these parameters: '
                               f'eigenvalues from {values[0]:.3g} to {values[-1]:.3g} at q = '
                               f'{np.round(q, 3).tolist()}')
