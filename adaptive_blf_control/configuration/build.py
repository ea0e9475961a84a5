# SPDX-License-Identifier: Apache-2.0
"""Build the objects of the core from validated parameters; nodes and tools both call this."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.three_link import ThreeLinkArm
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.parameter_file import node_values
from adaptive_blf_control.control.controller import Controller, ControllerSettings
from adaptive_blf_control.control.reference import Reference, SmoothStart, SumOfSinusoids
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.estimate_file import read_estimate
from adaptive_blf_control.identification.identifier import Identifier, IdentifierSettings
from adaptive_blf_control.parameters.table import broadcast
from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.plant import Epoch, Plant
from adaptive_blf_control.simulation.schedule import Change, Schedule
from adaptive_blf_control.simulation.sensors import Sensors, SensorSettings

__all__ = ['ControllerParts', 'build_arm', 'build_closed_loop', 'build_controller',
           'build_identifier', 'build_plant', 'controller_parts', 'controller_settings',
           'identifier_settings', 'initial_theta', 'true_theta']

Values = Mapping[str, Any]
FRICTION = ('viscous', 'coulomb', 'offset')


def build_arm(values: Values, robot_description: str | None = None) -> Arm:
    """Build the arm named by ``values['arm']``.

    Args:
        values: Parameters of any node but the recorder.
        robot_description: URDF text that replaces ``values['urdf']``.
    """
    joints = tuple(values['joints'])
    if len(set(joints)) != len(joints) or not joints:
        raise ParameterError('joints', list(joints), 'distinct joint names, at least one')
    if values['arm'] == 'two_link':
        return TwoLinkArm(joints)
    if values['arm'] == 'three_link':
        return ThreeLinkArm(joints)
    from adaptive_blf_control.arms.urdf import UrdfArm  # Pinocchio only where it is needed
    source = robot_description or values['urdf']
    if not source:
        raise ParameterError('urdf', source, 'a path, package://... or topic:NAME')
    # The driver's arm may have friction that the others do not model.
    true: dict[str, Any] = {name: broadcast(values[f'true_friction.{name}'], len(joints))
            for name in FRICTION if np.any(values.get(f'true_friction.{name}', [0.0]))}
    learned: dict[str, Any] = {f'friction_{name}': values[f'friction.{name}'] or name in true
                               for name in FRICTION}
    return UrdfArm(source, joints, **learned,
                   coulomb_velocity=values['friction.coulomb_velocity'],
                   gravity=tuple(values['gravity']), **true)


def true_theta(values: Values, arm: Arm) -> np.ndarray:
    """Return θ* of the driver's arm, payload included, shape (m,).

    Raises:
        ParameterError: ``true_parameters`` do not fit the arm or ``true_model``, or a payload is
            asked of an arm that cannot say where its tip is.
    """
    given, payload = list(values['true_parameters']), values['payload']
    if values['true_model'] == 'given':
        if len(given) != arm.m:
            raise ParameterError('arm_driver.true_parameters', given,
                                 f'{arm.m} values: {" ".join(arm.parameters)}')
        theta = np.array(given)
    elif any(given):
        raise ParameterError('arm_driver.true_parameters', given,
                             'no values, or true_model: given')
    else:
        theta = arm.nominal
    if not np.isfinite(theta).all():
        raise ParameterError('arm_driver.true_parameters', given, 'finite values')
    if payload == 0.0:
        return theta
    if arm.payload_direction is None:
        raise ParameterError('arm_driver.payload', payload,
                             f'0.0: the arm {values["arm"]} has no tip to put it on')
    return theta + payload * arm.payload_direction


def build_plant(values: Values, arm: Arm) -> Plant:
    """Build the simulated arm of the driver."""
    lists = [values[f'schedule.{field}'] for field in ('time', 'parameter', 'value')]
    if len({len(column) for column in lists}) != 1:
        raise ParameterError('arm_driver.schedule', [len(column) for column in lists],
                             'time, parameter and value of the same length')
    changes = [Change(*row) for row in zip(*lists) if row[1]]
    schedule = Schedule(true_theta(values, arm), arm.parameters, changes, arm.payload_direction,
                        values['payload'])
    epochs = [Epoch(t, arm.dynamics(theta), dict(zip(arm.parameters, theta.tolist())))
              for t, theta in schedule.epochs]
    return Plant(epochs, broadcast(values['initial_position'], arm.n),
                 broadcast(values['initial_velocity'], arm.n),
                 broadcast(values['torque_limit'], arm.n), values['substeps'],
                 Sensors(_sensor_settings(values)), values['dead_time'])


def _sensor_settings(values: Values) -> SensorSettings:
    encoder = values['sensors.model'] == 'encoder'
    return SensorSettings(values['sensors.encoder_counts'] if encoder else None,
                          values['sensors.gear_ratio'], values['sensors.velocity_time_constant'],
                          values['sensors.torque_noise'], values['sensors.seed'])


def _reference(values: Values, joints: tuple[str, ...]) -> Reference:
    rows = [[values[f'reference.{joint}.{field}'] for joint in joints]
            for field in ('amplitude', 'frequency', 'phase')]
    for joint, *columns in zip(joints, *rows):
        lengths = [len(column) for column in columns]
        if len(set(lengths)) != 1:
            raise ParameterError(f'controller.reference.{joint}', lengths,
                                 'amplitude, frequency and phase of the same length')
    terms = max(len(row) for row in rows[0])
    padded = [np.array([row + [0.0] * (terms - len(row)) for row in map(list, column)])
              for column in rows]
    offset = np.array([values[f'reference.{joint}.offset'] for joint in joints])
    return SumOfSinusoids(offset, *padded)


def controller_settings(values: Values, n: int) -> ControllerSettings:
    """Build the gains and limits of the controller for ``n`` joints."""
    gains = {name: broadcast(values[name], n)
             for name in ('k1', 'k2', 'torque_limit', 'torque_rate_limit')}
    return ControllerSettings(**gains, coupling=values['coupling'])


class ControllerParts(NamedTuple):
    """What of the controller may change while it runs: keywords of `Controller.retune`."""

    settings: ControllerSettings
    safety: JointInterval
    performance: JointInterval
    reference: Reference


def controller_parts(values: Values, arm: Arm) -> ControllerParts:
    """Build what of the controller may change while it runs, the reference without its start."""
    safety, performance = (
        JointInterval(broadcast(values[f'{name}.lower'], arm.n),
                      broadcast(values[f'{name}.upper'], arm.n), f'controller.{name}')
        for name in ('safety', 'performance'))
    return ControllerParts(controller_settings(values, arm.n), safety, performance,
                           _reference(values, arm.joints))


def build_controller(values: Values, arm: Arm, start: np.ndarray | None) -> Controller:
    """Build the controller for a motion that begins in the posture ``start``, (n,) [rad].

    Without a posture the sets are checked for the reference alone, without a smooth start.

    Raises:
        SetViolation: 𝒫̄ ⊄ 𝒮̄, or the start lies outside a set.
        ParameterError: a value cannot be used.
    """
    parts = controller_parts(values, arm)
    if start is not None and values['reference.smooth_start'] > 0.0:
        parts = parts._replace(reference=SmoothStart(
            parts.reference, values['reference.smooth_start'], start))
    controller = Controller(arm, *parts)
    if start is not None:
        controller.check_start(start)
    return controller


def initial_theta(values: Values, arm: Arm) -> np.ndarray:
    """Return what the controller uses before the first θ̂, or for good (``model: known``), (m,)."""
    name = 'known_parameters' if values['model'] == 'known' else 'initial_estimate'
    theta = broadcast(values[name], arm.m)
    if theta.size != arm.m or not np.isfinite(theta).all():
        raise ParameterError(f'controller.{name}', theta.tolist(),
                             f'finite, length 1 or {arm.m} (one for each of the parameters)')
    return theta


def identifier_settings(values: Values, arm: Arm,
                        estimate: np.ndarray | None = None) -> IdentifierSettings:
    """Build the settings of the identifier.

    Args:
        values: Its parameters.
        arm: The arm.
        estimate: θ̂(0), shape (m,), in place of ``initial_estimate_file`` and
            ``initial_estimate``, which are then not looked at.
    """
    if estimate is None and values['initial_estimate_file']:
        estimate = read_estimate(Path(values['initial_estimate_file']), arm.parameters)
    if estimate is None:
        estimate = broadcast(values['initial_estimate'], arm.m)
    for name, array in (('initial_estimate', estimate), ('gamma', values['gamma'])):
        if len(array) not in (1, arm.m):
            raise ParameterError(f'identifier.{name}', list(array),
                                 f'length 1 or {arm.m} (one for each of the parameters)')
    return IdentifierSettings(
        initial_estimate=estimate, gamma=broadcast(values['gamma'], arm.m), kt=values['kt'],
        kh=values['kh'], time_constant=values['filter.time_constant'], gap=values['filter.gap'],
        settle=values['filter.settle'], size=values['history.size'],
        epsilon=values['history.epsilon'], state_order=values['filter.state_order'],
        state_time_constant=values['filter.state_time_constant'],
        change_window=values['change.window'], change_threshold=values['change.threshold'],
        change_resolution=values['change.resolution'], update_law=values['update_law'],
        excitation_window=values['excitation.window'], noise=values['history.noise'],
        noise_seed=values['history.noise_seed'],
        minimum_growth=values['history.minimum_growth'])


def build_identifier(values: Values, arm: Arm, estimate: np.ndarray | None = None) -> Identifier:
    """Build the identifier for ``arm``; θ̂(0) as :func:`identifier_settings`."""
    return Identifier(arm, identifier_settings(values, arm, estimate))


def build_closed_loop(data: Mapping[str, Any]) -> ClosedLoop:
    """Build the loop from a parameter file's data, as the nodes would from the same file."""
    driver, controller, identifier = (
        node_values(data, node) for node in ('arm_driver', 'controller', 'identifier'))
    plant = build_plant(driver, build_arm(driver))
    arm = build_arm(controller)
    return ClosedLoop(plant, build_controller(controller, arm, plant.measured_position()),
                      build_identifier(identifier, build_arm(identifier)), 1.0 / driver['rate'],
                      initial_theta(controller, arm), controller['model'] == 'known')
