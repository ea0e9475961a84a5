# SPDX-License-Identifier: Apache-2.0
"""The parameters that describe the arm; three of the nodes have them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptive_blf_control.parameters.declaration import group, parameter
from adaptive_blf_control.parameters.settings import Settings

__all__ = ['ArmSettings', 'FrictionSettings']


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FrictionSettings(Settings, where='friction'):
    """Which friction of a URDF arm is learned, and the inertia of its rotors."""

    viscous: bool = parameter(
        True, 'Learn a viscous coefficient per joint (URDF).')
    coulomb: bool = parameter(
        False, 'Learn a Coulomb torque per joint (URDF).')
    offset: bool = parameter(
        False, 'Learn a constant torque per joint (URDF).')
    square_root: bool = parameter(
        False, 'Learn a coefficient of sqrt(|qd|) per joint: friction that grows less than in '
        'proportion to the speed (URDF).')
    rotor_inertia: bool = parameter(
        False, "Learn the inertia of each joint's rotor, seen from the joint, where a torque "
        'tells it from that of the link (URDF).')
    nominal_rotor_inertia: np.ndarray = parameter(
        [0.0], "Nominal inertia of each joint's rotor, seen from the joint, as a data sheet "
        'states it; where rotor_inertia is on (URDF).', 'kg*m^2', 0.0, length='joints')
    coulomb_velocity: float = parameter(
        0.02, 'v_s of the smooth sign tanh(qd/v_s) of Coulomb and square-root '
        'friction.', 'rad/s', 0.0, exclusive=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ArmSettings(Settings):
    """The arm that the regressors describe."""

    arm: str = parameter(
        'two_link', 'Which arm the regressors describe.',
        choices=('two_link', 'three_link', 'urdf'))
    joints: tuple[str, ...] = parameter(
        ['joint1', 'joint2'],
        'Joint names in the order of every array; for a URDF they may name a sub-chain.')
    urdf: str = parameter(
        '',
        'URDF of the arm: a path, package://..., or topic:NAME to receive it as a '
        'std_msgs/String, e.g. topic:robot_description.')
    gravity: np.ndarray = parameter(
        [0.0, 0.0, -9.81], 'Gravity in the base frame of the URDF.', 'm/s^2', length=3)
    friction: FrictionSettings = group(FrictionSettings)
