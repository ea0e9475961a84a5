# SPDX-License-Identifier: Apache-2.0
"""The inertia that each joint of an arm sees along a reference."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.reference import Reference

__all__ = ['COUNT', 'ReferenceStates', 'SeenInertia', 'damping_rate', 'known_masses',
           'mass_matrices', 'reference_states', 'seen_inertia', 'viscous_friction']

COUNT, SPAN = 200, 60.0  # postures that are looked at, over so many seconds of the reference


class ReferenceStates(NamedTuple):
    """States along a reference: positions [rad], velocities [rad/s], accelerations [rad/s²].

    Each of shape (K, n).
    """

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray


class SeenInertia(NamedTuple):
    """What the joints see; arrays of shape (n,).

    Attributes:
        least: min 1/(M⁻¹)_ii, with the other joints free to give way [kg·m²].
        most: max M_ii, with the other joints held [kg·m²].
        coupling: max λ_max(M⁻¹ diag(least)), from 1 for joints that do not feel each other to n:
            with k2_i ≤ λ least_i/coupling for every joint, λ_max(M⁻¹ K2) ≤ λ.
    """

    least: np.ndarray
    most: np.ndarray
    coupling: float


def reference_states(reference: Reference, count: int = COUNT,
                     span: float = SPAN) -> ReferenceStates:
    """Return ``count`` states of the first ``span`` [s] of a reference."""
    points = [reference.at(float(t)) for t in np.linspace(0.0, span, count)]
    return ReferenceStates(*(np.array(column) for column in zip(*points)))


def mass_matrices(arm: Arm, theta: np.ndarray, postures: np.ndarray) -> np.ndarray:
    """Return M(q) of ``theta`` (m,) at postures (K, n), shape (K, n, n) [kg·m²]."""
    units = np.eye(arm.n)
    rows = np.array([[arm.Y1(q, unit) @ theta for unit in units] for q in postures])
    return np.asarray(0.5 * (rows + rows.transpose(0, 2, 1)))


def known_masses(arm: Arm, theta: np.ndarray,
                 postures: np.ndarray) -> tuple[str, np.ndarray] | None:
    """Return M(q) of the first model that has an inertia in every posture, and its name.

    That is the ``estimate`` ``theta``, else the ``nominal`` arm; None where neither has. An
    estimate is often no arm at all: θ̂(0) = 0 has no inertia.
    """
    nominal = getattr(arm, 'nominal', np.zeros(arm.m))  # an arm that is not simulated needs none
    for name, model in (('estimate', theta), ('nominal', nominal)):
        masses = mass_matrices(arm, model, postures)
        if np.isfinite(masses).all() and np.linalg.eigvalsh(masses)[:, 0].min() > 0.0:
            return name, masses
    return None


def seen_inertia(masses: np.ndarray) -> SeenInertia:
    """Return what the joints see in postures with the mass matrices (K, n, n) [kg·m²]."""
    inverse = np.linalg.inv(masses)
    least = 1.0 / np.diagonal(inverse, axis1=1, axis2=2).max(axis=0)
    most = np.diagonal(masses, axis1=1, axis2=2).max(axis=0)
    return SeenInertia(least, most, damping_rate(masses, least))


def damping_rate(masses: np.ndarray, gains: np.ndarray) -> float:
    """Return max λ_max(M⁻¹ diag(gains)) over postures [1/s], gains ≥ 0 of shape (n,)."""
    root = np.sqrt(gains)
    symmetric = root[:, None] * np.linalg.inv(masses) * root
    return float(np.linalg.eigvalsh(symmetric)[:, -1].max())


def viscous_friction(arm: Arm, theta: np.ndarray) -> np.ndarray:
    """Return the viscous coefficients among ``theta`` (m,), shape (n,) [N·m·s/rad]; 0: none."""
    by_name = dict(zip(arm.parameters, theta.tolist()))
    return np.array([max(by_name.get(f'fv_{joint}', 0.0), 0.0) for joint in arm.joints])
