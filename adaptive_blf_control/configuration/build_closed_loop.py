# SPDX-License-Identifier: Apache-2.0
"""Build the whole loop from a parameter file, or from parts in place of what it names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.build_arm import ArmStore
from adaptive_blf_control.configuration.build_identifier import build_identifier
from adaptive_blf_control.configuration.build_plant import build_plant, own_plant
from adaptive_blf_control.configuration.build_set_estimator import (
    build_set_estimator,
    check_learns,
)
from adaptive_blf_control.configuration.initial_theta import initial_theta
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
from adaptive_blf_control.identification.update_laws import UpdateLaw
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.plant import Plant
from adaptive_blf_control.simulation.sensors import Sensor

__all__ = ['OwnParts', 'build_closed_loop']


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
    learned = arm or arms.arm(identifier)
    return ClosedLoop(plant, begun,
                      build_identifier(identifier, learned, update_law=own.update_law),
                      1.0 / driver.rate, initial_theta(controller, known),
                      controller.model == 'known',
                      check_learns(controller, build_set_estimator(identifier, learned)))
