# SPDX-License-Identifier: Apache-2.0
"""The load that explains what a torque is more than a model says.

With r = τ_f − Y_f θ0 of a model θ0 without the load, r = L π + e, where L = Y_f A has a column for
each of the load's ten inertial parameters π (`arms.load_frame`). Over a span of time each joint
j needs only the integral of [L_j r_j]ᵀ [L_j r_j], its *sums*. Errors of variance s_j² that are
alike for a time T_j make an integral over time worth 1 / (2 T_j s_j²) per second, and

    min ½ Σ_j ∫ (L_j π − r_j)² dt / (2 T_j s_j²) + tr(P P0⁻¹) − log det P

is the maximum a posteriori estimate over the loads that a body can be, P ≻ 0 (`log_det_fit`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.pseudo_inertia import inertial_parameters
from adaptive_blf_control.identification.log_det_fit import log_det_fit, Positive

__all__ = ['Load', 'described', 'fit_load', 'squares', 'sums_of']

_NOTHING = Positive(np.zeros(0, dtype=int), np.zeros(0), np.zeros(0))
_LOWER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))  # order of the ten parameters


class Load(NamedTuple):
    """A body at a frame.

    Attributes:
        mass: [kg].
        com: Centre of mass in the frame, shape (3,) [m].
        inertia: About the centre of mass in axes of the frame, Ixx, Ixy, Iyy, Ixz, Iyz, Izz,
            shape (6,) [kg·m²].
    """

    mass: float
    com: np.ndarray
    inertia: np.ndarray

    @property
    def vector(self) -> np.ndarray:
        """All of it, shape (10,)."""
        return np.concatenate([[self.mass], self.com, self.inertia])


def sums_of(columns: np.ndarray, residuals: np.ndarray, intervals: np.ndarray) -> np.ndarray:
    """Return the sums of samples, shape (n, 11, 11).

    Args:
        columns: L, shape (N, n, 10).
        residuals: r, shape (N, n) [N·m].
        intervals: Time that each sample stands for, shape (N,) [s].
    """
    rows = np.concatenate([columns, residuals[..., None]], axis=2).transpose(1, 0, 2)
    result: np.ndarray = (rows * intervals[:, None]).transpose(0, 2, 1) @ rows
    return result


def squares(sums: np.ndarray, inertial: np.ndarray) -> np.ndarray:
    """Return ∫ (L π − r)² dt of sums, shape (..., 11, 11) → (...)."""
    error = np.append(inertial, -1.0)
    return np.maximum(error @ sums @ error, 0.0)


def fit_load(weighted: np.ndarray, prior: np.ndarray, start: np.ndarray | None = None,
             ) -> np.ndarray:
    """Return the ten inertial parameters of the module's docstring, shape (10,).

    Args:
        weighted: Σ_j sums_j / (2 T_j s_j²), shape (11, 11).
        prior: P0, positive definite, shape (4, 4).
        start: Parameters of a possible body to start from, shape (10,); those of P0 where None.
    """
    start = inertial_parameters(prior[None])[0] if start is None else start
    return log_det_fit(weighted[:PER_BODY, :PER_BODY], weighted[:PER_BODY, PER_BODY],
                       prior[None], _NOTHING, start).x


def described(inertial: np.ndarray, covariance: np.ndarray) -> tuple[Load, Load]:
    """Return a load of ten inertial parameters, and the standard deviations of all of it.

    Args:
        inertial: π, with a mass > 0, shape (10,).
        covariance: Of π, shape (10, 10).
    """
    mass, first = float(inertial[0]), inertial[1:4]
    com = first / mass
    steiner = np.outer(com, com) - com @ com * np.eye(3)  # d(inertia about com)/d(mass) is −this
    change = np.zeros((PER_BODY, PER_BODY))
    change[0, 0] = 1.0
    change[1:4, 0], change[1:4, 1:4] = -com / mass, np.eye(3) / mass
    inertia = np.zeros(6)
    for k, (a, b) in enumerate(_LOWER):
        change[4 + k, 4 + k] = 1.0
        inertia[k] = inertial[4 + k] + mass * steiner[a, b]
        change[4 + k, 0] = -steiner[a, b]
        slope = -2.0 * com * (a == b)
        slope[a] += com[b]
        slope[b] += com[a]
        change[4 + k, 1:4] = slope
    std = np.sqrt(np.maximum(np.diag(change @ covariance @ change.T), 0.0))
    return Load(mass, com, inertia), Load(float(std[0]), std[1:4], std[4:])
