# SPDX-License-Identifier: Apache-2.0
"""The arm that is to be configured, with the friction and rotors that are stated of it."""

from __future__ import annotations

from collections.abc import Sequence

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_source import UrdfSource
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.tuning.robot import per_joint

__all__ = ['arm_with_friction']


def arm_with_friction(urdf: UrdfSource, joints: Sequence[str] | None = None, *,
                      coulomb: bool | None = None,
                      rotor_inertia: bool | Sequence[float] = False) -> UrdfArm:
    """Return the arm of a URDF with what is learned of it.

    Args:
        urdf: As `load_arm` takes it.
        joints: Likewise.
        coulomb: Whether a Coulomb friction per joint is learned; None: where the URDF states any
            (``<dynamics friction>``), as a model without it would explain it by masses.
        rotor_inertia: Whether the inertia of each rotor is; numbers are learned as well, and are
            what learning and gains begin with, one for all joints or one for each [kg·m²].

    Raises:
        ArmError: no arm can be made of the URDF and the joints.
        ParameterError: the stated inertias are no finite numbers >= 0, or not one per joint.
        MissingExtra: Pinocchio, which reads the URDF, is not installed.
    """
    if coulomb is None:
        arm = load_arm(urdf, joints, coulomb=True)
        coulomb = bool(arm.friction(arm.nominal)[1].any())
    stated = () if isinstance(rotor_inertia, bool) else tuple(rotor_inertia)
    arm = load_arm(urdf, joints, coulomb=coulomb, rotor_inertia=rotor_inertia is not False)
    if not stated:
        return arm
    inertias = per_joint('--rotor-inertia', stated, arm)
    if inertias.min() < 0.0:
        raise ParameterError('--rotor-inertia', list(stated), 'inertias >= 0 kg·m²')
    return load_arm(urdf, joints, coulomb=coulomb, rotor_inertia=True, rotor=inertias)
