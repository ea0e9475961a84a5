# SPDX-License-Identifier: Apache-2.0
"""The parameters of the four nodes; this module alone states which node has which."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from adaptive_blf_control.arms.settings import ArmSettings
from adaptive_blf_control.control.limit_settings import PriorSettings
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.identification.settings import IdentifierSettings, PayloadSettings
from adaptive_blf_control.messages.topics import RECORDED
from adaptive_blf_control.parameters.declaration import group, parameter
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.parameters.table import Table
from adaptive_blf_control.simulation.settings import PlantSettings, WatchdogSettings

__all__ = ['ComposedSettings', 'ControllerNodeSettings', 'DriverSettings', 'GuaranteeSettings',
           'IdentifierNodeSettings', 'LifecycleSettings', 'LockstepSettings',
           'NODE_SETTINGS', 'ParameterSetSettings', 'SetPriorSettings',
           'RealtimeSettings', 'RecorderSettings', 'RuntimeSettings', 'TABLES']


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RealtimeSettings(Settings, where='realtime'):
    """What is asked of the operating system."""

    priority: int = parameter(
        0, 'SCHED_FIFO priority of the process where the system permits it; 0: none.',
        '', 0, 99)
    cpus: str = parameter(
        '', "Processors that the process may use, e.g. '0,2-3'; empty: all.")
    slice: float = parameter(
        0.0001,
        'Time slice requested from the ordinary scheduler: a short one comes sooner (Linux 6.12 '
        'and later); 0 requests none.', 's', 0.0, 0.1)
    lock_memory: bool = parameter(
        False, 'Keep the memory from being swapped out where the system permits it.')


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RuntimeSettings(Settings):
    """What every node has."""

    executor: str = parameter(
        'direct',
        'direct: the loop waits on the data alone; plain: the executor of rclpy does everything, '
        'slower.', choices=('direct', 'plain'))
    niceness: int = parameter(
        0, 'Nice value of the loop; above 0 it gives way to the nodes that control.', '', 0, 19)
    discovery_time: float = parameter(
        4.0,
        'How long after its start a node looks for another one that does the same for this arm, '
        'before it sends anything; Fast DDS announces a node every 3 s, where the first '
        'announcements are missed. 0: it does not look.',
        's', 0.0, 60.0)
    realtime: RealtimeSettings = group(RealtimeSettings)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LifecycleSettings(RuntimeSettings):
    """What every node with a lifecycle has."""

    autostart: bool = parameter(
        True, 'Configure and activate by itself; false waits for lifecycle requests.')
    ramp_time: float = parameter(
        0.2,
        'Time over which the torque goes to zero on deactivation; the controller takes longer '
        'where torque_rate_limit requires it.', 's', 0.0, 5.0, live=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ComposedSettings(Settings):
    """What controller and identifier have for running in one process."""

    composed_decimation: int = parameter(
        10,
        'In arm_control, where theta_hat and the adaptation term are handed over in memory, they '
        'are published every this many samples; in lockstep with every one.', '', 1, 1000000,
        live=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LockstepSettings(Settings, where='arm_driver.lockstep'):
    """The driver under ``use_sim_time``."""

    rate: float = parameter(
        0.0, 'Under use_sim_time: multiple of real time; 0: as fast as the nodes answer.',
        '', 0.0, 1000.0, live=True)
    answers: tuple[str, ...] = parameter(
        ['controller', 'identifier'],
        'Under use_sim_time: the nodes that have to answer every state.',
        choices=('controller', 'identifier'))
    timeout: float = parameter(
        10.0, 'Under use_sim_time: longest wait for such an answer.', 's', 0.0, exclusive=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DriverSettings(PlantSettings, WatchdogSettings, LifecycleSettings, ArmSettings,
                     where='arm_driver'):
    """The parameters of ``arm_driver``."""

    rate: float = parameter(
        1000.0, 'Rate of the joint states.', 'Hz', 1.0, 10000.0, live=True)
    duration: float = parameter(
        0.0, 'End the run after this time; 0 runs until stopped.', 's', 0.0, live=True)
    wait_for_subscribers: int = parameter(
        0, 'Publish the first state only when joint_states has this many subscribers.', '', 0)
    frame_id: str = parameter(
        'base_link', 'Frame of the joint states.')
    lockstep: LockstepSettings = group(LockstepSettings)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SetPriorSettings(PriorSettings, where='identifier.parameter_set.prior'):
    """What is known of θ* for sure before any motion."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ParameterSetSettings(Settings, where='identifier.parameter_set'):
    """The set that surely holds θ*."""

    period: float = parameter(
        0.0, 'The set is computed and published this often; 0: never.', 's', 0.0, 60.0)
    prior: SetPriorSettings = group(SetPriorSettings)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class IdentifierNodeSettings(IdentifierSettings, ComposedSettings, RuntimeSettings, ArmSettings,
                             where='identifier'):
    """The parameters of ``identifier``."""

    niceness: int = parameter(
        5, 'Nice value of the loop; above 0 it gives way to the nodes that control.', '', 0, 19)
    initial_estimate_file: str = parameter(
        '', 'YAML of parameters by name, as identify or ~/save_estimate writes it, in place of '
        'initial_estimate.')
    estimate_file: str = parameter(
        '',
        'Where theta_hat is written, by ~/save_estimate and every estimate_period. Empty: '
        'adaptive_blf_control/NAMESPACE/theta_hat.yaml in ROS_HOME, else in ~/.ros. A file '
        'that is no estimate is not replaced.')
    estimate_period: float = parameter(
        5.0,
        'The estimate is written to estimate_file this often while learning; 0 only on '
        '~/save_estimate.', 's', 0.0, 3600.0, live=True)
    model_file: str = parameter(
        '',
        'Where ~/save_model writes the physically consistent model; the URDF with its values '
        'goes beside it, with the suffix .urdf. Empty: model.yaml where theta_hat.yaml goes.')
    model_period: float = parameter(
        5.0,
        'The consistent model and the standard deviations of theta_hat are published this often, '
        'but not in lockstep; 0: never.', 's', 0.0, 3600.0, live=True)
    resume_within: float = parameter(
        0.0,
        'Start from estimate_file if it was written less than this long ago, so that an '
        'identifier that was killed continues from there; 0: never.', 's', 0.0, 1e9)
    external_torque_decimation: int = parameter(
        10, 'The external torque is published every this many samples; 0: never.', '', 0, 1000000,
        live=True)
    adaptation_term_timeout: float = parameter(
        0.1, 'An adaptation term older than this (by stamp) counts as zero.',
        's', 0.0, 3600.0, exclusive=True, live=True)
    payload: PayloadSettings = group(PayloadSettings)
    parameter_set: ParameterSetSettings = group(ParameterSetSettings)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class GuaranteeSettings(Settings, where='controller.guarantee'):
    """The guarantee of Theorem 2 that the node publishes."""

    mode: str = parameter(
        'none',
        'bound: publish the guarantee of Theorem 2 at the start, computed from the three bounds '
        'below, and monitor it; none: neither. off is its older name; unquoted, YAML and the '
        'command line read it as false.', choices=('none', 'bound', 'off'), live=True)
    theta_error: float = parameter(
        10.0, 'Bound on the norm of the parameter error at the start.', '', 0.0, live=True)
    smallest_gamma: float = parameter(
        1.0, 'Smallest element of Gamma of the identifier.', '', 0.0, exclusive=True, live=True)
    mass: np.ndarray = parameter(
        [0.1, 10.0], 'Bounds on the smallest and the largest eigenvalue of the inertia matrix.',
        'kg*m^2', 0.0, exclusive=True, length=2, live=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ControllerNodeSettings(ControllerSettings, ComposedSettings, LifecycleSettings, ArmSettings,
                             where='controller'):
    """The parameters of ``controller``."""

    model: str = parameter(
        'estimated',
        'estimated: theta_hat from the identifier (38); known: known_parameters (34).',
        choices=('estimated', 'known'))
    known_parameters: np.ndarray | str = parameter(
        [0.0], 'theta* for model: known.', length='parameters', source=True)
    initial_estimate: np.ndarray | str = parameter(
        [0.0], 'theta_hat until the identifier publishes one.', length='parameters', source=True)
    estimate_limit: np.ndarray = parameter(
        [1000.0],
        'Largest accepted absolute value of an element of theta_hat; an estimate beyond it is '
        'refused, and the last accepted one is kept.',
        '', 0.0, exclusive=True, length='parameters', live=True)
    on_violation: str = parameter(
        'continue',
        'When a joint leaves a set, or gravity as told does not fit the first torques: continue: '
        'the barrier pushes back; stop: the torque goes to zero and the node is deactivated.',
        choices=('continue', 'stop'), live=True)
    state_timeout: float = parameter(
        0.1, 'Without a new joint state for this long a zero torque is commanded.',
        's', 0.0, 60.0, exclusive=True, live=True)
    wait_for_identifier: bool = parameter(
        True,
        'Begin the first motion only when an estimate has arrived, where the law uses one: until '
        'then the brakes hold. false: begin with initial_estimate.')
    monitor_decimation: int = parameter(
        10,
        'Publish reference and margins every this many samples, the margins as the smallest '
        'since the last time; the tracking error is published with every sample.', '', 1,
        live=True)
    guarantee: GuaranteeSettings = group(GuaranteeSettings)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RecorderSettings(RuntimeSettings, where='recorder'):
    """The parameters of ``recorder``."""

    niceness: int = parameter(
        10, 'Nice value of the loop; above 0 it gives way to the nodes that control.', '', 0, 19)
    realtime: RealtimeSettings = group(RealtimeSettings, slice=0.0)
    bag: str = parameter(
        'bag', 'Folder of the bag; must not exist.')
    topics: tuple[str, ...] = parameter(
        list(RECORDED), 'Topics to record.')
    flush_period: float = parameter(
        0.5, 'A chunk reaches the disk at least this often.', 's', 0.01, 1.0)


NODE_SETTINGS: dict[str, type[RuntimeSettings]] = {
    'arm_driver': DriverSettings,
    'identifier': IdentifierNodeSettings,
    'controller': ControllerNodeSettings,
    'recorder': RecorderSettings,
}
"""The settings class of each kind of node."""

TABLES: dict[str, Table] = {node: kind.table() for node, kind in NODE_SETTINGS.items()}
"""The parameters of each kind of node, with ``<joint>`` for every joint's name."""
