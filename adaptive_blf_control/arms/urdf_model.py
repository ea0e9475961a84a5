# SPDX-License-Identifier: Apache-2.0
"""Pinocchio models of a sub-chain of a URDF, and joint arrays in the order of the user."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptive_blf_control.arms.urdf_source import select_joints, urdf_joints
from adaptive_blf_control.errors import ArmError, MissingExtra

__all__ = ['JointOrder', 'load_pinocchio', 'reduced_model', 'with_gravity']


def load_pinocchio() -> Any:
    """Import Pinocchio, which only the URDF arm needs.

    Raises:
        MissingExtra: If it is not installed.
    """
    try:
        import pinocchio
    except ImportError as error:
        raise MissingExtra('pinocchio', 'urdf', 'an arm from a URDF') from error
    return pinocchio


def reduced_model(xml: str, joints: Sequence[str] | None) -> tuple[Any, tuple[str, ...]]:
    """Build the model of the chosen joints; all others are locked at zero, inertias merged.

    Args:
        xml: URDF text.
        joints: Names in the order the arm shall use, or None for all that can be driven, from
            the base outwards.

    Returns:
        The Pinocchio model (in the tree's order) and the names in the order asked for.

    Raises:
        ArmError: If the URDF cannot be read, a joint cannot be used, or a joint moves no mass.
    """
    pin = load_pinocchio()
    names = select_joints(urdf_joints(xml), joints)
    try:
        full = pin.buildModelFromXML(xml)
    except Exception as error:  # the binding may raise any type for a C++ exception
        raise ArmError(f'Pinocchio cannot read this URDF: {error}') from error
    locked = [i for i in range(1, full.njoints) if full.names[i] not in names]
    model = pin.buildReducedModel(full, locked, pin.neutral(full)) if locked else full
    if joints is None:
        names = tuple(list(model.names)[1:])  # from the base outwards
    standard = np.array([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])
    if not np.all(np.isfinite(standard)):
        raise ArmError('URDF has an inertia that is not finite')
    if not np.any(standard):
        raise ArmError('URDF gives no inertia to any moving link of this arm: every <link> that '
                       'moves needs <inertial> with a mass')
    for i in range(1, model.njoints):
        if not any(np.any(standard[j - 1]) for j in model.subtrees[i]):
            raise ArmError(f'no link behind joint {model.names[i]!r} has an inertia')
    return model, names


def with_gravity(model: Any, gravity: np.ndarray) -> Any:
    """Copy a model with another gravity, shape (3,) [m/s²]."""
    copy = model.copy()
    copy.gravity.linear = gravity
    return copy


class JointOrder:
    """Translate between the user's joint arrays and Pinocchio's.

    Pinocchio orders joints along the tree and writes a continuous joint as (cos q, sin q).

    Attributes:
        rows: Pinocchio's velocity index of each of the user's joints, shape (n,).
        continuous: Whether each of the user's joints is continuous, shape (n,).
    """

    def __init__(self, model: Any, names: Sequence[str]) -> None:
        """Look up the user's joints, all of the model's, in a Pinocchio model."""
        joints = [model.joints[model.getJointId(name)] for name in names]
        self.rows = np.array([joint.idx_v for joint in joints], dtype=np.intp)
        self.continuous = np.array([joint.nq == 2 for joint in joints])
        self._position = np.array([joint.idx_q for joint in joints], dtype=np.intp)
        self._nq = int(model.nq)
        self._identity = bool(np.all(self.rows == np.arange(len(joints))))
        self._inverse = np.argsort(self.rows)
        self._wraps = bool(self.continuous.any())

    def position(self, q: np.ndarray) -> np.ndarray:
        """Return Pinocchio's configuration of joint positions q, shape (n,) → (nq,)."""
        if not self._wraps:
            return q if self._identity else q[self._inverse]
        configuration = np.empty(self._nq)
        configuration[self._position] = np.where(self.continuous, np.cos(q), q)
        turning = self.continuous
        configuration[self._position[turning] + 1] = np.sin(q[turning])
        return configuration

    def velocity(self, v: np.ndarray) -> np.ndarray:
        """Return a joint velocity, acceleration or torque in Pinocchio's order, shape (n,)."""
        return v if self._identity else v[self._inverse]

    def limits(self, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return position limits in the user's order; infinite where the URDF gives none."""
        low, high = lower[self._position], upper[self._position]
        free = self.continuous | ~(low < high)
        return np.where(free, -np.inf, low), np.where(free, np.inf, high)
