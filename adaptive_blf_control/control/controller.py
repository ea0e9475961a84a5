# SPDX-License-Identifier: Apache-2.0
"""The adaptive controller: measured state and θ̂ in, torque and adaptation term out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.barrier import barrier
from adaptive_blf_control.control.law import answer, errors
from adaptive_blf_control.control.reference import Reference, ReferencePoint
from adaptive_blf_control.control.sets import (
    check_performance_inside_safety,
    check_start,
    JointInterval,
)
from adaptive_blf_control.errors import ParameterError

__all__ = ['COUPLINGS', 'Controller', 'ControllerSettings', 'ControlOutput', 'sampling_number']

COUPLINGS = ('per_joint', 'pseudoinverse')


@dataclass(frozen=True)
class ControllerSettings:
    """Gains and limits of the law; every array has shape (n,).

    Attributes:
        k1: Gains of the stabilising function (27) [1/(s·rad⁴)].
        k2: Gains on e2 [N·m·s/rad].
        torque_limit: Largest torque [N·m], > 0; the law is clipped to ± this.
        coupling: ``per_joint`` (smooth) or ``pseudoinverse`` (the paper's).
    """

    k1: np.ndarray
    k2: np.ndarray
    torque_limit: np.ndarray
    coupling: str = 'per_joint'

    def __post_init__(self) -> None:
        """Check signs and names; ParameterError names the gain."""
        for name in ('k1', 'k2', 'torque_limit'):
            value = np.array(getattr(self, name), dtype=float)
            if not (np.all(np.isfinite(value)) and np.all(value > 0.0)):
                raise ParameterError(f'controller.{name}', value.tolist(), 'values > 0')
            object.__setattr__(self, name, value)
        if self.coupling not in COUPLINGS:
            raise ParameterError('controller.coupling', self.coupling, f'one of {list(COUPLINGS)}')


class ControlOutput(NamedTuple):
    """What one sample of the controller gives; arrays of shape (n,) unless said.

    Attributes:
        torque: Commanded torque after the limit [N·m]; always finite.
        adaptation_term: Xᵀ e2 of (37), shape (m,).
        e1: Tracking error (5) [rad].
        e2: q̇ − α [rad/s].
        reference: y_d with derivatives.
        x: Regressor X, shape (n, m).
        bound: Active bound (11) [rad].
        wanted: Torque before the limit [N·m].
    """

    torque: np.ndarray
    adaptation_term: np.ndarray
    e1: np.ndarray
    e2: np.ndarray
    reference: ReferencePoint
    x: np.ndarray
    bound: np.ndarray
    wanted: np.ndarray

    @property
    def saturated(self) -> np.ndarray:
        """Where the torque limit is at work, shape (n,), bool."""
        return self.torque != self.wanted


class Controller:
    """Equation (38) (or (34), when θ* is passed as θ̂) inside the sets (7) and (8)."""

    def __init__(self, arm: Arm, settings: ControllerSettings, safety: JointInterval,
                 performance: JointInterval, reference: Reference) -> None:
        """Check 𝒫̄ ⊆ 𝒮̄ (9); SetViolation names joint and numbers where it fails."""
        check_performance_inside_safety(safety, performance, reference.range(), arm.joints)
        self.arm = arm
        self.settings = settings
        self.safety = safety
        self.performance = performance
        self.reference = reference

    def check_start(self, q: np.ndarray, t: float = 0.0) -> None:
        """Raise SetViolation where the first measured state (n,) [rad] is outside a set."""
        check_start(self.safety, self.performance, q, q - self.reference.at(t).position,
                    self.arm.joints)

    def update(self, t: float, q: np.ndarray, qd: np.ndarray, theta: np.ndarray) -> ControlOutput:
        """Compute the torque for the sample taken at ``t`` [s] since the start of the motion.

        Args:
            t: Time of the sample [s].
            q: Measured positions, shape (n,) [rad].
            qd: Measured velocities, shape (n,) [rad/s].
            theta: Parameter estimate θ̂, shape (m,).
        """
        settings = self.settings
        point = self.reference.at(t)
        e1, e2, alpha, alpha_dot, b = errors(
            q, qd, point.position, point.velocity, point.acceleration,
            self.performance.lower, self.performance.upper, settings.k1)
        x = self.arm.X(q, qd, alpha, alpha_dot)
        tau, wanted, term = answer(x, theta, settings.k2, e1, e2, b,
                                   settings.coupling == 'per_joint', settings.torque_limit)
        return ControlOutput(tau, term, e1, e2, point, x, b, wanted)

    def lyapunov(self, q: np.ndarray, output: ControlOutput, theta: np.ndarray) -> float:
        """V = V1 + ½ e2ᵀ M(q) e2 (30), M from ``theta``; a monitor, not part of the law."""
        kinetic = 0.5 * output.e2 @ self.arm.Y1(q, output.e2) @ theta
        return barrier(output.e1, output.bound) + float(kinetic)


def sampling_number(arm: Arm, k2: np.ndarray, q: np.ndarray, theta: np.ndarray,
                    dt: float) -> float:
    """Return dt λ_max(M⁻¹ diag(k2)); a loop sampled every ``dt`` [s] needs it below 2.

    ``theta`` is a prior or nominal model; where its M(q) is not positive definite nothing can be
    said and NaN is returned.
    """
    mass = np.column_stack([arm.Y1(q, unit) @ theta for unit in np.eye(arm.n)])
    if np.linalg.eigvalsh(0.5 * (mass + mass.T))[0] <= 0.0:
        return float('nan')
    return float(dt * np.max(np.abs(np.linalg.eigvals(np.linalg.solve(mass, np.diag(k2))))))
