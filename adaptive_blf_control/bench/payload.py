# SPDX-License-Identifier: Apache-2.0
"""``bench payload``: how soon a load is found, in MuJoCo and on measured logs of one motion.

In MuJoCo 2 kg are attached to the Panda of ``panda_mujoco.yaml`` and taken off again. Measured:
two logs of the same motion, without and with a load; at each of twenty times the one goes on as
the other, from where it has the same state. The mass is compared with that of weighted least
squares over all of the log with the load.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY
from adaptive_blf_control.arms.load_frame import load_map
from adaptive_blf_control.bags.measured_log import MeasuredLog
from adaptive_blf_control.bench.payload_figures import LoadRun, LoadWatch, ratios
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.configuration.parameter_file import apply_changes, load_yaml
from adaptive_blf_control.configuration.payload import build_payload
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.load_fit import squares, sums_of
from adaptive_blf_control.parameters.table import NOMINAL
from adaptive_blf_control.runs.identification import identify
from adaptive_blf_control.runs.log_options import LogOptions
from adaptive_blf_control.runs.log_pairs import LogPairs
from adaptive_blf_control.runs.subject import joints_of, real_robot_settings

__all__ = ['add_options', 'run']

_MASS, _HELD = 2.0, 6.0  # kg, s
_MUJOCO = ((10.0, 'θ̂'), (11.5, 'θ̂'), (13.0, 'θ̂'), (10.0, NOMINAL))  # s, model of before
_TIMES = 20
_REWEIGHTINGS = 5
_WORTH = ('error of the torque by that without load: since then, worst | of a second until '
          'within 5 %, worst | of a second, worst')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the logs and what they belong to."""
    group = parser.add_argument_group('payload: measured logs of one motion')
    group.add_argument('--payload-logs', nargs=2, type=Path, metavar=('WITHOUT', 'WITH'),
                       help='the same motion without and with a load, as identify reads it')
    group.add_argument('--payload-also', type=Path, action='append', default=[], metavar='LOG',
                       help='another log without the load to learn the model from')
    group.add_argument('--payload-urdf', metavar='FILE', help='the robot')
    group.add_argument('--payload-joints', metavar='A,B,...', help="default: the URDF's")
    group.add_argument('--payload-frame', metavar='LINK', help='the link that carries the load')


def run(options: argparse.Namespace) -> None:
    """Print the tables.

    Raises:
        BlfError: a log or the robot cannot be used.
    """
    print('2 kg at the Panda in MuJoCo, `panda_mujoco.yaml`\n')
    print('| model of before | attached at [s] | noticed after [s] | within 5 % for good after '
          f'[s] | last mass [kg] | {_WORTH} | removal noticed after [s] |')
    print('|---|---|---|---|---|---|---|---|---|')
    for begin, model in _MUJOCO:
        figures, removed = _mujoco(options.config / 'panda_mujoco.yaml', begin, model)
        print(f'| {model} | {begin:g} | {_row(figures)} | {removed:.2f} |', flush=True)
    if options.payload_logs is None:
        print('\nSkipped the measured logs: none is named with --payload-logs.')
        return
    _measured(options)


def _row(figures: LoadRun) -> str:
    return (f'{figures.noticed:.2f} | {figures.close:.2f} | {figures.mass:.3f} | '
            f'{figures.overall:.3f} | {figures.meanwhile:.3f} | {figures.window:.2f}')


def _mujoco(scenario: Path, begin: float, model: str) -> tuple[LoadRun, float]:
    """Return the figures of a load that is attached at ``begin`` [s], and when it was missed."""
    end = begin + _HELD
    data = apply_changes(load_yaml(scenario), {
        'arm_driver.schedule': {'time': [begin, end], 'parameter': ['payload'] * 2,
                                'value': [_MASS, 0.0]},
        'identifier.payload.frame': 'panda_link8'})
    loop = build_closed_loop(data)
    identifier = loop.identifier
    settings = real_robot_settings().replace(**{'payload.frame': 'panda_link8'})
    watch: LoadWatch | None = None
    updates = 0
    for sample in loop.samples(end + _HELD):
        if watch is None and sample.t >= begin - 2.0:  # seconds without, to know residuals from
            baseline = identifier.arm.nominal if model == NOMINAL else identifier.theta
            found = build_payload(settings, identifier.arm, identifier.memory, baseline)
            assert found is not None
            watch = LoadWatch(found, begin)
        if watch is not None and identifier.settled and identifier.updates != updates:
            updates = identifier.updates
            watch.take(sample.t, *identifier.pair)
    assert watch is not None
    return watch.figures(_MASS, end), watch.removed(end)


def _measured(options: argparse.Namespace) -> None:
    if not options.payload_urdf or not options.payload_frame:
        raise ParameterError('--payload-logs', str(options.payload_logs[0]),
                             '--payload-urdf and --payload-frame beside it')
    joints = (options.payload_joints.split(',') if options.payload_joints
              else joints_of(options.payload_urdf))
    settings = real_robot_settings().replace(urdf=options.payload_urdf, joints=joints,
                                             payload={'frame': options.payload_frame})
    first, second = options.payload_logs
    logs: Any = [first, *options.payload_also]
    learned = identify(logs, settings=settings, train=':', test='none')
    source = LogPairs(settings, LogOptions(force=True))
    without, along = source.read(first), source.read(second)
    baseline = learned.consistent.theta
    load = _batch_load(source, along, baseline)
    added, errors = load_map(source.arm, options.payload_frame) @ load, []
    for t, regressor, torque in _pairs(source, along):
        more = torque - regressor @ baseline
        left = more - regressor @ added
        errors.append((t, float(more @ more), float(left @ left)))
    print(f'\n{first.name}, going on as {second.name} at {_TIMES} times; model of before: the '
          f'consistent one; by weighted least squares {load[0]:.3f} kg, whose error of the torque '
          f'within a second is at most {ratios(errors)[-1]:.2f} of that without load\n')
    runs = [_switched(source, settings, baseline, (without, along), k, float(load[0]))
            for k in _places(without, source.identifier.memory)]
    print('| | noticed after [s] | within 5 % for good after [s] | last mass [kg] | '
          f'{_WORTH} |')
    print('|---|---|---|---|---|---|---|')
    for name, of in (('smallest', np.min), ('median', np.median), ('largest', np.max)):
        print(f'| {name} | {_row(LoadRun(*(float(of(column)) for column in zip(*runs))))} |')


def _places(log: MeasuredLog, memory: float) -> Sequence[int]:
    """Return the rows at which the load is attached: in the moving part, with time to follow."""
    moving = np.flatnonzero(np.abs(log.qd).max(axis=1) > 0.05 * np.abs(log.qd).max())
    first, last = log.t[moving[0]] + 10.0 * memory, log.t[moving[-1]]
    times = np.linspace(first, first + 0.8 * (last - first), _TIMES)
    return np.searchsorted(log.t, times).tolist()


def _switched(source: LogPairs, settings: IdentifierNodeSettings, baseline: np.ndarray,
              logs: tuple[MeasuredLog, MeasuredLog], row: int, mass: float) -> LoadRun:
    """Return the figures of a log that goes on as the other one after a row."""
    without, along = logs
    scale = np.concatenate([np.ptp(without.q, axis=0), np.ptp(without.qd, axis=0)]) + 1e-9
    state = np.concatenate([without.q[row], without.qd[row]])
    there = np.argmin(np.sum(((np.hstack([along.q, along.qd]) - state) / scale) ** 2, axis=1))
    rest = slice(int(there) + 1, None)
    t, q, qd, tau = (np.concatenate([before[:row + 1], after[rest]]) for before, after in (
        (without.t, along.t - along.t[there] + without.t[row]), (without.q, along.q),
        (without.qd, along.qd), (without.tau, along.tau)))
    both = without.replace(t=t, q=q, qd=qd, tau=tau)
    found = build_payload(settings, source.arm, source.identifier.memory, baseline)
    assert found is not None
    watch = LoadWatch(found, float(both.t[row]))
    for time, regressor, torque in _pairs(source, both):
        watch.take(time, regressor, torque)
    return watch.figures(mass)


def _pairs(source: LogPairs, log: MeasuredLog) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    for times, rows in source.of_read(log):
        for t, pair in zip(times.tolist(), rows, strict=True):
            yield t, pair[:, :-1], pair[:, -1]


def _batch_load(source: LogPairs, log: MeasuredLog, baseline: np.ndarray) -> np.ndarray:
    """Return π by least squares over a log, joints weighted by their residuals, shape (10,)."""
    columns = load_map(source.arm, source.settings.payload.frame)
    sums = np.zeros((source.arm.n, PER_BODY + 1, PER_BODY + 1))
    seconds = 0.0
    for times, rows in source.of_read(log):
        residuals = rows[:, :, -1] - rows[:, :, :-1] @ baseline
        sums += sums_of(rows[:, :, :-1] @ columns, residuals, np.ones(len(times)))
        seconds += len(times)
    weight: np.ndarray = np.ones(source.arm.n)
    found: np.ndarray = np.zeros(PER_BODY)
    for _ in range(_REWEIGHTINGS):
        whole = np.tensordot(weight, sums, axes=1)
        found = np.linalg.lstsq(whole[:-1, :-1], whole[:-1, -1], rcond=None)[0]
        weight = seconds / squares(sums, found)
    return found
