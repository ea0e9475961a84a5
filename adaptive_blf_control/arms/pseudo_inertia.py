# SPDX-License-Identifier: Apache-2.0
"""Pseudo-inertias: the mass distribution of a body as one symmetric 4x4 matrix.

P = ∫ [x; 1] [x; 1]ᵀ dm = [Σ h; hᵀ m], with Σ = ½ tr(I) 1 − I the second and h the first moment of
mass about the frame's origin. Ten inertial parameters belong to a rigid body, with a mass density
that is nowhere negative, if and only if P is positive semi-definite: physical consistency, with
the triangle inequalities of the principal moments included. P is linear in them: Wensing, Kim,
Slotine, Linear Matrix Inequalities for Physically Consistent Inertial Parameter Identification
(RA-L 2018), (12), (13).
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.base_parameters import INERTIAL_NAMES, PER_BODY

__all__ = ['BASIS', 'GYRATION', 'feasible', 'inertial_parameters', 'pseudo_inertias']

GYRATION = 0.03
"""Least radius of gyration of a link [m] where its description gives none: links of arms that
carry a drive are not thinner, and a prior on its boundary would allow no change at all."""
_MASS = 1.0  # kg, of a link that is described without any


def _basis() -> np.ndarray:
    basis = np.zeros((PER_BODY, 4, 4))
    basis[0, 3, 3] = 1.0
    for axis in range(3):
        basis[1 + axis, axis, 3] = basis[1 + axis, 3, axis] = 1.0
    for k, name in enumerate(INERTIAL_NAMES[4:], start=4):
        a, b = ('xyz'.index(letter) for letter in name[1:])
        if a == b:
            basis[k, :3, :3] += 0.5 * np.eye(3)
            basis[k, a, a] -= 1.0
        else:
            basis[k, a, b] = basis[k, b, a] = -1.0
    return basis


BASIS = _basis()
"""P = Σ_k π_k BASIS[k] for the ten inertial parameters π of a body, shape (10, 4, 4)."""


def pseudo_inertias(inertial: np.ndarray) -> np.ndarray:
    """Return the pseudo-inertia of each body, (n, 10) → (n, 4, 4) [kg·m², kg·m, kg]."""
    return np.tensordot(inertial, BASIS, axes=1)


def inertial_parameters(pseudo: np.ndarray) -> np.ndarray:
    """Return the ten inertial parameters of each body, (n, 4, 4) → (n, 10)."""
    second = pseudo[:, :3, :3]
    inertia = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second
    lower = np.array([[0, 0], [1, 0], [1, 1], [2, 0], [2, 1], [2, 2]])
    return np.column_stack([pseudo[:, 3, 3], pseudo[:, :3, 3], inertia[:, lower[:, 0],
                                                                       lower[:, 1]]])


def feasible(pseudo: np.ndarray, gyration: float = GYRATION) -> np.ndarray:
    """Return positive definite pseudo-inertias near given ones, (n, 4, 4) → (n, 4, 4).

    Mass and centre of mass stay. About the centre of mass the second moments become at least
    ``gyration``² times the mass along every axis. A body without mass becomes a ball of 1 kg at
    its frame's origin.

    Args:
        pseudo: Of any definiteness, e.g. of a URDF.
        gyration: Least radius of gyration [m].
    """
    result = np.empty_like(pseudo)
    for body, given in zip(result, pseudo, strict=True):
        mass = given[3, 3] if given[3, 3] > 0.0 else _MASS
        centre = given[:3, 3] / mass if given[3, 3] > 0.0 else np.zeros(3)
        outer = mass * np.outer(centre, centre)
        values, vectors = np.linalg.eigh(given[:3, :3] - outer if given[3, 3] > 0.0
                                         else np.zeros((3, 3)))
        values = np.maximum(values, mass * gyration ** 2)
        body[:3, :3] = (vectors * values) @ vectors.T + outer
        body[:3, 3] = body[3, :3] = mass * centre
        body[3, 3] = mass
    return result
