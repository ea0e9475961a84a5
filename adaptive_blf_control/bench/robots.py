# SPDX-License-Identifier: Apache-2.0
"""``bench robots``: six arms in MuJoCo under what happens to a real one (docs/robots.md).

Each arm gets the parameter file of ``configure`` with a stated delay of 5 ms, untouched. What the
drives, the sensors and the surroundings do is said of the plant alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from functools import partial
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.bench.arms import ARMS, node_data, off_by
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_changes
from adaptive_blf_control.errors import BlfError, ParameterError
from adaptive_blf_control.runs.simulation import simulate
from adaptive_blf_control.runs.start_check import loop_warnings
from adaptive_blf_control.runs.torque_error import PredictedTorque
from adaptive_blf_control.runs.torque_use import oscillation_text
from adaptive_blf_control.simulation.sample import Sample
from adaptive_blf_control.tuning.node_values import node_settings_of
from adaptive_blf_control.tuning.recipe import Recipe, recipe
from adaptive_blf_control.tuning.robot import Robot
from adaptive_blf_control.tuning.stated_friction import arm_with_friction, sliding_velocity

__all__ = ['CONDITIONS', 'add_options', 'run']

LOADS = {'Panda': 2.0, 'UR10': 2.0, 'UR5': 2.0, 'Kinova j2s6s200': 1.1, 'xArm7': 1.75, 'Z1': 1.0}
"""Load at the tip [kg]: 2 kg or half of what the arm is rated for."""
ON, OFF = 10.0, 20.0  # s: of the load
TOUCH, RELEASE = 10.0, 11.0  # s: of the wall
AGAIN, RECOVERED = 3.0, 2.0  # s after a load, after a release
GAIN = 0.03  # error of the drives' gain
ROTOR, DRY = 1e-3, 0.01  # inertia of a rotor [kg m²] and dry friction [N m] over the torque limit
STATED = 0.2  # part by which the stated inertia of each rotor is wrong, up or down
EXACT = 1e-8  # part of a torque below which an error is that of the arithmetic
WEAK = 0.6  # part of the torque that the reference needs
SENSORS = {'encoder_counts': 200000, 'torque_noise': 0.05}
LATE = {'arm_driver.actuator.delay': 0.004}

Changes = dict[str, Any]


class Condition(NamedTuple):
    """A row of the table.

    Attributes:
        name: What it is called.
        stated: What ``configure`` is told, beside the delay.
        plant: Changes of the plant, from name and recipe.
        learned: Whether dry friction and rotor inertia are learned, the rotors stated with an
            error of 20 %; dry friction also where the URDF states any.
        start: ``nominal``, ``zero``, or ``off``: every link by 25 %.
        seconds: Length of a run that answers it [s].
    """

    name: str
    stated: Changes
    plant: Callable[[str, Recipe], Changes]
    learned: bool = False
    start: str = 'nominal'
    seconds: float = 20.0


class Case(NamedTuple):
    """A run: row, arm, seed, length [s], suspicion or None for the file's, part of the load."""

    condition: str
    arm: str
    seed: int
    seconds: float
    suspicion: float | None
    load: float = 1.0


class Run(NamedTuple):
    """What one run gave.

    Attributes:
        outside: Samples outside a set.
        away: Those that are not within contact or a second after it.
        left: Time of the first of them [s]; NaN: there is none.
        part: Largest |e1| over its bound.
        pred: Errors of the predicted torque over all joints and of the worst one: at the end,
            and where the row asks for them before and after an event; ``no θ``: of the θ that
            fits the plant best, at the end.
        noticed: Times from an event to its alarm [s]; NaN: none.
        frozen: Time from the touch until nothing is learned [s]; NaN: it was, all along.
        early: Alarms before the first event.
        found: Of `Identifier.found`.
        speed: Times real time.
        word: Of a joint that oscillates, or a run that ended early.
    """

    outside: int
    away: int
    left: float
    part: float
    pred: dict[str, tuple[float, float]]
    noticed: tuple[float, ...]
    frozen: float
    early: int
    found: dict[str, int]
    speed: float
    word: str


def _nothing(name: str, found: Recipe) -> Changes:
    return {'arm_driver.actuator.delay': 0.0}


def _late(name: str, found: Recipe) -> Changes:
    return dict(LATE)


def _real(name: str, found: Recipe) -> Changes:
    limit = found.torque_limit
    return {**LATE, 'arm_driver.true_friction.rotor_inertia': ROTOR * limit,
            'arm_driver.true_friction.coulomb': DRY * limit,
            'arm_driver.actuator.gain_error': [GAIN]}


def _schedule(times: list[float], what: str, values: list[float]) -> Changes:
    return {'arm_driver.schedule.time': times, 'arm_driver.schedule.value': values,
            'arm_driver.schedule.parameter': [what] * len(times)}


def _loaded(name: str, found: Recipe) -> Changes:
    return {**LATE, **_schedule([ON, OFF], 'payload', [LOADS[name], 0.0])}


def _loaded_real(name: str, found: Recipe) -> Changes:
    return {**_real(name, found), **_loaded(name, found)}


def _wall(name: str, found: Recipe) -> Changes:
    return {**LATE, **_schedule([TOUCH, RELEASE], 'contact', [1.0, 0.0])}


def _weak(name: str, found: Recipe) -> Changes:
    limit = WEAK * found.torque
    return {**LATE, 'arm_driver.torque_limit': limit, 'controller.torque_limit': limit}


def _instant(name: str, found: Recipe) -> Changes:
    return {'arm_driver.actuator.delay': 0.0015, 'arm_driver.actuator.effort': 'instant'}


def _tilted(name: str, found: Recipe) -> Changes:
    return {**LATE, 'arm_driver.mounting': [np.radians(30.0), 0.0, 0.0]}


CONDITIONS = {
    'ideal': Condition('ideal', {}, _nothing),
    'ideal-zero': Condition('ideal, θ̂(0) = 0', {'from_zero': True}, _nothing, start='zero'),
    'sensors-zero': Condition('sensors, θ̂(0) = 0', {**SENSORS, 'from_zero': True}, _late,
                              start='zero'),
    'sensors': Condition('sensors, URDF 25 % off', SENSORS, _late, start='off'),
    'real': Condition('+ rotors, dry friction, gain', SENSORS, _real, learned=True),
    'load': Condition('sensors + load', SENSORS, _loaded, seconds=OFF + AGAIN + 1.0),
    'load-real': Condition('+ rotors, dry friction, gain, load', SENSORS, _loaded_real,
                           learned=True, seconds=OFF + AGAIN + 1.0),
    'wall': Condition('sensors + wall', SENSORS, _wall, seconds=15.0),
    'wall-wide': Condition('sensors + wall, --width 0.3', {**SENSORS, 'width': 0.3}, _wall,
                           seconds=15.0),
    'wall-load': Condition('sensors + wall, a load stated', SENSORS, _wall, seconds=15.0),
    'weak': Condition('torque limits at 60 %', SENSORS, _weak),
    '500hz': Condition('500 Hz, instantaneous effort', {'rate': 500.0}, _instant),
    'tilted': Condition('base tilted 30°', SENSORS, _tilted),
}
"""Rows of the table."""


class _Watch:
    """What is asked of the identifier at every sample."""

    def __init__(self, identifier: Any) -> None:
        self._identifier = identifier
        self._alarms = 0
        self.alarms: list[float] = []
        self.learning: list[bool] = []

    def __call__(self, sample: Sample) -> None:
        identifier = self._identifier
        found = identifier.found
        alarms = max(found['alarms'], found['changes'])
        if alarms != self._alarms:
            self._alarms = alarms
            self.alarms.append(sample.t)
        self.learning.append(identifier.response == 'quiet')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare ``--condition``, ``--robot-seconds`` and ``--suspicion``, beside those of `arms`."""
    parser.add_argument('--condition', action='append', choices=tuple(CONDITIONS),
                        help='robots: which row; default: all')
    parser.add_argument('--robot-seconds', type=float, default=None, metavar='S',
                        help='robots: length of a run [s]; default: what answers the row')
    parser.add_argument('--suspicion', type=float, default=None, metavar='X',
                        help='robots: identifier.change.suspicion; default: as configure has it')
    parser.add_argument('--load-part', type=float, default=1.0, metavar='X',
                        help='robots: this part of the load of the rows with one (default 1)')
    parser.add_argument('--results', type=Path, default=None, metavar='FILE',
                        help='robots: append each run to this file, one JSON object a line, and '
                             'take over those that it has')


def run(options: argparse.Namespace) -> None:
    """Print the table.

    Raises:
        ParameterError: a length or a number of runs that cannot be.
    """
    seconds = options.robot_seconds
    if options.seeds < 1 or not (seconds is None or seconds > 0.0):
        raise ParameterError('--seeds, --robot-seconds', (options.seeds, seconds),
                             'at least 1, and a time > 0 s')
    if not 0.0 < options.load_part <= 2.0:
        raise ParameterError('--load-part', options.load_part, 'a part > 0, at most 2')
    print('| condition | arm | runs | samples outside | of them away from a contact | first [s] | '
          'largest \\|e1\\| of its bound [%] | pred at the end [%] | no θ is nearer than [%] | '
          'events: noticed after [ms] | pred after them [%] | alarms before | found | '
          'x real time | |')
    print('|' + '---|' * 15)
    for name in options.condition or CONDITIONS:
        for arm_name in options.arm or ARMS:
            cases = [Case(name, arm_name, seed, seconds or CONDITIONS[name].seconds,
                          options.suspicion, options.load_part)
                     for seed in range(options.seeds)]
            print(_row_of(CONDITIONS[name].name, arm_name, cases, options.results), flush=True)


def _row_of(condition: str, arm_name: str, cases: list[Case], results: Path | None) -> str:
    """Return the row of some runs; those that ended with an error are counted in its last word."""
    runs, errors = [], []
    for case in cases:
        try:
            runs.append(_recorded(case, results))
        except BlfError as error:
            errors.append(str(error))
    if not runs:
        return f'| {condition} | {arm_name} | refused: {errors[0]} |'
    if errors:
        text = f'{len(errors)} of {len(cases)} ended: {errors[0]}'
        runs[0] = runs[0]._replace(word='; '.join(filter(None, (runs[0].word, text))))
    return _row(condition, arm_name, runs)


def _recorded(case: Case, results: Path | None) -> Run:
    """Return a run, from a file of earlier ones where it is in there."""
    if results is None:
        return _run(case)
    if results.exists():
        for line in results.read_text(encoding='utf-8').splitlines():
            known = json.loads(line)
            if known['case'] == list(case):
                return Run(**known['run'])
    done = _run(case)
    with results.open('a', encoding='utf-8') as file:
        file.write(json.dumps({'case': case, 'run': done._asdict()}) + '\n')
    return done


def _run(case: Case) -> Run:
    name, arm_name, seed, seconds, suspicion, part = case
    condition = CONDITIONS[name]
    urdf, joints = ARMS[arm_name]
    payload = part * LOADS[arm_name] if 'load' in name else 0.0
    robot = Robot(delay=0.005, payload=payload, **condition.stated)
    make = partial(arm_with_friction, f'package://{urdf}', joints,
                   coulomb_velocity=sliding_velocity(robot))
    arm = make(coulomb=condition.learned or None)
    found = recipe(arm, robot)
    if condition.learned:
        arm = make(coulomb=True, rotor_inertia=_stated_rotors(found.torque_limit, seed))
        found = recipe(arm, replace(robot, torque_limit=tuple(found.torque_limit)))
    changes = {'arm_driver.plant': 'mujoco', 'arm_driver.sensors.seed': seed,
               **condition.plant(arm_name, found)}
    if name.startswith('load'):
        changes['arm_driver.schedule.value'] = [payload, 0.0]
    if suspicion is not None:
        changes['identifier.change.suspicion'] = suspicion
    if condition.start == 'off':
        changes['initial_estimate'] = off_by(arm, seed)
    data = apply_changes(node_data(node_settings_of(found, f'package://{urdf}')), changes)
    loop = build_closed_loop(data)
    list(loop_warnings(data, loop))
    watch = _Watch(loop.identifier)
    done = simulate(loop, seconds, observer=watch)
    return _judged(name, done, watch, arm)


def _stated_rotors(torque_limit: np.ndarray, seed: int) -> list[float]:
    """Return inertias of the rotors that are wrong by `STATED`, up or down, length n."""
    wrong = np.random.default_rng(seed).choice([-STATED, STATED], torque_limit.size)
    return (ROTOR * torque_limit * (1.0 + wrong)).tolist()


def _judged(name: str, done: Any, watch: _Watch, arm: UrdfArm) -> Run:
    loop, t = done.loop, done.t
    measure = PredictedTorque(loop.arm, loop.controller.reference, float(t[-1]))

    allowed = 1.0 + GAIN if name.endswith('real') else 1.0

    def pred(at: float) -> tuple[float, float]:
        k = min(int(np.searchsorted(t, at - 1e-9)), t.size - 1)
        return _all_and_worst(measure.rms_against(allowed * done.theta_hat[k], partial(
            loop.plant.inverse_dynamics, t=float(t[k]))))

    least = _all_and_worst(measure.least_against(partial(
        loop.plant.inverse_dynamics, t=float(t[-1]))))

    events, touched = _events(name, loop.plant), loop.plant.touched
    asked = {'end': float(t[-1])}
    if touched:
        asked |= {'before': touched[0][0] - 0.01, 'again': touched[-1][1] + RECOVERED}
    elif events:
        asked |= {f'again {i + 1}': event + AGAIN for i, event in enumerate(events)}
    inside = (done.loop.controller.performance, done.loop.controller.safety)
    out = np.zeros(t.size, dtype=bool)
    for values, sets in ((done.e1, inside[0]), (done.q, inside[1])):
        out |= ((values <= sets.lower) | (values >= sets.upper)).any(axis=1)
    away = out.copy()
    for begin, end in touched:
        away &= ~((t >= begin) & (t <= end + 1.0))
    bound = np.minimum(-inside[0].lower, inside[0].upper)
    word = f'ended: {done.failure}' if done.failure else oscillation_text(done.figures)
    if (misfit := done.gravity_misfit) is not None:
        word = (f'at {misfit.t:.2f} s gravity as told does not fit: looks tilted by '
                f'{np.degrees(misfit.tilt):.0f}°' + (f'; {word}' if word else ''))
    return Run(int(done.figures['set_violations']), int(away.sum()),
               float(t[out][0]) if out.any() else np.nan,
               float((np.abs(done.e1) / bound).max()),
               {'no θ': least, **{key: pred(at) for key, at in asked.items()}},
               tuple(_first(watch.alarms, event) for event in events),
               _frozen(watch, t, touched), sum(bool(a < min(events, default=np.inf))
                                               for a in watch.alarms),
               loop.identifier.found, float(done.figures['real_time_factor']), word)


def _all_and_worst(rms: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Return the error over all joints and of the worst one, from RMS error and RMS torque."""
    error, scale = rms
    return float(np.linalg.norm(error) / np.linalg.norm(scale)), float((error / scale).max())


def _events(name: str, plant: Any) -> tuple[float, ...]:
    if name.startswith('load'):
        return ON, OFF
    return tuple(begin for begin, _ in plant.touched[:1])


def _first(alarms: list[float], event: float) -> float:
    return min((alarm - event for alarm in alarms if alarm >= event), default=np.nan)


def _frozen(watch: _Watch, t: np.ndarray, touched: tuple[tuple[float, float], ...]) -> float:
    if not touched:
        return np.nan
    begin, end = touched[0]
    stopped = np.flatnonzero((t >= begin) & (t <= end) & ~np.array(watch.learning))
    return float(t[stopped[0]] - begin) if stopped.size else np.nan


def _percent(part: float) -> str:
    if part < EXACT:
        return '0'
    return f'{100.0 * part:.2g}' if part < 10.0 else 'lost'


def _row(condition: str, arm_name: str, runs: list[Run]) -> str:
    def pair(key: str) -> str:
        worst = [max(run.pred[key][i] for run in runs if key in run.pred) for i in range(2)]
        return ' / '.join(map(_percent, worst))

    events = [f'{1e3 * max(times):.0f}' for times in zip(*(run.noticed for run in runs))]
    if np.isfinite(runs[0].frozen):
        events.append(f'frozen {1e3 * max(run.frozen for run in runs):.0f}')
    after = [f'{key} {pair(key)}' for key in runs[0].pred if key not in ('end', 'no θ')]
    totals = {key: [run.found[key] for run in runs] for key in runs[0].found}
    found = ', '.join(f'{key} {max(values)}' for key, values in totals.items() if any(values))
    first = min((run.left for run in runs if np.isfinite(run.left)), default=None)
    words = '; '.join(dict.fromkeys(filter(None, (run.word for run in runs))))
    return (f'| {condition} | {arm_name} | {len(runs)} | {max(run.outside for run in runs)} | '
            f'{max(run.away for run in runs)} | {"" if first is None else f"{first:.2f}"} | '
            f'{100.0 * max(run.part for run in runs):.2g} | {pair("end")} | '
            f'{pair("no θ")} | {", ".join(events)} | {"; ".join(after)} | '
            f'{max(run.early for run in runs)} | {found} | '
            f'{min(run.speed for run in runs):.1f} | {words} |')
