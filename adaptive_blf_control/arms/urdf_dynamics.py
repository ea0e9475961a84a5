# SPDX-License-Identifier: Apache-2.0
"""Forward dynamics of a URDF arm with one fixed set of parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.base_parameters import INERTIAL_NAMES
from adaptive_blf_control.arms.urdf_model import JointOrder, load_pinocchio
from adaptive_blf_control.errors import ArmError

__all__ = ['UrdfDynamics', 'with_inertias']


class UrdfDynamics:
    """Articulated-body algorithm with friction: q̈ = M⁻¹(τ − C q̇ − G − F q̇)."""

    def __init__(self, model: Any, order: JointOrder, friction: np.ndarray,
                 coulomb_velocity: float) -> None:
        """Take a model with the inertias to simulate.

        Args:
            model: Pinocchio model, with its gravity.
            order: Order of the user's joints.
            friction: Viscous [N·m·s/rad], Coulomb [N·m] and constant [N·m] coefficients in the
                rows, shape (3, n).
            coulomb_velocity: v_s of tanh(q̇/v_s) [rad/s].

        Raises:
            ArmError: If the mass matrix is not positive definite.
        """
        self._pin = load_pinocchio()
        self._model, self._data, self._order = model, model.createData(), order
        viscous, coulomb, offset = np.array(friction, dtype=float)
        self._viscous, self._offset = viscous, offset
        self._coulomb = coulomb if coulomb.any() else None
        self._coulomb_velocity = coulomb_velocity
        self._check_mass_matrix()

    def acceleration(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return q̈ = M⁻¹(τ − C q̇ − G − F q̇ − f_c tanh(q̇/v_s) − f_0), shape (n,) [rad/s²]."""
        drive = tau - self._viscous * qd - self._offset
        if self._coulomb is not None:
            drive -= self._coulomb * np.tanh(qd / self._coulomb_velocity)
        order = self._order
        result: np.ndarray = self._pin.aba(
            self._model, self._data, order.position(q), order.velocity(qd),
            order.velocity(drive))
        return result[order.rows]

    def advance(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray, dt: float,
                substeps: int) -> tuple[np.ndarray, np.ndarray]:
        """Integrate over ``dt`` [s] under a held torque with RK4 sub-steps; return new (q, q̇)."""
        step = dt / substeps
        for _ in range(substeps):
            q, qd = self._rk4_step(q, qd, tau, step)
        return q, qd

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return M(q), shape (n, n) [kg·m²]."""
        order = self._order
        mass = self._pin.crba(self._model, self._data, order.position(q))
        upper = np.triu(mass.reshape(order.rows.size, -1))  # of one joint comes a vector
        full: np.ndarray = upper + np.triu(upper, 1).T
        return full[np.ix_(order.rows, order.rows)]

    def _rk4_step(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
                  h: float) -> tuple[np.ndarray, np.ndarray]:
        half = 0.5 * h
        a1 = self.acceleration(q, qd, tau)
        v2 = qd + half * a1
        a2 = self.acceleration(q + half * qd, v2, tau)
        v3 = qd + half * a2
        a3 = self.acceleration(q + half * v2, v3, tau)
        v4 = qd + h * a3
        a4 = self.acceleration(q + h * v3, v4, tau)
        sixth = h / 6.0
        return q + sixth * (qd + 2.0 * (v2 + v3) + v4), qd + sixth * (a1 + 2.0 * (a2 + a3) + a4)

    def _check_mass_matrix(self) -> None:
        random = np.random.default_rng(0)
        n = self._order.rows.size
        for q in random.uniform(-np.pi, np.pi, size=(20, n)):
            values = np.linalg.eigvalsh(self.mass_matrix(q))
            if not values[0] > 1e-12 * abs(values[-1]):
                raise ArmError('mass matrix is not positive definite with these parameters: '
                               f'eigenvalues from {values[0]:.3g} to {values[-1]:.3g} at q = '
                               f'{np.round(q, 3).tolist()}')


def with_inertias(model: Any, standard: np.ndarray) -> Any:
    """Copy a model with other inertial parameters.

    Args:
        model: Pinocchio model; bodies whose parameters do not change keep theirs bit for bit.
        standard: Parameters per body in the model's order, shape (n, 10).

    Raises:
        ArmError: If a body has a mass that is not positive but other parameters.
    """
    pin = load_pinocchio()
    copy = model.copy()
    for i, values in enumerate(standard, start=1):
        if np.array_equal(values, model.inertias[i].toDynamicParameters()):
            continue
        if not values[0] > 0.0:
            listed = ', '.join(f'{name}={value:.3g}'
                               for name, value in zip(INERTIAL_NAMES, values, strict=True))
            raise ArmError(f'the link behind joint {model.names[i]!r} has no positive mass: '
                           f'{listed}')
        copy.inertias[i] = pin.Inertia.FromDynamicParameters(values)
    return copy
