# SPDX-License-Identifier: Apache-2.0
"""The physically consistent model: parameters that rigid bodies and passive joints can have.

θ̂ is free to be the best fit, and where data say little it is no robot: its mass matrix can be
indefinite. The consistent model is the maximum a posteriori estimate from the same recorded pairs,

    min ½ Σ_j w_j ‖Y_j θ(x) − τ_j‖² + Σ_i [tr(P_i P0_i⁻¹) − log det P_i] + barriers,

over the pseudo-inertias P_i ≻ 0 of all links, rotor inertias > 0 and friction > 0 (`log_det_fit`).
w_j = 1/(s_j² c_j): s_j is the RMS residual of joint j, so that joints count by how well they can
be explained, and c_j how many recorded pairs count as one because their residuals are alike. P0 is
the URDF's: what no data contradict stays as it was described.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol, TypeGuard

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.pseudo_inertia import (
    feasible,
    inertial_parameters,
    pseudo_inertias,
)
from adaptive_blf_control.identification.log_det_fit import log_det_fit, LogDetFit, Positive

__all__ = ['ConsistentModel', 'InertialArm', 'consistent_model', 'has_links']

_WEAK = 1e-3  # strength of the priors of rotor and friction, of which a URDF says little
_ROTOR = 0.1  # of the inertia that the joint moves, where no rotor is described
_FRICTION = 0.05  # of the RMS torque, at 1 rad/s, where no friction is described
_REWEIGHTINGS = 3
_LEAST_SHARE = 0.01  # of the largest residual: below it a joint counts no more
_SHARE = 0.5  # of its prior variance that data have to remove from a parameter
_LEAST_RELATIVE = 1e-4  # of its RMS torque: no model of a robot is better


class InertialArm(Protocol):
    """An arm whose θ comes from inertial parameters of links, as `arms.urdf:UrdfArm`.

    See there; every array is in the order of the joints.
    """

    parameters: tuple[str, ...]
    nominal: np.ndarray
    inertial: np.ndarray
    rotor: np.ndarray
    base_from_standard: np.ndarray
    base_from_rotor: np.ndarray
    dissipates: np.ndarray

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return the nominal M(q), shape (n, n) [kg·m²]."""
        ...


def has_links(arm: object) -> TypeGuard[InertialArm]:
    """Return whether an arm knows the inertial parameters of its links."""
    return all(hasattr(arm, name) for name in (
        'inertial', 'rotor', 'base_from_standard', 'base_from_rotor', 'dissipates'))


class ConsistentModel(NamedTuple):
    """A model that a robot can have.

    Attributes:
        parameters: Names of the parameters.
        theta: Shape (m,).
        inertial: Ten inertial parameters per joint of the body that it moves, shape (n, 10).
        rotor: Inertia of each joint's rotor, seen from the joint, shape (n,) [kg·m²].
        std: Standard deviation of each parameter under data and prior together, shape (m,).
        share: Part of the variance that the description leaves each parameter and that the data
            remove, shape (m,), 0 (as described) to 1 (as measured).
        kept: Names of the parameters with a share below one half: they are the URDF's.
        steps: Newton steps it took.
    """

    parameters: tuple[str, ...]
    theta: np.ndarray
    inertial: np.ndarray
    rotor: np.ndarray
    std: np.ndarray
    share: np.ndarray
    kept: tuple[str, ...]
    steps: int

    @property
    def estimate(self) -> dict[str, float]:
        """Parameters by name."""
        return dict(zip(self.parameters, self.theta.tolist(), strict=True))


class _Moments(NamedTuple):
    """Per joint Σ Y_jᵀ Y_j, shape (n, m, m), and Σ Y_jᵀ τ_j, shape (n, m)."""

    gram: np.ndarray
    moment: np.ndarray

    def weighted(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Σ_j w_j Y_jᵀ Y_j and Σ_j w_j Y_jᵀ τ_j."""
        return np.tensordot(weights, self.gram, axes=1), weights @ self.moment


def consistent_model(arm: InertialArm, regressors: np.ndarray, torques: np.ndarray,
                     alike: np.ndarray | float = 1.0) -> ConsistentModel:
    """Find the physically consistent model of recorded pairs.

    Args:
        arm: The arm that the pairs belong to.
        regressors: Y_f of the recorded pairs, shape (P, n, m).
        torques: τ_f of the recorded pairs, shape (P, n) [N·m].
        alike: c_j, how many pairs count as one because their residuals are alike, ≥ 1, scalar or
            shape (n,); see `uncertainty.alike`.
    """
    rows = np.ascontiguousarray(regressors.transpose(1, 0, 2))
    columns = rows.transpose(0, 2, 1)
    moments = _Moments(columns @ rows, np.einsum('jmp,pj->jm', columns, torques))
    residual = _residual_scale(moments, regressors, torques)
    gram, moment = moments.weighted(1.0 / (residual ** 2 * alike))
    into = _parameters_from_physical(arm)
    level = np.sqrt(np.mean(torques ** 2, axis=0)) + residual
    start, positive, curvature = _priors(arm, level)
    data = into.T @ gram @ into
    fit = log_det_fit(data + np.diag(curvature), into.T @ moment + curvature * start,
                      pseudo_inertias(_links(start, arm)), positive, start)
    described = fit.prior + np.diag(curvature)
    before, after = (_variance(into, precision) for precision in (described, described + data))
    return _model(arm, into, fit, np.clip(1.0 - after / before, 0.0, 1.0))


def _residual_scale(moments: _Moments, regressors: np.ndarray,
                    torques: np.ndarray) -> np.ndarray:
    """Return the RMS residual of each joint under weighted least squares, shape (n,) [N·m]."""
    level = np.sqrt(np.mean(torques ** 2, axis=0))
    freedom = max(1.0 - moments.moment.shape[1] / max(torques.size, 1), 0.1)
    scale = np.ones(torques.shape[1])
    for _ in range(_REWEIGHTINGS):
        theta = _least_squares(*moments.weighted(scale ** -2))
        residual = regressors @ theta - torques
        scale = np.sqrt(np.mean(residual ** 2, axis=0) / freedom)
        scale = np.maximum(scale, np.maximum(_LEAST_SHARE * scale.max(),
                                             _LEAST_RELATIVE * level) + 1e-9)
    return scale


def _least_squares(gram: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Solve Q θ = g with columns scaled to length one; open directions stay zero."""
    scale = np.sqrt(np.diag(gram))
    scale = np.where(scale > 0.0, scale, 1.0)
    inverse = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    result: np.ndarray = inverse @ (moment / scale) / scale
    return result


def _parameters_from_physical(arm: InertialArm) -> np.ndarray:
    """Return the map from x = (inertial parameters, rotors, friction) to θ, shape (m, p)."""
    base, inertial = arm.base_from_standard.shape
    friction = len(arm.nominal) - base
    rotors = arm.base_from_rotor if arm.base_from_rotor.any() else np.zeros((base, 0))
    result = np.zeros((base + friction, inertial + rotors.shape[1] + friction))
    result[:base, :inertial] = arm.base_from_standard
    result[:base, inertial:inertial + rotors.shape[1]] = rotors
    result[base:, inertial + rotors.shape[1]:] = np.eye(friction)
    return result


def _links(x: np.ndarray, arm: InertialArm) -> np.ndarray:
    """Return the inertial parameters in x, shape (n, 10)."""
    return x[:arm.inertial.size].reshape(-1, PER_BODY)


def _priors(arm: InertialArm, level: np.ndarray,
            ) -> tuple[np.ndarray, Positive, np.ndarray]:
    """Return x of the description, what has to be positive in it, and the curvature of the rest.

    Friction that is not described counts as a part of the measured torque at 1 rad/s; a constant
    torque may be as large as all of it.
    """
    n, links = len(level), inertial_parameters(feasible(pseudo_inertias(arm.inertial)))
    rotor = np.zeros(0)
    if arm.base_from_rotor.any():
        moved = np.diag(arm.mass_matrix(np.zeros(n)))
        rotor = np.where(arm.rotor > 0.0, arm.rotor, _ROTOR * np.maximum(moved, 1e-6))
    friction = arm.nominal[arm.base_from_standard.shape[0]:]
    each = friction.size // n
    small = np.where(friction > 0.0, friction, _FRICTION * np.tile(level, each))
    friction = np.where(arm.dissipates, small, friction)
    start = np.concatenate([links.ravel(), rotor, friction])
    place = np.concatenate([links.size + np.arange(rotor.size),
                            links.size + rotor.size + np.flatnonzero(arm.dissipates)])
    curvature = np.zeros(start.size)
    curvature[links.size + rotor.size:] = np.where(arm.dissipates, 0.0,
                                                   np.tile(level, each) ** -2.0)
    return start, Positive(place, start[place], np.full(place.size, _WEAK)), curvature


def _model(arm: InertialArm, into: np.ndarray, fit: LogDetFit,
           share: np.ndarray) -> ConsistentModel:
    links, rotors = arm.inertial.size, arm.rotor.size
    learned = bool(arm.base_from_rotor.any())
    return ConsistentModel(
        arm.parameters, into @ fit.x, _links(fit.x, arm),
        fit.x[links:links + rotors] if learned else arm.rotor,
        np.sqrt(_variance(into, fit.hessian)), share,
        tuple(name for name, part in zip(arm.parameters, share, strict=True) if part < _SHARE),
        fit.steps)


def _variance(into: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return the variance of each parameter where x has this inverse covariance, shape (m,)."""
    scale = 1.0 / np.sqrt(np.diag(precision))
    rows = into * scale
    covariance = np.linalg.pinv(precision * np.outer(scale, scale), rcond=1e-15, hermitian=True)
    return np.maximum(np.sum((rows @ covariance) * rows, axis=1), 0.0)
