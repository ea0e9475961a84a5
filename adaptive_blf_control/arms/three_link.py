# SPDX-License-Identifier: Apache-2.0
"""The paper's planar 3-DoF arm (47)-(51), horizontal, so without gravity.

The paper does not publish θ*. Ours are those of three uniform rods with a payload as a point mass
at the tip, see :func:`three_link_parameters`. For every planar arm p2 = 2 p6, p3 = 2 p7 and
p4 = p10 = 2 p9 hold; (47)-(51) do not use that, so all eleven columns are independent.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
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
from adaptive_blf_control.errors import ArmError, ParameterError
from adaptive_blf_control.linear_algebra import product

__all__ = ['ThreeLinkArm', 'three_link_X', 'three_link_Y1', 'three_link_Y12', 'three_link_Y2',
           'three_link_acceleration', 'three_link_mass', 'three_link_parameters']

MASSES = (6.0, 5.0, 4.0)  # [kg]
LENGTHS = (0.4, 0.4, 0.35)  # [m]


def three_link_parameters(payload: float = 0.0, friction: float = 1.5) -> np.ndarray:
    """θ* of uniform rods of 6, 5 and 4 kg, 0.4, 0.4 and 0.35 m long, shape (11,).

    Without payload, rounded: 2.83 0.56 2.08 0.56 1.07 0.28 1.04 0.163 0.28 0.56 1.5. The rounded
    values are not used: their M is a little off that of any arm.

    Args:
        payload: Point mass at the tip [kg], ≥ 0; θ* is linear in it.
        friction: f, the viscous coefficient of all three joints [N·m·s/rad], ≥ 0.

    Returns:
        p1 to p10 [kg·m²] and f, in the order of (48).

    Raises:
        ParameterError: A value is negative or not finite.
    """
    for name, value in (('payload', payload), ('friction', friction)):
        if not (math.isfinite(value) and value >= 0.0):
            raise ParameterError(name, value, 'a finite value >= 0')
    (m1, m2, m3), (l1, l2, l3) = MASSES, LENGTHS
    first = m3 * l3 / 2.0 + payload * l3  # first moment of the third link about its joint [kg·m]
    p8 = m3 * l3 ** 2 / 3.0 + payload * l3 ** 2
    p5 = p8 + m2 * l2 ** 2 / 3.0 + (m3 + payload) * l2 ** 2
    p1 = p5 + m1 * l1 ** 2 / 3.0 + (m2 + m3 + payload) * l1 ** 2
    p6 = l1 * first
    p7 = l1 * (m2 * l2 / 2.0 + (m3 + payload) * l2)
    p9 = l2 * first
    return np.array([p1, 2.0 * p6, 2.0 * p7, 2.0 * p9, p5, p6, p7, p8, p9, 2.0 * p9, friction])


@jit
def three_link_mass(q: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """M(q) of (47), shape (3, 3) [kg·m²]."""
    c2, c3, c23 = np.cos(q[1]), np.cos(q[2]), np.cos(q[1] + q[2])
    m = np.empty((3, 3))
    m[0, 0] = theta[0] + theta[1] * c23 + theta[2] * c2 + theta[3] * c3
    m[0, 1] = m[1, 0] = theta[4] + theta[5] * c23 + theta[6] * c2 + theta[3] * c3
    m[0, 2] = m[2, 0] = theta[7] + theta[5] * c23 + theta[8] * c3
    m[1, 1] = theta[4] + theta[9] * c3
    m[1, 2] = m[2, 1] = theta[7] + theta[8] * c3
    m[2, 2] = theta[7]
    return m


@jit
def three_link_Y1(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Equation (49): Y1 θ = M q̇, shape (3, 11)."""
    c2, c3, c23 = np.cos(q[1]), np.cos(q[2]), np.cos(q[1] + q[2])
    d1, d2, d3 = qd[0], qd[1], qd[2]
    y = np.zeros((3, 11))
    y[0, 0] = d1
    y[0, 1] = c23 * d1
    y[0, 2] = c2 * d1
    y[0, 3] = c3 * (d1 + d2)
    y[0, 4] = d2
    y[0, 5] = c23 * (d2 + d3)
    y[0, 6] = c2 * d2
    y[0, 7] = d3
    y[0, 8] = c3 * d3
    y[1, 3] = c3 * d1
    y[1, 4] = d1 + d2
    y[1, 5] = c23 * d1
    y[1, 6] = c2 * d1
    y[1, 7] = d3
    y[1, 8] = c3 * d3
    y[1, 9] = c3 * d2
    y[2, 5] = c23 * d1
    y[2, 7] = d1 + d2 + d3
    y[2, 8] = c3 * (d1 + d2)
    return y


@jit
def three_link_Y2(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Equation (50), terms that cancel left out: Y2 θ = −Ṁ q̇ + C q̇ + F q̇, shape (3, 11)."""
    s2, s3, s23 = np.sin(q[1]), np.sin(q[2]), np.sin(q[1] + q[2])
    d1, d2, d3 = qd[0], qd[1], qd[2]
    y = np.zeros((3, 11))
    y[0, 1] = -s23 * d2 * d3
    y[0, 5] = 2.0 * s23 * d2 * d3
    y[0, 10] = d1
    y[1, 3] = -s3 * d2 * d3
    y[1, 5] = s23 * d1 * (d1 + d2 + d3)
    y[1, 6] = s2 * d1 * (d1 + d2)
    y[1, 9] = s3 * d2 * d3
    y[1, 10] = d2
    y[2, 3] = s3 * d1 * d2
    y[2, 5] = s23 * d1 * (d1 + d2 + d3)
    y[2, 8] = s3 * (d1 * d1 + d2 * d2 + d1 * d3 + d2 * d3)
    y[2, 10] = d3
    return y


@jit
def three_link_Y12(q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Equations (49) and (50) at once."""
    return three_link_Y1(q, qd), three_link_Y2(q, qd)


@jit
def _centripetal(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """N of (47) and F q̇ as a regressor: N + F q̇ = C q̇ + F q̇, shape (3, 11)."""
    s2, s3, s23 = np.sin(q[1]), np.sin(q[2]), np.sin(q[1] + q[2])
    d1, d2, d3 = qd[0], qd[1], qd[2]
    y = np.zeros((3, 11))
    y[0, 1] = -s23 * (d1 * d3 + d2 * d3 + d1 * d2)
    y[0, 2] = -s2 * d1 * d2
    y[0, 3] = -s3 * (d1 + d2) * d3
    y[0, 5] = -s23 * (d2 * d2 + d3 * d3)
    y[0, 6] = -s2 * d2 * d2
    y[0, 8] = -s3 * d3 * d3
    y[0, 10] = d1
    y[1, 3] = -s3 * (d1 + d2) * d3
    y[1, 5] = s23 * d1 * d1
    y[1, 6] = s2 * d1 * d1
    y[1, 8] = -s3 * d3 * d3
    y[1, 10] = d2
    y[2, 3] = s3 * d1 * d2
    y[2, 5] = s23 * d1 * d1
    y[2, 8] = s3 * (d1 * d1 + d2 * d2)
    y[2, 10] = d3
    return y


@jit
def three_link_X(q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
                 alpha_dot: np.ndarray) -> np.ndarray:
    """Equation (51): X θ = M α̇ + C q̇ + F q̇ − ½ Ṁ (q̇ − α), shape (3, 11).

    Y1 is linear in its velocity, so M α̇ is Y1(q, α̇), and −½ Ṁ e2 is Y1 with the cosines replaced
    by their derivatives at −½ e2.
    """
    x = three_link_Y1(q, alpha_dot) + _centripetal(q, qd)
    d23 = qd[1] + qd[2]
    h2 = 0.5 * np.sin(q[1]) * qd[1]
    h3 = 0.5 * np.sin(q[2]) * qd[2]
    h23 = 0.5 * np.sin(q[1] + q[2]) * d23
    e = qd - alpha
    x[0, 1] += h23 * e[0]
    x[0, 2] += h2 * e[0]
    x[0, 3] += h3 * (e[0] + e[1])
    x[0, 5] += h23 * (e[1] + e[2])
    x[0, 6] += h2 * e[1]
    x[0, 8] += h3 * e[2]
    x[1, 3] += h3 * e[0]
    x[1, 5] += h23 * e[0]
    x[1, 6] += h2 * e[0]
    x[1, 8] += h3 * e[2]
    x[1, 9] += h3 * e[1]
    x[2, 5] += h23 * e[0]
    x[2, 8] += h3 * (e[0] + e[1])
    return x


@jit
def three_link_acceleration(q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
                            theta: np.ndarray) -> np.ndarray:
    """Equation (47): q̈ = M⁻¹(τ − N − F q̇), shape (3,) [rad/s²], by cofactors."""
    m = three_link_mass(q, theta)
    b = tau - product(_centripetal(q, qd), theta)
    a, d, f = m[0, 0], m[1, 1], m[2, 2]
    u, v, w = m[0, 1], m[0, 2], m[1, 2]
    c11, c12, c13 = d * f - w * w, v * w - u * f, u * w - v * d
    c22, c23, c33 = a * f - v * v, u * v - a * w, a * d - u * u
    determinant = a * c11 + u * c12 + v * c13
    qdd = np.empty(3)
    qdd[0] = (c11 * b[0] + c12 * b[1] + c13 * b[2]) / determinant
    qdd[1] = (c12 * b[0] + c22 * b[1] + c23 * b[2]) / determinant
    qdd[2] = (c13 * b[0] + c23 * b[1] + c33 * b[2]) / determinant
    return qdd


class ThreeLinkArrays(NamedTuple):
    """The arm as compiled functions take it: all there is to know is its number of parameters."""

    parameters: int


@jit
def _regressors(arm: ThreeLinkArrays, q: np.ndarray,
                qd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return three_link_Y12(q, qd)


@jit
def _law_regressor(arm: ThreeLinkArrays, q: np.ndarray, qd: np.ndarray, alpha: np.ndarray,
                   alpha_dot: np.ndarray) -> np.ndarray:
    return three_link_X(q, qd, alpha, alpha_dot)


regressors.register(ThreeLinkArrays, _regressors)
law_regressor.register(ThreeLinkArrays, _law_regressor)


class _TrueThreeLink(NamedTuple):
    theta: np.ndarray


@jit
def _true_acceleration(arm: _TrueThreeLink, q: np.ndarray, qd: np.ndarray,
                       tau: np.ndarray) -> np.ndarray:
    return three_link_acceleration(q, qd, tau, arm.theta)


acceleration.register(_TrueThreeLink, _true_acceleration)


def _smallest_eigenvalue(theta: np.ndarray) -> float:
    # M depends on two cosines and the cosine of their sum only: a grid of 5 degrees over both.
    angles = np.arange(0.0, 2.0 * np.pi, np.pi / 36.0)
    masses = np.array([three_link_mass(np.array([0.0, q2, q3]), theta)
                       for q2 in angles for q3 in angles])
    return float(np.linalg.eigvalsh(masses)[:, 0].min())


def _check_mass_matrix(theta: np.ndarray) -> None:
    smallest = _smallest_eigenvalue(theta)
    if not smallest > 0.0:
        raise ArmError(f'three_link: the inertia matrix of p1 to p10 = {theta[:10].tolist()} is '
                       f'not positive definite for every posture: smallest eigenvalue '
                       f'{smallest:.3g}')


class ThreeLinkArm(PlanarArm):
    """Planar 3-DoF arm without gravity, θ = (p1, …, p10, f) (48).

    Its regressors are those of (49) to (51).
    """

    _regressors = PlanarRegressors(three_link_Y1, three_link_Y2, three_link_Y12, three_link_X)

    @checked_call
    def __init__(self, joints: Sequence[str] = ('joint1', 'joint2', 'joint3'), **others: Any,
                 ) -> None:
        """Name the joints; ArmError unless there are exactly three distinct names.

        Args:
            joints: Their names.
            others: Not used; another name is refused with the one that is meant.
        """
        refuse_lengths(type(self), others)
        super().__init__('three_link', joints, 3)
        self.parameters = (*(f'p{i}' for i in range(1, 11)), 'f')
        self.nominal = three_link_parameters()
        self.payload_direction: np.ndarray | None = three_link_parameters(1.0) - self.nominal

    @property
    def arrays(self) -> ThreeLinkArrays:
        """The arm as compiled functions take it, see `arms.regressors`."""
        return ThreeLinkArrays(self.m)

    @checked_call
    def dynamics(self, theta: np.ndarray) -> ForwardDynamics:
        """Forward dynamics; ArmError where M(q) would not be positive definite."""
        theta = checked_theta('theta', theta, self.parameters)
        _check_mass_matrix(theta)
        return CompiledDynamics(_TrueThreeLink(theta.copy()), self.joints)

    def link_points(self, q: np.ndarray) -> np.ndarray:
        """Base, both inner joints and the tip at joint positions q, shape (4, 3) [m]."""
        return planar_points(q, LENGTHS)
