# SPDX-License-Identifier: Apache-2.0
"""A recipe as the settings of the four nodes, with the reason of each value."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

import numpy as np

from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    DriverSettings,
    IdentifierNodeSettings,
    RecorderSettings,
    RuntimeSettings,
)
from adaptive_blf_control.control.barrier import INTERIOR
from adaptive_blf_control.tuning.filter_cost import ACCEPTED
from adaptive_blf_control.tuning.gains import REACH, total_rate
from adaptive_blf_control.tuning.recipe import Recipe

__all__ = ['node_settings_of', 'reasons_of']

SIGNIFICANT = 4  # digits of a gain
SAMPLES = 10  # that may be missing before a watchdog acts
SETTLE = 3.0  # of the change monitor
SUSPICION = 2.0  # mean of d² from which on nothing is recorded
LARGEST = 10.0  # an estimate beyond so many times the largest of its kind is refused


def node_settings_of(recipe: Recipe, urdf: str) -> dict[str, RuntimeSettings]:
    """Return the settings of all nodes.

    Args:
        recipe: From an arm.
        urdf: Where its URDF is, as ``urdf`` takes it.
    """
    arm = {'arm': 'urdf', 'urdf': urdf, 'joints': recipe.arm.joints,
           'friction.coulomb': _has(recipe, 'fc'),
           'friction.rotor_inertia': any(name.startswith('Ia_')
                                         for name in recipe.arm.parameters)}
    if _has(recipe, 'fc'):
        arm['friction.coulomb_velocity'] = recipe.arm.chain.coulomb_velocity
    rotor = recipe.arm.rotor
    if rotor.any():
        arm['friction.nominal_rotor_inertia'] = rotor
    return {'arm_driver': DriverSettings.from_values({**arm, **_driver(recipe)}),
            'identifier': IdentifierNodeSettings.from_values({**arm, **_identifier(recipe)}),
            'controller': ControllerNodeSettings.from_values({**arm, **_controller(recipe)}),
            'recorder': RecorderSettings()}


def _driver(recipe: Recipe) -> dict[str, Any]:
    robot = recipe.robot
    values: dict[str, Any] = {
        'rate': robot.rate, 'initial_position': recipe.motion.centre,
        'torque_limit': recipe.torque_limit, 'substeps': recipe.substeps,
        'actuator.delay': robot.delay,
        'command_timeout': _timeout(robot.rate),
        'sensors.torque_noise': robot.torque_noise}
    if recipe.arm.rotor.any():
        values['true_friction.rotor_inertia'] = recipe.arm.rotor
    if robot.encoder_counts is not None:
        values |= {'sensors.model': 'encoder', 'sensors.encoder_counts': robot.encoder_counts,
                   'sensors.gear_ratio': 1.0,
                   'sensors.velocity_time_constant': robot.velocity_time_constant}
    return values


def _identifier(recipe: Recipe) -> dict[str, Any]:
    filters, m = recipe.filters, recipe.arm.m
    values: dict[str, Any] = {
        'initial_estimate': _start(recipe), 'gamma': _significant(recipe.adaptation.gamma),
        'kt': _rounded(recipe.adaptation.kt), 'kh': _rounded(recipe.adaptation.kh),
        'filter.time_constant': filters.time_constant, 'filter.state_order': filters.state_order,
        'filter.state_time_constant': filters.state_time_constant,
        'filter.gap': max(0.05, 5.0 / recipe.robot.rate),
        'filter.distortion': ACCEPTED if filters.state_order else 0.0,
        'change.settle': SETTLE, 'change.suspicion': SUSPICION,
        'change.adapt': recipe.robot.payload > 0.0}
    if filters.state_order:
        return values | {'history.size': max(100, 2 * m),
                         'history.epsilon': 0.03, 'history.minimum_growth': 0.05}
    return values | {'history.size': math.ceil(1.2 * m),
                     'history.epsilon': 0.1}


def _controller(recipe: Recipe) -> dict[str, Any]:
    motion, gains, robot = recipe.motion, recipe.gains, recipe.robot
    values: dict[str, Any] = {
        'initial_estimate': _start(recipe),
        'estimate_limit': _significant(_estimate_limit(recipe)),
        'k1': _significant(gains.k1), 'k2': _significant(gains.k2),
        'barrier_weight': _significant(gains.barrier_weight),
        'coupling_reach': REACH if _late(recipe) else INTERIOR,
        'torque_limit': recipe.torque_limit,
        'torque_rate_limit': _significant(2.0 * total_rate(robot.loop) * recipe.torque_limit),
        'safety.lower': motion.safety_lower, 'safety.upper': motion.safety_upper,
        'performance.lower': -motion.bound, 'performance.upper': motion.bound,
        'state_timeout': _timeout(robot.rate), 'loop.rate': robot.rate,
        'loop.delay': robot.delay, 'loop.velocity_lag': robot.velocity_lag,
        'loop.unstable': 'refuse'}
    for joint, sinusoid in zip(recipe.arm.joints, motion.sinusoids):
        values |= {f'reference.{joint}.{name}': value
                   for name, value in sinusoid.values().items()}
    return values


def reasons_of(recipe: Recipe) -> Mapping[str, str]:
    """Return why values are what they are, by ``node.parameter``."""
    delay, robot = recipe.robot.loop, recipe.robot
    ms = f'{1e3 * delay.total:.3g} ms'
    return {
        'arm_driver.initial_position': 'Centre of the reference.',
        'arm_driver.actuator.delay': 'As stated.',
        'arm_driver.true_friction.rotor_inertia': 'As stated by --rotor-inertia.',
        'arm_driver.substeps': 'So that viscous friction on small inertias is integrated stably.',
        'identifier.gamma': 'As uncertain as the URDF is, a quarter of every link; as fast as a '
                            f'loop with {ms} of delay bears.',
        'identifier.kh': 'So that the noise of the torque is weighted against Gamma.',
        'identifier.filter.time_constant': _filter_reason(recipe),
        'identifier.filter.distortion': 'An arm that falls or is thrown, several times as fast as '
                                        'this reference, does not teach what the filter does.',
        'identifier.change.suspicion': 'So that a contact does not teach, and a load at the tip '
                                       'leaves what was learned of the arm.',
        'identifier.change.adapt': 'True where a payload is stated.',
        'controller.k1': 'A tenth of the damping rate of k2, over bound^4.',
        'controller.k2': f'lambda_max(M^-1 k2) = {recipe.rate:.3g} 1/s along the reference, with '
                         f'k1 a third of the {delay.largest_rate:.4g} 1/s at which a loop with '
                         f'{ms} of delay oscillates, and half the viscous friction.',
        'controller.barrier_weight': 'A stiffness that k2 can damp with that delay.',
        'controller.coupling_reach': _reach_reason(recipe),
        'controller.estimate_limit': f'{LARGEST:g} times the largest of its kind in the URDF.',
        'controller.safety.lower': 'Inside the position limits by 2 % of the range.',
        'controller.performance.lower': f'At most 5 % of the range, {robot.width:g} rad.',
        'controller.torque_limit': 'Of the drives. For the first motion of a real arm: less.',
        'controller.torque_rate_limit': 'What the gains can ask for, twice.',
    }


def _late(recipe: Recipe) -> bool:
    """Return whether its loop has a delay beside that of the held torque."""
    return recipe.robot.delay > 0.0 or recipe.robot.velocity_lag > 0.0


def _reach_reason(recipe: Recipe) -> str:
    if not _late(recipe):
        return 'As in the paper: this loop has no delay.'
    return ('Stiffer than there the barrier is more than a loop with this delay can damp: after '
            'a contact a joint would be thrown from bound to bound.')


def _filter_reason(recipe: Recipe) -> str:
    filters = recipe.filters
    if not filters.state_order:
        return 'Sensors without noise need no state filter.'
    return (f'The filters distort the torque of this reference by {filters.motion_error:.2%} and '
            f'let {filters.noise:.2g} N*m of the noise through.')


def _estimate_limit(recipe: Recipe) -> np.ndarray:
    """Return the limit of each parameter from the largest of its kind (``Ixx``, ``fv``), (m,)."""
    arm, direction = recipe.arm, recipe.arm.payload_direction
    payload = 0.0 if direction is None else recipe.robot.payload * direction
    size = np.maximum(np.abs(arm.nominal), np.abs(arm.nominal + payload))
    kinds = [_kind(name) for name in arm.parameters]
    largest = {kind: max(each for each, other in zip(size, kinds) if other == kind)
               for kind in kinds}
    return np.array([LARGEST * max(largest[kind], 0.1) for kind in kinds])


def _kind(parameter: str) -> str:
    head, dot, kind = parameter.rpartition('.')
    if not dot:
        return parameter.partition('_')[0]  # fv, fc, f0
    return kind[0]  # m, mx, my, mz count as m; Ixx to Izz as I


def _start(recipe: Recipe) -> list[float] | str:
    return [0.0] if recipe.robot.from_zero else 'nominal'


def _has(recipe: Recipe, kind: str) -> bool:
    return f'{kind}_{recipe.arm.joints[0]}' in recipe.arm.parameters


def _timeout(rate: float) -> float:
    return max(0.1, SAMPLES / rate)


def _significant(values: np.ndarray) -> list[float]:
    return [_rounded(value) for value in values]


def _rounded(value: float) -> float:
    return float(f'{value:.{SIGNIFICANT}g}')
