# SPDX-License-Identifier: Apache-2.0
"""``bench arms``: what ``configure`` makes of six arms, simulated with delay and encoders."""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.configuration.node_settings import RuntimeSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.runs.simulation import simulate, Simulation
from adaptive_blf_control.runs.torque_error import PredictedTorque
from adaptive_blf_control.runs.torque_use import oscillation_text
from adaptive_blf_control.tuning.node_values import node_settings_of
from adaptive_blf_control.tuning.recipe import recipe
from adaptive_blf_control.tuning.robot import Robot
from adaptive_blf_control.tuning.stated_friction import arm_with_friction, sliding_velocity

__all__ = ['ARMS', 'add_options', 'node_data', 'off_by', 'run']

ARMS: dict[str, tuple[str, list[str] | None]] = {
    'Panda': ('panda_description/urdf/panda.urdf', [f'panda_joint{i}' for i in range(1, 8)]),
    'UR10': ('ur_description/urdf/ur10_robot.urdf', None),
    'UR5': ('ur_description/urdf/ur5_robot.urdf', None),
    'Kinova j2s6s200': ('kinova_description/robots/kinova.urdf', None),
    'xArm7': ('xarm_description/urdf/xarm7.urdf', None),
    'Z1': ('z1_description/urdf/z1.urdf', [f'joint{i}' for i in range(1, 7)]),
}
"""Arms of example-robot-data: URDF, and joints where there are more than those of the arm."""
REAL: dict[str, Any] = {'delay': 0.004, 'encoder_counts': 200000, 'torque_noise': 0.05}
LINK_ERROR = 0.25  # standard deviation of the logarithm of what a link's inertia is off by
STARTS = ('URDF', 'URDF, links 25 % off', 'zero')


class _Case(NamedTuple):
    name: str
    arm: UrdfArm
    address: str
    start: str
    seed: int


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare ``--arm``, ``--arm-seconds`` and ``--seeds``."""
    parser.add_argument('--arm', action='append', choices=tuple(ARMS),
                        help='arms: which one; default: all')
    parser.add_argument('--arm-seconds', type=float, default=20.0, metavar='S',
                        help='arms: length of a run [s] (default %(default)g)')
    parser.add_argument('--seeds', type=int, default=3, metavar='N',
                        help='arms: runs per row, of which the worst counts (default %(default)d)')


def run(options: argparse.Namespace) -> None:
    """Print the table.

    Raises:
        ParameterError: a length or a number of runs that cannot be.
    """
    if options.seeds < 1 or not options.arm_seconds > 0.0:
        raise ParameterError('--seeds, --arm-seconds', (options.seeds, options.arm_seconds),
                             'at least 1, and a time > 0 s')
    print('| arm | θ̂(0) | samples outside | largest \\|e1\\| of its bound [%] | RMS e1, last '
          'quarter [rad] | torque off: all joints / worst [%] | alarms | x real time |')
    print('|---|---|---|---|---|---|---|---|')
    for name in options.arm or ARMS:
        urdf, joints = ARMS[name]
        address = f'package://{urdf}'
        arm = arm_with_friction(address, joints,
                                coulomb_velocity=sliding_velocity(Robot(**REAL)))
        for start in STARTS:
            runs = [_figures(_Case(name, arm, address, start, seed), options.arm_seconds)
                    for seed in range(options.seeds)]
            print(_row(name, start, runs), flush=True)


def _figures(case: _Case, seconds: float) -> dict[str, Any]:
    nodes = node_settings_of(recipe(case.arm, Robot(**REAL, from_zero=case.start == 'zero')),
                             case.address)
    data = node_data(nodes)
    changes: dict[str, Any] = {'arm_driver.sensors.seed': case.seed}
    if case.start == STARTS[1]:
        changes['initial_estimate'] = off_by(case.arm, case.seed)
    done = simulate(data, seconds, **changes)
    bound = np.minimum(-done.loop.controller.performance.lower,
                       done.loop.controller.performance.upper)
    return {'outside': done.figures['set_violations'],
            'part': float((np.abs(done.e1) / bound).max()),
            'rms': max(done.figures['rms_error_last_quarter']), 'torque': _torque_off(done),
            'alarms': done.identifier.changes,
            'speed': done.figures['real_time_factor'], 'word': oscillation_text(done.figures)}


def node_data(nodes: dict[str, RuntimeSettings]) -> dict[str, Any]:
    """Return settings of nodes as the data of a parameter file."""
    return {f'/**/{node}': {'ros__parameters': settings.values()}
            for node, settings in nodes.items()}


def off_by(arm: UrdfArm, seed: int) -> np.ndarray:
    """Return the nominal θ with the inertia of every link scaled by exp(N(0, 25 %)), (m,)."""
    scale = np.exp(np.random.default_rng(seed).normal(0.0, LINK_ERROR, (arm.n, 1)))
    return np.concatenate([arm.base_from_inertial(arm.inertial * scale),
                           arm.nominal[arm.base_count:]])


def _torque_off(done: Simulation) -> tuple[float, float]:
    """Return RMS of predicted against true torque along the reference: all joints, the worst."""
    arm = done.loop.arm
    measure = PredictedTorque(arm, done.loop.controller.reference, float(done.t[-1]))
    error = measure.rms(done.theta_hat[-1] - arm.nominal)
    scale = measure.rms(arm.nominal)
    return float(np.linalg.norm(error) / np.linalg.norm(scale)), float((error / scale).max())


def _row(name: str, start: str, runs: list[dict[str, Any]]) -> str:
    def worst(key: str) -> Any:
        return max(run[key] for run in runs)

    def percent(value: float) -> str:
        return f'{100.0 * value:.2g}' if value < 10.0 else 'lost'

    both = [percent(max(run['torque'][i] for run in runs)) for i in range(2)]
    words = '; '.join(dict.fromkeys(filter(None, (run['word'] for run in runs))))
    rms = worst('rms')
    return (f'| {name} | {start} | {worst("outside")} | {percent(worst("part"))} | '
            f'{rms:.2g} | {both[0]} / {both[1]} | {worst("alarms")} | '
            f'{min(run["speed"] for run in runs):.1f} |' + (f' {words}' if words else ''))
