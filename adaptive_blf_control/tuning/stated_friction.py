# SPDX-License-Identifier: Apache-2.0
"""The arm that is to be configured, with the friction and rotors that are stated of it."""

from __future__ import annotations

from collections.abc import Sequence

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_source import UrdfSource
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.tuning.robot import per_joint, Robot
from adaptive_blf_control.tuning.sensing import measured_velocity_noise

__all__ = ['arm_with_friction', 'sliding_velocity']

NARROWEST, WIDEST = 0.01, 0.02  # rad/s
CLEAR = 6.0  # standard deviations of the measured velocity above which a sign is certain


def sliding_velocity(robot: Robot) -> float:
    """Return v_s of tanh(q̇/v_s) for the sensors of a robot [rad/s].

    Dry friction changes its sign at once, and what tanh lacks of it around standstill no θ can
    make up for; but the compensation must not follow the noise of the measured velocity.
    """
    noise = 0.0 if robot.encoder_counts is None else CLEAR * measured_velocity_noise(robot)
    return float(f'{min(max(noise, NARROWEST), WIDEST):.2g}')


def arm_with_friction(urdf: UrdfSource, joints: Sequence[str] | None = None, *,
                      coulomb: bool | None = None,
                      rotor_inertia: bool | Sequence[float] = False,
                      coulomb_velocity: float = WIDEST) -> UrdfArm:
    """Return the arm of a URDF with what is learned of it.

    Args:
        urdf: As `load_arm` takes it.
        joints: Likewise.
        coulomb: Whether a Coulomb friction per joint is learned; None: where the URDF states any
            (``<dynamics friction>``), as a model without it would explain it by masses.
        rotor_inertia: Whether the inertia of each rotor is; numbers are learned as well, and are
            what learning and gains begin with, one for all joints or one for each [kg·m²].
        coulomb_velocity: v_s of tanh(q̇/v_s) [rad/s], see `sliding_velocity`.

    Raises:
        ArmError: no arm can be made of the URDF and the joints.
        ParameterError: the stated inertias are no finite numbers >= 0, or not one per joint.
        MissingExtra: Pinocchio, which reads the URDF, is not installed.
    """
    if coulomb is None:
        arm = load_arm(urdf, joints, coulomb=True)
        coulomb = bool(arm.friction(arm.nominal)[1].any())
    stated = () if isinstance(rotor_inertia, bool) else tuple(rotor_inertia)
    arm = load_arm(urdf, joints, coulomb=coulomb, rotor_inertia=rotor_inertia is not False,
                   coulomb_velocity=coulomb_velocity)
    if not stated:
        return arm
    inertias = per_joint('--rotor-inertia', stated, arm)
    if inertias.min() < 0.0:
        raise ParameterError('--rotor-inertia', list(stated), 'inertias >= 0 kg·m²')
    return load_arm(urdf, joints, coulomb=coulomb, rotor_inertia=True, rotor=inertias,
                    coulomb_velocity=coulomb_velocity)
