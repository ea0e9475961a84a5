# SPDX-License-Identifier: Apache-2.0
"""``bench limits``: arms at their limits and beside obstacles, with and without the filter."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
import time
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.bench import limits_picture
from adaptive_blf_control.bench.arms import ARMS, node_data
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import (
    apply_changes,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.control.constraints import MotionState
from adaptive_blf_control.control.limit_settings import LimitSettings
from adaptive_blf_control.control.reference import full_range, Reference, ReferencePoint
from adaptive_blf_control.control.safety_filter import FilterSample, Governed
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.limits.filter_step import Scene
from adaptive_blf_control.limits.limit_constraints import ClearanceConstraint
from adaptive_blf_control.limits.link_spheres import sphere_centres
from adaptive_blf_control.limits.obstacles import sphere
from adaptive_blf_control.limits.safety_filter import LimitsFilter
from adaptive_blf_control.limits.scene import scene_of
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace
from adaptive_blf_control.tuning.node_values import node_settings_of
from adaptive_blf_control.tuning.recipe import recipe
from adaptive_blf_control.tuning.robot import Robot

__all__ = ['add_options', 'Case', 'cases', 'Figures', 'figures_of', 'row', 'run', 'TITLES']

TITLES = ('arm, plant', 'case', 'law', 'runs',
          'samples outside: position / velocity / e1 / obstacle',
          'worst margin [rad, rad/s, rad, m]', 'progress', 'from the path: mean, most [rad]',
          'let through / filtered / braking / softened',
          'time p50, p99 [µs]: let through; else; governor')
_LIMITS = 'controller.limits'
_OFF = {'controller.safety_filter': 'none'}
_ALONE = {f'{_LIMITS}.govern': False}
_FREE = {f'{_LIMITS}.obstacles.spheres': [0.0], f'{_LIMITS}.obstacles.half_spaces': [0.0]}
_PUSH = {'arm_driver.schedule.time': [3.0, 3.0, 3.0, 3.25, 3.25, 3.25],
         'arm_driver.schedule.value': [0.0, 25.0, 25.0, 0.0, 0.0, 0.0]}
_PUSHED = {'Panda': 'panda_link4', 'UR10': 'forearm_link'}
_TABLE = {'Panda': 0.2, 'UR10': 0.0}
_BOTH = 'governor and filter'
CLEAR = 0.06  # of the start, more than which is asked of a random scene [m]
SIGHTS = 20  # samples from one sight of a sphere that moves to the next


class MovingSphere(NamedTuple):
    """A sphere on a straight line.

    Attributes:
        begin: Where its centre is at the begin, shape (3,) [m].
        velocity: Shape (3,) [m/s].
        radius: Of the sphere [m].
    """

    begin: np.ndarray
    velocity: np.ndarray
    radius: float

    def at(self, t: float) -> np.ndarray:
        """Return its centre at ``t`` [s], shape (3,) [m]."""
        return self.begin + t * self.velocity


def _nothing(seed: int) -> MovingSphere | None:
    return None


@dataclass(frozen=True)
class Case:
    """A row of the table.

    Attributes:
        name: What is asked of the arm.
        arm: Name in `ARMS`.
        law: What answers.
        changes: Parameters that differ, for each seed.
        speed: Times the reference of the parameter file.
        plant: ``builtin`` or ``mujoco``.
        seeds: Of the runs.
        real: With sensors and delay, and the parameter file of ``configure``.
        towards: A joint that is sent beyond its limit, from 0.
        tight: Whether the safety set is no wider than reference and performance set need.
        moving: What moves, for each seed.
    """

    name: str
    arm: str
    law: str
    changes: Callable[[int], Mapping[str, Any]]
    speed: float = 1.0
    plant: str = 'builtin'
    seeds: tuple[int, ...] = (0,)
    real: bool = False
    towards: int | None = None
    tight: bool = False
    moving: Callable[[int], MovingSphere | None] = _nothing


@dataclass
class Figures:
    """What the runs of a case gave.

    Attributes:
        outside: Samples outside of positions, velocities, e1 and obstacles.
        worst: Smallest margins to them.
        progress: Path time over time, of each run.
        off: Distance of the reference from its path, of each sample [rad].
        counts: Samples by kind.
        times: Of samples that were let through, of others, and of the governor [µs].
        refused: Why there was no run.
    """

    outside: np.ndarray = field(default_factory=lambda: np.zeros(4, dtype=int))
    worst: np.ndarray = field(default_factory=lambda: np.full(4, np.inf))
    progress: list[float] = field(default_factory=list)
    off: list[float] = field(default_factory=list)
    counts: np.ndarray = field(default_factory=lambda: np.zeros(4, dtype=int))
    times: tuple[list[float], list[float], list[float]] = field(
        default_factory=lambda: ([], [], []))
    refused: str = ''


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare ``--limits-*``."""
    parser.add_argument('--limits-seconds', type=float, default=8.0, metavar='S',
                        help='limits: length of a run [s] (default %(default)g)')
    parser.add_argument('--limits-only', default='', metavar='TEXT',
                        help='limits: rows whose arm, plant or case contains it')
    parser.add_argument('--limits-seeds', type=int, default=5, metavar='N',
                        help='limits: runs of a row in which something is random '
                        '(default %(default)d)')
    parser.add_argument('--limits-png', type=Path, metavar='FILE',
                        help='limits: draw the picture of docs/limits.md instead of the table')
    parser.add_argument('--limits-scenes', type=int, default=200, metavar='N',
                        help='limits: random scenes (default %(default)d)')


def run(options: argparse.Namespace) -> None:
    """Print the table, row by row, or draw the picture."""
    if options.limits_png is not None:
        least = limits_picture.draw(options.limits_png, load_yaml(
            options.config / 'panda_obstacles.yaml'), options.limits_seconds)
        print(f'{options.limits_png}: closest {least[0]:.3f} m alone, {least[1]:.3f} m filtered')
        return
    print('| ' + ' | '.join(TITLES) + ' |\n' + '|---' * len(TITLES) + '|')
    seeds = tuple(range(options.limits_seeds))
    for case in cases(options.config, seeds, options.limits_scenes):
        if options.limits_only in f'{case.arm}, {case.plant}, {case.name}, {case.law}':
            print(row(case, figures_of(case, options.config, options.limits_seconds)),
                  flush=True)


def cases(config: Path, seeds: tuple[int, ...], scenes: int) -> Iterator[Case]:
    """Yield the rows.

    Args:
        config: Folder of the scenarios.
        seeds: Where something is random.
        scenes: Number of random scenes.
    """
    def always(*parts: Mapping[str, Any]) -> Callable[[int], Mapping[str, Any]]:
        return lambda seed: {name: value for part in parts for name, value in part.items()}

    def wrong(seed: int) -> Mapping[str, Any]:
        return _wrong_masses(config, seed)

    for arm in _PUSHED:
        for name, speed, there in (('reference x 1', 1.0, _FREE), ('reference x 3', 3.0, _FREE),
                                   ('x 1, sphere and table', 1.0, {}),
                                   ('x 2, sphere and table', 2.0, {})):
            yield Case(name, arm, 'law alone', always(there, _OFF), speed)
            if arm == 'Panda' and speed == 1.0:
                yield Case(name, arm, 'filter', always(there, _ALONE), speed)
            yield Case(name, arm, _BOTH, always(there), speed)
            if speed < 3.0 and there is not _FREE:
                yield Case(name, arm, _BOTH, always(there), speed, 'mujoco')
        for error, payload in ((0.2, 1.0), (0.3, 3.0)):
            heavy = {f'{_LIMITS}.prior.mass_error': error, f'{_LIMITS}.prior.payload': payload,
                     'arm_driver.payload': payload}
            yield Case(f'x 2, prior of {100 * error:.0f} % and {payload:g} kg, which it carries',
                       arm, _BOTH, always(_FREE, heavy), 2.0, tight=True)
        link = _PUSHED[arm]
        push = {**_PUSH, 'arm_driver.schedule.parameter': [
            f'torque.{link}.{axis}' for axis in 'xyzxyz']}
        for law, changes in (('law alone', _OFF), (_BOTH, {})):
            yield Case('x 1, sphere and table, push of 25 N m for 0.25 s', arm, law,
                       always(push, changes))
            yield Case('into a joint limit at full speed', arm, law, always(_FREE, changes),
                       towards=1)
            yield Case('sensors, noise and 4 ms, file of configure, sphere and table', arm, law,
                       lambda seed, changes=changes: {  # type: ignore[misc]
                           'arm_driver.sensors.seed': seed, **changes}, seeds=seeds, real=True)
    yield Case('masses 10 % off at random, sphere and table', 'Panda', _BOTH, wrong, seeds=seeds)
    for law, changes in (('law alone', _OFF), (_BOTH, {})):
        yield Case(f'{scenes} random scenes', 'Panda', law,
                   lambda seed, changes=changes: {  # type: ignore[misc]
                       **random_scene(config, seed), **changes}, seeds=tuple(range(scenes)),
                   moving=lambda seed: moving_sphere(config, seed))


def _base(config: Path, case: Case) -> dict[str, Any]:
    """Return the parameter file of a case."""
    panda = load_yaml(config / 'panda_obstacles.yaml')
    if case.arm == 'Panda' and not case.real:
        return apply_changes(_faster(panda, case.speed), {'arm_driver.plant': case.plant})
    urdf, joints = ARMS[case.arm]
    address = f'package://{urdf}'
    arm = load_arm(address, joints)
    robot = Robot(rate=1000.0, delay=0.004, encoder_counts=200000, torque_noise=0.05
                  ) if case.real else Robot(rate=1000.0, delay=0.0)
    data = node_data(node_settings_of(recipe(arm, robot), address))
    changes: dict[str, Any] = {'controller.safety_filter': 'limits', f'{_LIMITS}.period': 0.001,
                               f'{_LIMITS}.prior.mass_error': 0.1, 'arm_driver.plant': case.plant}
    if case.arm == 'Panda':
        given = node_settings(panda, ControllerNodeSettings).limits
        changes[f'{_LIMITS}.link_spheres'] = given.link_spheres.tolist()
    controller = build_closed_loop(apply_changes(data, {'controller.safety_filter': 'none'}))
    scene = _crossing(arm, controller.controller.reference, _TABLE[case.arm],
                      changes.get(f'{_LIMITS}.link_spheres'), np.random.default_rng(1))
    return apply_changes(_faster(data, case.speed), {**changes, **scene})


def _wrong_masses(config: Path, seed: int) -> Mapping[str, Any]:
    """Return the true parameters of a Panda whose links are 10 % off at random."""
    arm = load_arm(f'package://{ARMS["Panda"][0]}', ARMS['Panda'][1])
    assert isinstance(arm, UrdfArm)
    scale = 1.0 + np.random.default_rng(seed).uniform(-0.1, 0.1, (arm.n, 1))
    base = arm.base_from_inertial(arm.inertial * scale)
    friction = [1.5, 1.5, 1.2, 1.2, 0.6, 0.6, 0.4]
    return {'arm_driver.true_model': 'given',
            'arm_driver.true_parameters': [*base.tolist(), *friction]}


def _faster(data: Mapping[str, Any], speed: float) -> dict[str, Any]:
    """Return a parameter file's data with all frequencies of the reference higher."""
    reference = node_settings(data, ControllerNodeSettings).reference
    return apply_changes(dict(data), {
        f'controller.reference.{joint}.frequency': (speed * each.frequency).tolist()
        for joint, each in reference.of_joint.items()})


def random_scene(config: Path, seed: int) -> Mapping[str, Any]:
    """Return a table and up to three spheres in the way of the Panda, clear of its start."""
    arm, reference, spheres = _passing(config)
    random = np.random.default_rng(1000 + seed)
    return _crossing(arm, reference, random.uniform(-0.1, 0.2), spheres, random,
                     count=int(random.integers(1, 4)))


def moving_sphere(config: Path, seed: int) -> MovingSphere | None:
    """Return a sphere that crosses the way of the Panda when it is there, in every second scene.

    It comes at 0.05 to 0.2 m/s, horizontally, and is clear of the arm's start when that starts.
    """
    if seed % 2:
        return None
    arm, reference, spheres = _passing(config)
    random = np.random.default_rng(2000 + seed)
    given = _scene_with(arm, spheres)
    start = sphere_centres(given.chain, given.spheres, reference.at(0.0).position)
    while True:
        when, angle = random.uniform(3.0, 8.0), random.uniform(-np.pi, np.pi)
        there = sphere_centres(given.chain, given.spheres, reference.at(when).position)
        centre = there[random.integers(there.shape[0] // 2, there.shape[0])]
        velocity = random.uniform(0.05, 0.2) * np.array([np.cos(angle), np.sin(angle), 0.0])
        moving = MovingSphere(centre - when * velocity, velocity, random.uniform(0.04, 0.1))
        apart = np.linalg.norm(start - moving.begin, axis=1) - given.spheres.radius
        if apart.min() - moving.radius > CLEAR:
            return moving


def _passing(config: Path) -> tuple[Any, Reference, list[float]]:
    """Return arm, reference and link spheres of the Panda beside obstacles."""
    data = load_yaml(config / 'panda_obstacles.yaml')
    loop = build_closed_loop(apply_changes(data, dict(_OFF)))
    settings = node_settings(data, ControllerNodeSettings).limits
    return loop.arm, loop.controller.reference, settings.link_spheres.tolist()


def _scene_with(arm: Any, spheres: Any) -> Scene:
    """Return the link spheres of an arm, without obstacles."""
    limits = {'link_spheres': spheres} if spheres else {}
    return scene_of(arm, LimitSettings(**limits).resolved(joints=arm.n))


def _crossing(arm: Any, reference: Reference, table: float, spheres: Any,
              random: np.random.Generator, count: int = 1) -> dict[str, Any]:
    """Return obstacles near what the links of an arm pass, and clear of where they start."""
    given = _scene_with(arm, spheres)
    chain, links = given.chain, given.spheres
    start = sphere_centres(chain, links, reference.at(0.0).position)
    rows: list[float] = []
    while len(rows) < 4 * count:
        centres = sphere_centres(chain, links, reference.at(random.uniform(1.5, 8.0)).position)
        centre = centres[random.integers(centres.shape[0] // 2, centres.shape[0])]
        centre = centre + random.normal(0.0, 0.05, 3)
        radius = random.uniform(0.04, 0.12)
        apart = np.linalg.norm(start - centre, axis=1) - links.radius - radius
        if apart.min() > CLEAR and centre[2] > table:
            rows += [*centre.tolist(), radius]
    low = (start[:, 2] - links.radius).min() - CLEAR
    return {f'{_LIMITS}.obstacles.spheres': rows,
            f'{_LIMITS}.obstacles.half_spaces': [0.0, 0.0, min(table, low), 0.0, 0.0, 1.0]}


class _Onwards:
    """A reference with a joint that goes on beyond its limit at full speed."""

    def __init__(self, inner: Reference, joint: int, speed: float, lower: float, upper: float,
                 ) -> None:
        self._inner, self._joint = inner, joint
        self._speed, self._bounds = speed, (lower, upper)

    def at(self, t: float) -> ReferencePoint:
        """Return the reference, the joint swinging twice as wide as it may."""
        point = ReferencePoint(*(part.copy() for part in self._inner.at(t)))
        middle, half = 0.5 * sum(self._bounds), self._bounds[1] - self._bounds[0]
        w, j = self._speed / half, self._joint
        ramp = min(t / 2.0, 1.0)
        for place, value in enumerate((np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t))):
            part = point[place]
            offset = middle if place == 0 else 0.0
            part[j] = (1.0 - ramp) * part[j] + ramp * (offset + half * value)
        return point

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the range, that of the joint as wide as it is."""
        lower, upper = (part.copy() for part in self._inner.range())
        lower[self._joint] -= 10.0
        upper[self._joint] += 10.0
        return lower, upper


class _Timed:
    """Takes the time of each sample of a safety filter and of its governor.

    Attributes:
        kinds: What became of the torque of each sample.
        times: Of the filter [µs].
        governing: Of the governor [µs].
        off: Distance of the reference from its path [rad].
    """

    def __init__(self, inner: LimitsFilter, moving: MovingSphere | None = None) -> None:
        """Stand before both from now on, and show the filter what moves."""
        self._moving = moving
        self._inner, self._filtered = inner, inner.filtered
        vars(inner)['filtered'] = self.filtered
        self.kinds: list[int] = []
        self.times: list[float] = []
        self.governing: list[float] = []
        self.off: list[float] = []
        if inner.governor is not None:
            self._governed = inner.governor.governed
            vars(inner.governor)['governed'] = self.governed

    def filtered(self, sample: FilterSample) -> np.ndarray:
        """Return what the filter does."""
        begin = time.perf_counter()
        torque = self._filtered(sample)
        self.times.append(1e6 * (time.perf_counter() - begin))
        assert self._inner.report is not None
        self.kinds.append(self._inner.report.kind)
        if self._inner.governor is not None:
            self.off.append(self._inner.governor.off)
        if self._moving is not None and len(self.kinds) % SIGHTS == 1:
            place = self._moving.at(sample.t).tolist()
            self._inner.see({'ball': sphere(place, self._moving.radius)}, frozenset())
        return torque

    def governed(self, t: float, q: np.ndarray, reference: Reference) -> Governed:
        """Return what the governor does."""
        begin = time.perf_counter()
        result = self._governed(t, q, reference)
        self.governing.append(1e6 * (time.perf_counter() - begin))
        return result


def figures_of(case: Case, config: Path, duration: float) -> Figures:
    """Run a case for ``duration`` [s] with each seed."""
    figures = Figures()
    for seed in case.seeds:
        try:
            loop = _loop(case, config, seed)
        except BlfError as error:
            figures.refused = str(error)
            continue
        _add(figures, loop, duration, case.moving(seed))
    return figures


def _loop(case: Case, config: Path, seed: int) -> ClosedLoop:
    data = apply_changes(_base(config, case), dict(case.changes(seed)))
    if case.tight:
        settings = node_settings(data, ControllerNodeSettings)
        trial = build_closed_loop(apply_changes(data, dict(_OFF)))
        lower, upper = full_range(trial.controller.reference)
        width = float(settings.performance.upper.max()) + 0.02
        data = apply_changes(data, {'controller.safety.lower': (lower - width).tolist(),
                                    'controller.safety.upper': (upper + width).tolist()})
    loop = build_closed_loop(data)
    loop.warm_up()  # before a reference that no controller would take at its start
    if case.towards is not None:
        controller, j = loop.controller, case.towards
        assert isinstance(loop.arm, UrdfArm)
        speed = float(np.broadcast_to(loop.arm.velocity_limit, loop.arm.n)[j])
        controller.follow(_Onwards(controller.reference, j, speed, controller.safety.lower[j],
                                   controller.safety.upper[j]))
    return loop


def _add(figures: Figures, loop: ClosedLoop, duration: float,
         moving: MovingSphere | None) -> None:
    inner, timed = loop.controller.safety_filter, None
    if isinstance(inner, LimitsFilter):
        timed = _Timed(inner, moving)
    trace = loop.run(duration)
    for k, part in enumerate(_margins(loop, trace, moving)):
        figures.outside[k] += int((part < 0.0).sum())
        figures.worst[k] = min(figures.worst[k], part.min())
    if timed is None or not isinstance(inner, LimitsFilter):
        figures.progress.append(1.0)
        return
    figures.progress.append(1.0 if inner.governor is None else
                            inner.governor.pace.time / trace.t[-1])
    figures.counts += inner.counts
    figures.off += timed.off
    for kind, spent in zip(timed.kinds, timed.times):
        figures.times[min(kind, 1)].append(spent)
    figures.times[2].extend(timed.governing)


def row(case: Case, figures: Figures) -> str:
    """Return a row of the table."""
    head = f'| {case.arm}, {case.plant} | {case.name} | {case.law} | {len(figures.progress)} | '
    if not figures.progress:
        return head + f'refused: {figures.refused} |' + ' |' * 5
    there = np.isfinite(figures.worst)
    outside = ' / '.join(str(count) if is_there else '–'
                         for count, is_there in zip(figures.outside, there))
    worst = ', '.join(f'{value:.3f}' for value in figures.worst[there])
    progress = np.array(figures.progress)
    shown = f'{np.median(progress):.2f}' + (
        f' ({progress.min():.2f} to {progress.max():.2f})' if progress.size > 1 else '')
    off = f'{np.mean(figures.off):.2f}, {np.max(figures.off):.2f}' if figures.off else ''
    spent = '; '.join(', '.join(f'{value:.0f}' for value in np.percentile(part, (50, 99)))
                      if part else '–' for part in figures.times) if any(figures.times) else ''
    counts = ' / '.join(map(str, figures.counts)) if figures.counts.any() else ''
    refused = f' ({len(case.seeds) - progress.size} refused)' if figures.refused else ''
    return f'{head}{outside} | {worst} | {shown}{refused} | {off} | {counts} | {spent} |'


def _margins(loop: ClosedLoop, trace: Trace,
             moving: MovingSphere | None) -> Iterator[np.ndarray]:
    """Yield the smallest margin to positions, velocities, e1 and obstacles, (N,) each."""
    controller, arm = loop.controller, loop.arm
    speed = getattr(arm, 'velocity_limit', np.inf)
    yield controller.safety.margin(trace.q).min(axis=1)
    yield (speed - np.abs(trace.qd)).min(axis=1)
    yield controller.performance.margin(trace.e1).min(axis=1)
    scene = scene_of(arm, controller.settings.limits)
    if scene.obstacles.radius.size:
        near = ClearanceConstraint(scene)
        bounds = controller.bounds(0.0)
        clear = np.array([near.bounded(MotionState(t, q, qd, e1, bounds)).margin().min()
                          for t, q, qd, e1 in zip(trace.t, trace.q, trace.qd, trace.e1)])
        if moving is not None:
            clear = np.minimum(clear, [
                (np.linalg.norm(sphere_centres(scene.chain, scene.spheres, q) - moving.at(t),
                                axis=1) - scene.spheres.radius).min() - moving.radius
                for t, q in zip(trace.t, np.ascontiguousarray(trace.q))])
        yield clear
