# SPDX-License-Identifier: Apache-2.0
"""Build what the driver drives from its settings."""

from __future__ import annotations

from typing import Any

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.plugin import load_plugin, made
from adaptive_blf_control.simulation.actuated_arm import ActuatedArm, is_actuated
from adaptive_blf_control.simulation.plant import Plant, REQUIRED, SimulatedArm
from adaptive_blf_control.simulation.sensors import Sensor

__all__ = ['build_plant', 'own_plant']


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
