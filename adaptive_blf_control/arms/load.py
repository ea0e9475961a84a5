# SPDX-License-Identifier: Apache-2.0
"""An arm from a URDF in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
import warnings

import numpy as np

from adaptive_blf_control.arms.at_hand import list_arms
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_nominal import stated_coulomb
from adaptive_blf_control.arms.urdf_source import UrdfSource
from adaptive_blf_control.calls import argument_names, checked_call
from adaptive_blf_control.errors import ParameterError, UnknownParameter

__all__ = ['load_arm']


@checked_call
def load_arm(urdf: UrdfSource, joints: Sequence[str] | None = None, *,
             viscous: bool = True, coulomb: bool | None = None, offset: bool = False,
             square_root: bool = False, rotor_inertia: bool = False,
             rotor: float | Sequence[float] | np.ndarray | None = None,
             coulomb_velocity: float = 0.02,
             gravity: Sequence[float] | np.ndarray = (0.0, 0.0, -9.81),
             **others: Any) -> UrdfArm:
    """Return the arm of a URDF, linear in its base parameters and the friction asked for (2).

    Args:
        urdf: Path, ``package://package/path``, XML text, or what has it as ``xml``: an arm, or
            what `Identification.urdf` returns. `list_arms` has the URDFs of installed packages.
        joints: Joint names in the order of every array; None takes every joint with one axis,
            from the base outwards. The others are locked at zero.
        viscous: Whether θ has a viscous coefficient per joint [N·m·s/rad].
        coulomb: Whether θ has a Coulomb torque per joint, tanh(q̇/v_s) [N·m]. None: it has none,
            and a warning says so where the URDF states some, as one that was identified does.
        offset: Whether θ has a constant torque per joint [N·m].
        square_root: Whether θ has a coefficient per joint of √|q̇| tanh(q̇/v_s)
            [N·m·(s/rad)^½].
        rotor_inertia: Whether θ has the inertias of the rotors, seen from the joints [kg·m²].
        rotor: Nominal inertias of the rotors, scalar or shape (n,) [kg·m²]; None takes zero.
        coulomb_velocity: v_s [rad/s], > 0.
        gravity: In the base frame of the URDF, shape (3,) [m/s²].
        others: Not used; another name is refused with the one that is meant.

    Raises:
        ArmError: no arm can be made of the URDF and the joints.
        ParameterError: a number cannot be used.
        MissingExtra: Pinocchio, which reads the URDF, is not installed.
    """
    for name, value in others.items():
        if name in ('payload', 'load', 'mass', 'payload_mass'):
            raise ParameterError(name, value, 'nothing: an arm is what is known; '
                                 'simulate(arm, payload=2.0) drives one that carries a load')
        raise UnknownParameter(name, value, argument_names(load_arm))
    if isinstance(urdf, str) and urdf.isidentifier() and urdf in (at_hand := list_arms()):
        raise ParameterError('urdf', urdf, f'a URDF; the arm of this name is {at_hand[urdf]}')
    for name, value in (('viscous', viscous), ('coulomb', coulomb), ('offset', offset),
                        ('square_root', square_root), ('rotor_inertia', rotor_inertia)):
        if name == 'coulomb' and value is None:
            continue
        if not isinstance(value, (bool, np.bool_)):
            raise ParameterError(name, value, 'True or False: whether it is learned; '
                                 'UrdfArm(urdf, viscous=...) takes nominal values')
    arm = UrdfArm(urdf, joints, friction_viscous=viscous, friction_coulomb=bool(coulomb),
                  friction_offset=offset, friction_square_root=square_root,
                  rotor_inertia=rotor_inertia, rotor=rotor,
                  coulomb_velocity=coulomb_velocity, gravity=gravity)
    left_out = stated_coulomb(arm.model) if coulomb is None else {}
    if left_out:
        warnings.warn('the URDF states Coulomb friction, which this arm does not have: '
                      + ', '.join(f'{name} {value:.4g} N·m' for name, value in left_out.items())
                      + '; load_arm(urdf, coulomb=True) has it, coulomb=False leaves it out',
                      stacklevel=3)
    return arm
