# SPDX-License-Identifier: Apache-2.0
"""What each link of a URDF arm weighs on each joint, under gravity along each axis."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_model import JointOrder, load_pinocchio, with_gravity

__all__ = ['LinkWeights']


class LinkWeights:
    """Torques at rest of the links of an arm, linear in gravity."""

    def __init__(self, arm: UrdfArm) -> None:
        """Take an arm with the inertial parameters of its URDF."""
        self._order = JointOrder(arm.model, arm.joints)
        self._models = [with_gravity(arm.model, axis) for axis in np.eye(3)]
        self._data = arm.model.createData()
        self._inertial = arm.inertial[np.argsort(self._order.rows)]
        self._rest = np.zeros(arm.n)

    def at(self, q: np.ndarray) -> np.ndarray:
        """Return the torque that holds joint i against link k, per unit of gravity along axis a.

        Args:
            q: Posture, shape (n,) [rad].

        Returns:
            Shape (a, i, k) = (3, n, n) [N·m per m/s²]; links in the order of the tree.
        """
        regressor = load_pinocchio().computeJointTorqueRegressor
        place, n = self._order.position(q), self._rest.size
        rows = np.array([regressor(model, self._data, place, self._rest, self._rest)
                         for model in self._models]).reshape(3, n, n, PER_BODY)
        return np.asarray(np.einsum('aikp,kp->aik', rows, self._inertial)[:, self._order.rows])
