# SPDX-License-Identifier: Apache-2.0
"""Build an arm from the settings of a node."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.settings import ArmSettings
from adaptive_blf_control.arms.three_link import ThreeLinkArm
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.rotation import rotation

__all__ = ['ArmStore', 'build_arm']

FRICTION = {'viscous': 'friction_viscous', 'coulomb': 'friction_coulomb',
            'offset': 'friction_offset', 'square_root': 'friction_square_root',
            'rotor_inertia': 'rotor_inertia'}
"""Arguments of `UrdfArm` by the parameter below ``friction`` that switches them on."""


def build_arm(settings: ArmSettings, robot_description: str | None = None) -> Arm:
    """Build the arm named by ``settings.arm``.

    Args:
        settings: Those of any node but the recorder.
        robot_description: URDF text that replaces ``settings.urdf``.
    """
    joints = settings.joints
    if len(set(joints)) != len(joints) or not joints:
        raise ParameterError('joints', list(joints), 'distinct joint names, at least one')
    if settings.arm == 'two_link':
        return TwoLinkArm(joints)
    if settings.arm == 'three_link':
        return ThreeLinkArm(joints)
    from adaptive_blf_control.arms.urdf import UrdfArm  # Pinocchio only where it is needed
    source = robot_description or settings.urdf
    if not source:
        raise ParameterError('urdf', source, 'a path, package://... or topic:NAME')
    true = _true_friction(settings)
    learned: dict[str, Any] = {argument: getattr(settings.friction, name) or name in true
                               for name, argument in FRICTION.items()}
    if 'rotor_inertia' in true:
        true['rotor'] = true.pop('rotor_inertia')
    elif (stated := _stated_rotors(settings)).any():
        true['rotor'] = stated
    return UrdfArm(source, joints, **learned,
                   coulomb_velocity=settings.friction.coulomb_velocity,
                   gravity=_gravity(settings), **true)


class ArmStore:
    """Arms that were built, to be used again where the same one is asked for.

    Reading a URDF and finding its base parameters takes longer than a second of simulation. The
    arms share what they compute with: all of them belong to one thread. Those that were asked for
    last are kept.
    """

    LARGEST = 8

    def __init__(self) -> None:
        """Begin without arms."""
        self._arms: dict[Hashable, Arm] = {}

    def arm(self, settings: ArmSettings) -> Arm:
        """Return the arm of ``settings``, see `build_arm`."""
        true = tuple((name, tuple(values)) for name, values in _true_friction(settings).items())
        key = (settings.arm, settings.joints, settings.urdf, settings.friction,
               tuple(_gravity(settings)), true)
        arm = self._arms.pop(key, None)
        self._arms[key] = build_arm(settings) if arm is None else arm
        if len(self._arms) > self.LARGEST:
            del self._arms[next(iter(self._arms))]
        return self._arms[key]


def _gravity(settings: ArmSettings) -> np.ndarray:
    """Return gravity in the base frame, shape (3,) [m/s²]; the driver's arm may be tilted."""
    if not isinstance(settings, DriverSettings) or not settings.mounting.any():
        return settings.gravity
    return np.asarray(rotation(settings.mounting).T @ settings.gravity)


def _stated_rotors(settings: ArmSettings) -> np.ndarray:
    """Return the nominal inertias of the rotors, 0 where none is stated, shape (n,) [kg·m²]."""
    friction = settings.friction.resolved(joints=len(settings.joints))
    stated = friction.nominal_rotor_inertia
    if stated.any() and not friction.rotor_inertia:
        raise ParameterError('friction.nominal_rotor_inertia', stated.tolist(),
                             '0 kg·m² where friction.rotor_inertia is off')
    return stated


def _true_friction(settings: ArmSettings) -> dict[str, Any]:
    """Return the friction of the driver's arm that differs from the URDF's, by its kind."""
    if not isinstance(settings, DriverSettings):
        return {}
    true = settings.true_friction.resolved(joints=len(settings.joints))
    return {name: getattr(true, name) for name in FRICTION if np.any(getattr(true, name))}
