# SPDX-License-Identifier: Apache-2.0
"""Forces on the links of a simulated arm, and what they do to its joints."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_model import JointOrder, load_pinocchio
from adaptive_blf_control.simulation.targets import AXES, FORCE, Target

__all__ = ['UrdfLinks', 'Wrenches']


class Wrenches:
    """Force and moment at the origin of each link that is pushed, axes of the base.

    Attributes:
        by_link: (f, m) of shape (6,) [N, N·m] by the link's name; only those that are not zero.
    """

    def __init__(self) -> None:
        """Start without any."""
        self.by_link: dict[str, np.ndarray] = {}

    def set(self, target: Target, value: float) -> None:
        """Set one component, ``force.LINK.x`` [N] or ``torque.LINK.x`` [N·m]."""
        wrench = self.by_link.setdefault(target.name, np.zeros(6))
        wrench[(0 if target.kind == FORCE else 3) + AXES.index(target.component)] = value
        if not wrench.any():
            del self.by_link[target.name]


class UrdfLinks:
    """The links of an arm, as Pinocchio knows them.

    Attributes:
        names: Names of the links; none where the arm is not from a URDF.
    """

    def __init__(self, arm: Arm) -> None:
        """Look up the links of an arm."""
        self.names: tuple[str, ...] = ()
        if isinstance(arm, UrdfArm):
            self._pin, self._model = load_pinocchio(), arm.model
            self._data, self._order = arm.model.createData(), JointOrder(arm.model, arm.joints)
            self._frames = {frame.name: i for i, frame in enumerate(arm.model.frames)
                            if frame.type == self._pin.FrameType.BODY and frame.parentJoint > 0}
            self.names = tuple(self._frames)

    def torque(self, q: np.ndarray, wrenches: Wrenches) -> np.ndarray:
        """Return Σ Jᵀ (f, m) over the links, shape (n,) [N·m].

        Args:
            q: Joint positions, shape (n,) [rad].
            wrenches: Of links among ``names``.
        """
        result = np.zeros(q.size)
        configuration = self._order.position(q)
        for link, wrench in wrenches.by_link.items():
            jacobian = self._pin.computeFrameJacobian(
                self._model, self._data, configuration, self._frames[link],
                self._pin.ReferenceFrame.LOCAL_WORLD_ALIGNED).reshape(6, -1)
            result += jacobian[:, self._order.rows].T @ wrench
        return result
