# SPDX-License-Identifier: Apache-2.0
"""The arm that is to be configured, with the Coulomb friction that its URDF states."""

from __future__ import annotations

from collections.abc import Sequence

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_source import UrdfSource

__all__ = ['arm_with_friction']


def arm_with_friction(urdf: UrdfSource, joints: Sequence[str] | None = None, *,
                      coulomb: bool | None = None, rotor_inertia: bool = False) -> UrdfArm:
    """Return the arm of a URDF with what is learned of it.

    Args:
        urdf: As `load_arm` takes it.
        joints: Likewise.
        coulomb: Whether a Coulomb friction per joint is learned; None: where the URDF states any
            (``<dynamics friction>``), as a model without it would explain it by masses.
        rotor_inertia: Whether the inertia of each rotor is.

    Raises:
        ArmError: no arm can be made of the URDF and the joints.
        MissingExtra: Pinocchio, which reads the URDF, is not installed.
    """
    if coulomb is None:
        arm = load_arm(urdf, joints, coulomb=True)
        coulomb = bool(arm.friction(arm.nominal)[1].any())
    return load_arm(urdf, joints, coulomb=coulomb, rotor_inertia=rotor_inertia)
