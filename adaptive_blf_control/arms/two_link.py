# SPDX-License-Identifier: Apache-2.0
"""The paper's planar 2-DoF arm (42)-(46), with the errata of docs/theory.md applied."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import ForwardDynamics
from adaptive_blf_control.arms.integrator import acceleration, CompiledDynamics
from adaptive_blf_control.arms.planar import (
    planar_points,
    PlanarArm,
    PlanarRegressors,
    refuse_lengths,
)
from adaptive_blf_control.arms.regressors import law_regressor, regressors
from adaptive_blf_control.arrays import checked_theta
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ArmError

__all__ = ['TwoLinkArm', 'two_link_X', 'two_link_Y1', 'two_link_Y12', 'two_link_Y2',
           'two_link_acceleration']

# θ* of section VI-A: p1, p2, p3 [kg·m²], f1, f2 [N·m·s/rad]
NOMINAL = (3.473, 0.196, 0.242, 5.3, 1.1)
DRAWN_LENGTHS = (0.5, 0.4)  # [m], see link_points


@jit
def two_link_Y1(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Equation (43): Y1 θ = M q̇, shape (2, 5)."""
    c2 = np.cos(q[1])
    y = np.zeros((2, 5))
    y[0, 0] = qd[0]
    y[0, 1] = qd[1]
    y[0, 2] = (2.0 * qd[0] + qd[1]) * c2
    y[1, 1] = qd[0] + qd[1]
    y[1, 2] = qd[0] * c2
    return y


@jit
def two_link_Y2(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Equation (44): Y2 θ = −Ṁ q̇ + C q̇ + F q̇, shape (2, 5)."""
    y = np.zeros((2, 5))
    y[0, 3] = qd[0]
    y[1, 2] = qd[0] * (qd[0] + qd[1]) * np.sin(q[1])
    y[1, 4] = qd[1]
    return y


@jit
def two_link_Y12(q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Equations (43) and (44) at once."""
    return two_link_Y1(q, qd), two_link_Y2(q, qd)


@jit
def two_link_X(q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
               alpha_dot: np.ndarray) -> np.ndarray:
    """Equation (46), corrected: X θ = M α̇ + C q̇ + F q̇ − ½ Ṁ (q̇ − α), shape (2, 5)."""
    c2 = np.cos(q[1])
    s2 = np.sin(q[1])
    x = np.zeros((2, 5))
    x[0, 0] = alpha_dot[0]
    x[0, 1] = alpha_dot[1]
    x[0, 2] = ((2.0 * alpha_dot[0] + alpha_dot[1]) * c2 - (0.5 * qd[1] + qd[0]) * qd[1] * s2
               - (0.5 * alpha[1] + alpha[0]) * qd[1] * s2)
    x[0, 3] = qd[0]
    x[1, 1] = alpha_dot[0] + alpha_dot[1]
    x[1, 2] = (alpha_dot[0] * c2 + qd[0] * qd[0] * s2 + 0.5 * qd[0] * qd[1] * s2
               - 0.5 * alpha[0] * qd[1] * s2)
    x[1, 4] = qd[1]
    return x


@jit
def two_link_acceleration(q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
                          theta: np.ndarray) -> np.ndarray:
    """Equations (3) and (42): q̈ = M⁻¹(τ − C q̇ − F q̇), shape (2,) [rad/s²]."""
    p1, p2, p3 = theta[0], theta[1], theta[2]
    c2 = np.cos(q[1])
    p3s2 = p3 * np.sin(q[1])
    b1 = tau[0] + p3s2 * (2.0 * qd[0] + qd[1]) * qd[1] - theta[3] * qd[0]
    b2 = tau[1] - p3s2 * qd[0] * qd[0] - theta[4] * qd[1]
    m11 = p1 + 2.0 * p3 * c2
    m12 = p2 + p3 * c2
    determinant = m11 * p2 - m12 * m12
    qdd = np.empty(2)
    qdd[0] = (p2 * b1 - m12 * b2) / determinant
    qdd[1] = (m11 * b2 - m12 * b1) / determinant
    return qdd


class TwoLinkArrays(NamedTuple):
    """The arm as compiled functions take it: all there is to know is its number of parameters."""

    parameters: int


@jit
def _regressors(arm: TwoLinkArrays, q: np.ndarray,
                qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return two_link_Y12(q, qd)


@jit
def _law_regressor(arm: TwoLinkArrays, q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
                   alpha_dot: np.ndarray) -> np.ndarray:
    return two_link_X(q, qd, alpha, alpha_dot)


regressors.register(TwoLinkArrays, _regressors)
law_regressor.register(TwoLinkArrays, _law_regressor)


class _TrueTwoLink(NamedTuple):
    theta: np.ndarray


@jit
def _true_acceleration(arm: _TrueTwoLink, q: np.ndarray, qd: np.ndarray,
                       tau: np.ndarray) -> np.ndarray:
    return two_link_acceleration(q, qd, tau, arm.theta)


acceleration.register(_TrueTwoLink, _true_acceleration)


def _check_mass_matrix(p1: float, p2: float, p3: float) -> None:
    # det M = (p1 + 2 p3 c)(p2) − (p2 + p3 c)², smallest at c = ±1
    smallest = min(p1 * p2 - p2 * p2 - p3 * p3, p2)
    if not smallest > 0.0:
        raise ArmError(f'two_link: the inertia matrix of p1, p2, p3 = {p1:g}, {p2:g}, {p3:g} '
                       f'is not positive definite for every posture')


class TwoLinkArm(PlanarArm):
    """Planar 2-DoF arm without gravity, θ = (p1, p2, p3, f1, f2) (45).

    Its regressors are those of (43), (44) and (46), corrected.
    """

    _regressors = PlanarRegressors(two_link_Y1, two_link_Y2, two_link_Y12, two_link_X)

    @checked_call
    def __init__(self, joints: Sequence[str] = ('joint1', 'joint2'), **others: Any) -> None:
        """Name the joints; ArmError unless there are exactly two distinct names.

        Args:
            joints: Their names.
            others: Not used; another name is refused with the one that is meant.
        """
        refuse_lengths(type(self), others)
        super().__init__('two_link', joints, 2)
        self.parameters = ('p1', 'p2', 'p3', *(f'fv_{joint}' for joint in self.joints))
        self.nominal = np.array(NOMINAL)
        self.payload_direction: np.ndarray | None = None

    @property
    def arrays(self) -> TwoLinkArrays:
        """The arm as compiled functions take it, see `arms.regressors`."""
        return TwoLinkArrays(self.m)

    @checked_call
    def dynamics(self, theta: np.ndarray) -> ForwardDynamics:
        """Forward dynamics; ArmError where M(q) would not be positive definite."""
        theta = checked_theta('theta', theta, self.parameters)
        _check_mass_matrix(*theta[:3])
        return CompiledDynamics(_TrueTwoLink(theta.copy()), self.joints)

    def link_points(self, q: np.ndarray) -> np.ndarray:
        """Base, elbow and tip at joint positions q, shape (3, 3) [m].

        For drawing only: the paper gives no lengths and no equation needs them. Drawn are 0.5 m
        and 0.4 m.
        """
        return planar_points(q, DRAWN_LENGTHS)
