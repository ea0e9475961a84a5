# SPDX-License-Identifier: Apache-2.0
"""The parameters of the simulated arm and its sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptive_blf_control.parameters import declaration as declare
from adaptive_blf_control.parameters.declaration import group, parameter
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.simulation.mujoco.settings import MujocoSettings

__all__ = ['ActuatorSettings', 'PlantSettings', 'ScheduleSettings', 'SensorSettings',
           'TrueFrictionSettings', 'WatchdogSettings']


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrueFrictionSettings(Settings, where='arm_driver.true_friction'):
    """True friction and rotor inertia of a URDF arm."""

    viscous: np.ndarray = parameter(
        [0.0], 'True viscous coefficients of a URDF arm.', 'N*m*s/rad', 0.0, length='joints')
    coulomb: np.ndarray = parameter(
        [0.0], 'True Coulomb torques of a URDF arm.', 'N*m', 0.0, length='joints')
    offset: np.ndarray = parameter(
        [0.0], 'True constant torques of a URDF arm.', 'N*m', length='joints')
    square_root: np.ndarray = parameter(
        [0.0], 'True coefficients of sqrt(|qd|) of a URDF arm.', 'N*m*(s/rad)^0.5', 0.0,
        length='joints')
    rotor_inertia: np.ndarray = parameter(
        [0.0], 'True rotor inertias of a URDF arm, seen from the joints.', 'kg*m^2', 0.0,
        length='joints')


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ScheduleSettings(Settings, where='arm_driver.schedule'):
    """Changes of the true arm while it runs."""

    time: np.ndarray = declare.parameter(
        [0.0], 'Times, ascending, at which the true arm changes.', 's', 0.0, live=True)
    parameter: tuple[str, ...] = declare.parameter(
        [''],
        'What changes then: a parameter of the true arm, or payload; an empty name does '
        'nothing.', live=True)
    value: np.ndarray = declare.parameter(
        [0.0], 'Its new value; the payload in kg.', live=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SensorSettings(Settings, where='arm_driver.sensors'):
    """How the joints are measured."""

    model: str = parameter(
        'perfect',
        'perfect: the true state; encoder: counts, and velocities from their differences; '
        'module:name: called with these settings and the arm, it returns a sensor.',
        choices=('perfect', 'encoder'), live=True, plugin=True)
    encoder_counts: int = parameter(
        2000, 'Encoder counts per motor turn.', '', 1, live=True)
    gear_ratio: float = parameter(
        100.0, 'Motor turns per joint turn.', '', 0.0, exclusive=True, live=True)
    velocity_time_constant: float = parameter(
        0.005, 'Time constant of the first-order filter on the position differences; 0: none.',
        's', 0.0, live=True)
    torque_noise: float = parameter(
        0.0, 'Standard deviation of the noise of the measured torque, whatever the model.', 'N*m',
        0.0, live=True)
    seed: int = parameter(
        0, 'Seed of the sensor noise.', '', 0, live=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ActuatorSettings(Settings, where='arm_driver.actuator'):
    """How a command becomes a torque."""

    delay: float = parameter(
        0.0, 'Time after which a command acts.', 's', 0.0, 1.0)
    jitter: float = parameter(
        0.0, 'Largest further delay of a command, uniformly distributed.', 's', 0.0, 1.0)
    gain_error: np.ndarray = parameter(
        [0.0], 'Part by which the torque that acts is larger than the one commanded and measured.',
        '', -0.5, 0.5, length='joints')
    torque_bias: np.ndarray = parameter(
        [0.0], 'Constant error of the measured torque.', 'N*m', length='joints')
    effort: str = parameter(
        'mean',
        'What is measured as torque: mean: over the interval that ends at the sample; instant: '
        'what acts at the sample.', choices=('mean', 'instant'))
    seed: int = parameter(
        0, 'Seed of the jitter.', '', 0)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlantSettings(Settings, where='arm_driver'):
    """The simulated arm."""

    plant: str = parameter(
        'builtin',
        'What is driven: builtin: the arm with the true parameters below; mujoco: the arm of '
        'mujoco.model; module:name: called with the settings and the arm, it returns a plant.',
        choices=('builtin', 'mujoco'), plugin=True)
    initial_position: np.ndarray = parameter(
        [0.0], 'Joint positions at the start.', 'rad', length='joints')
    initial_velocity: np.ndarray = parameter(
        [0.0], 'Joint velocities at the start.', 'rad/s', length='joints')
    true_model: str = parameter(
        'nominal',
        'Where theta* of the simulated arm comes from: the nominal values of the arm, or given '
        'as true_parameters.', choices=('nominal', 'given'))
    true_parameters: np.ndarray | str = parameter(
        [0.0], 'theta* for true_model: given, p1 p2 p3 fv_joint1 fv_joint2 of two_link.',
        length='parameters', live=True, source=True)
    payload: float = parameter(
        0.0, 'Point mass at the tip of the true arm, on top of true_model (three_link, urdf).',
        'kg', 0.0, live=True)
    dead_time: int = parameter(
        0, 'Whole samples after which a command acts.', '', 0, 1000, live=True)
    substeps: int = parameter(
        1, 'Runge-Kutta steps per sample.', '', 1, 1000, live=True)
    torque_limit: np.ndarray = parameter(
        [200.0], 'Torque at which the simulated drives saturate.',
        'N*m', 0.0, exclusive=True, length='joints', live=True)
    true_friction: TrueFrictionSettings = group(TrueFrictionSettings)
    mounting: np.ndarray = parameter(
        [0.0, 0.0, 0.0],
        'Roll, pitch, yaw of the base against the frame that gravity is given in (URDF arms).',
        'rad', length=3)
    actuator: ActuatorSettings = group(ActuatorSettings)
    mujoco: MujocoSettings = group(MujocoSettings)
    schedule: ScheduleSettings = group(ScheduleSettings)
    sensors: SensorSettings = group(SensorSettings)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WatchdogSettings(Settings, where='arm_driver'):
    """What the drives do when commands stay away."""

    command_timeout: float = parameter(
        0.1, 'Without a new command for this long the torque goes to zero.',
        's', 0.0, 60.0, exclusive=True, live=True)
    timeout_action: str = parameter(
        'zero',
        'What the drives do after command_timeout: zero: no torque; damping: a torque against '
        'the motion.', choices=('zero', 'damping'), live=True)
    damping: np.ndarray = parameter(
        [5.0], 'Damping of timeout_action: damping.', 'N*m*s/rad', 0.0, length='joints', live=True)
