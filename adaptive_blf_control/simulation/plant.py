# SPDX-License-Identifier: Apache-2.0
"""The simulated arm: true dynamics, drives that saturate, torque held between changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from adaptive_blf_control.arms.arm import ForwardDynamics
from adaptive_blf_control.control.law import limited
from adaptive_blf_control.errors import ParameterError

__all__ = ['Plant']


class Plant:
    """State (3) of the true arm, advanced with RK4 under the torque last applied.

    Attributes:
        q: Positions, shape (n,) [rad].
        qd: Velocities, shape (n,) [rad/s].
        torque: Torque that acts now, after saturation, shape (n,) [N·m].
        true_parameters: θ* by parameter name, for monitors only.
    """

    def __init__(self, dynamics: ForwardDynamics, q: np.ndarray, qd: np.ndarray,
                 torque_limit: np.ndarray, substeps: int,
                 true_parameters: Mapping[str, float]) -> None:
        """Start at rest or in motion with zero torque; ``substeps`` RK4 steps per advance."""
        for name, value in (('initial_position', q), ('initial_velocity', qd)):
            if not np.all(np.isfinite(value)):
                raise ParameterError(f'arm_driver.{name}', value.tolist(), 'finite values')
        self._dynamics = dynamics
        self.q = np.array(q, dtype=float)
        self.qd = np.array(qd, dtype=float)
        self.torque_limit = np.array(torque_limit, dtype=float)
        self.torque = np.zeros_like(self.q)
        self.true_parameters = dict(true_parameters)
        self._substeps = substeps

    def theta(self, parameters: Sequence[str]) -> np.ndarray:
        """Return θ* in the order of ``parameters``; 0 for an effect the true arm does not have."""
        return np.array([self.true_parameters.get(name, 0.0) for name in parameters])

    def apply(self, torque: np.ndarray) -> None:
        """Hold ``torque``, shape (n,) [N·m], clipped to the drives' limit, from now on."""
        self.torque = limited(torque, self.torque_limit)

    def advance(self, dt: float) -> None:
        """Move on by ``dt`` [s] under the held torque."""
        self.q, self.qd = self._dynamics.advance(self.q, self.qd, self.torque, dt,
                                                 self._substeps)

    def trial(self, torque: np.ndarray, dt: float) -> None:
        """Compute a step without taking it, e.g. to compile it before the clock runs."""
        self._dynamics.advance(self.q, self.qd, limited(torque, self.torque_limit), dt,
                               self._substeps)
