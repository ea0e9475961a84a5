# SPDX-License-Identifier: Apache-2.0
"""Build the objects of the core from settings; nodes and tools both call this."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.settings import ArmSettings
from adaptive_blf_control.arms.three_link import ThreeLinkArm
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    DriverSettings,
    IdentifierNodeSettings,
)
from adaptive_blf_control.configuration.parameter_file import node_settings
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.laws.protocol import Law
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.control.set_constraints import OwnConstraints
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.given_parameters import given_parameters, read_estimate
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.update_laws import UpdateLaw
from adaptive_blf_control.parameters.plugin import load_plugin, made
from adaptive_blf_control.simulation.actuated_arm import ActuatedArm, is_actuated
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.plant import Plant, REQUIRED, SimulatedArm
from adaptive_blf_control.simulation.rotation import rotation
from adaptive_blf_control.simulation.sensors import Sensor

__all__ = ['ArmStore', 'OwnParts', 'build_arm', 'build_closed_loop', 'build_identifier',
           'build_plant',
           'own_plant', 'initial_estimate', 'initial_theta']

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


def _true_friction(settings: ArmSettings) -> dict[str, Any]:
    """Return the friction of the driver's arm that differs from the URDF's, by its kind."""
    if not isinstance(settings, DriverSettings):
        return {}
    true = settings.true_friction.resolved(joints=len(settings.joints))
    return {name: getattr(true, name) for name in FRICTION if np.any(getattr(true, name))}


def build_plant(settings: DriverSettings, arm: Arm,
                sensor: Sensor | type[Sensor] | None = None) -> Plant:
    """Build what the driver drives: the simulated arm, or the plant that ``plant`` names.

    Args:
        settings: Those of the driver.
        arm: The arm.
        sensor: In place of the sensor that the settings name.

    Raises:
        ParameterError: a value cannot be used, the named plant lacks what a plant needs, or a
            sensor is given to one that has its own.
    """
    if settings.plant == 'builtin':
        kind = ActuatedArm if is_actuated(settings) else SimulatedArm
        return kind(settings, arm, sensor)
    if settings.plant == 'mujoco':
        from adaptive_blf_control.simulation.mujoco.plant import MujocoPlant
        return MujocoPlant(settings, _known_arm(settings, arm), settings.gravity, sensor)
    if sensor is not None:
        raise ParameterError('sensor', sensor, f'nothing: the plant {settings.plant} has its own')
    return own_plant('arm_driver.plant', settings.plant, load_plugin(
        'arm_driver.plant', settings.plant), settings, arm)


def own_plant(name: str, value: object, given: Any, settings: DriverSettings, arm: Arm) -> Plant:
    """Return a plant as it is given, or what a class or function makes of settings and arm.

    Args:
        name: The parameter or argument that gives it, for messages.
        value: Its value, likewise.
        given: The plant, the class or the function.
        settings: Those of the driver.
        arm: The arm.
    """
    plant: Plant = made(name, value, given, REQUIRED, settings.resolved(joints=arm.n), arm,
                        base='Plant')
    return plant


def _known_arm(settings: DriverSettings, arm: Arm) -> Arm:
    """Return the arm that another node may know: upright, with every friction there is."""
    if settings.arm != 'urdf':
        return arm
    kinds = {name: True for name, value in settings.friction.values().items()
             if isinstance(value, bool)}
    return build_arm(settings.replace(friction=kinds, mounting=[0.0] * 3),
                     getattr(arm, 'xml', None))


def initial_theta(settings: ControllerNodeSettings, arm: Arm) -> np.ndarray:
    """Return what the controller uses before the first θ̂, or for good (``model: known``), (m,).

    Raises:
        ParameterError: it has neither one element nor m, or its file cannot be used.
    """
    name = 'known_parameters' if settings.model == 'known' else 'initial_estimate'
    return given_parameters(f'controller.{name}', getattr(settings, name), arm)


def initial_estimate(settings: IdentifierNodeSettings, arm: Arm) -> IdentifierNodeSettings:
    """Return the settings with θ̂(0) from ``initial_estimate_file``, where one is named."""
    if not settings.initial_estimate_file:
        return settings
    estimate = read_estimate(Path(settings.initial_estimate_file), arm.parameters)
    return settings.replace(initial_estimate=estimate)


def build_identifier(settings: IdentifierNodeSettings, arm: Arm,
                     estimate: np.ndarray | None = None,
                     update_law: UpdateLaw | type[UpdateLaw] | str | None = None) -> Identifier:
    """Build the identifier for ``arm``.

    Args:
        settings: Those of the node.
        arm: The arm.
        estimate: θ̂(0), shape (m,), in place of ``initial_estimate_file`` and
            ``initial_estimate``, which are then not looked at.
        update_law: In place of the one that the settings name.
    """
    if estimate is not None:
        return Identifier(arm, settings.replace(initial_estimate=estimate), update_law)
    return Identifier(arm, initial_estimate(settings, arm), update_law)


class OwnParts(NamedTuple):
    """Objects that take the place of what a parameter file names; None where it shall."""

    arm: Arm | None = None
    plant: Plant | type[Plant] | None = None
    sensor: Sensor | type[Sensor] | None = None
    law: Law | type[Law] | str | None = None
    update_law: UpdateLaw | type[UpdateLaw] | str | None = None
    constraints: OwnConstraints = ()
    reference: Reference | None = None


_NONE_OWN = OwnParts()


def build_closed_loop(data: Mapping[str, Any], own: OwnParts = _NONE_OWN,
                      arms: ArmStore | None = None) -> ClosedLoop:
    """Build the loop from a parameter file's data, as the nodes would from the same file.

    Args:
        data: The parameter file's data.
        own: Parts in place of those that it names.
        arms: Where arms are kept between loops of one thread.
    """
    arm = own.arm
    arms = ArmStore() if arms is None else arms
    driver = node_settings(data, DriverSettings)
    controller = node_settings(data, ControllerNodeSettings)
    identifier = node_settings(data, IdentifierNodeSettings)
    known = arm or arms.arm(controller)
    if own.plant is None:
        plant = build_plant(driver, arm or arms.arm(driver), own.sensor)
    elif own.sensor is not None:
        raise ParameterError('sensor', own.sensor, 'nothing: the plant that is given has its own')
    else:
        plant = own_plant('plant', own.plant, own.plant, driver, known)
    begun = Controller(known, controller, law=own.law, constraints=own.constraints,
                       reference=own.reference,
                       start=plant.measured_position(), velocity=plant.qd)
    return ClosedLoop(plant, begun,
                      build_identifier(identifier, arm or arms.arm(identifier),
                                       update_law=own.update_law),
                      1.0 / driver.rate, initial_theta(controller, known),
                      controller.model == 'known')
