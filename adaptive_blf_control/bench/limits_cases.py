# SPDX-License-Identifier: Apache-2.0
"""The rows of ``bench limits``: what is asked of which arm, beside what, and what answers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.bench.arms import ARMS, node_data
from adaptive_blf_control.bench.limits_scenes import (
    crossing,
    moving_sphere,
    MovingSphere,
    random_scene,
)
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import (
    apply_changes,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.tuning.node_values import node_settings_of
from adaptive_blf_control.tuning.recipe import recipe
from adaptive_blf_control.tuning.robot import Robot

__all__ = ['Case', 'cases', 'data_of', 'DURATION', 'NO_FILTER', 'with_learning']

_LIMITS = 'controller.limits'
NO_FILTER = {'controller.safety_filter': 'none'}
_ALONE = {f'{_LIMITS}.govern': False}
_FREE = {f'{_LIMITS}.obstacles.spheres': [0.0], f'{_LIMITS}.obstacles.half_spaces': [0.0],
         'arm_driver.mujoco.fixtures.spheres': [0.0],
         'arm_driver.mujoco.fixtures.half_spaces': [0.0]}
_PUSH = {'arm_driver.schedule.time': [3.0, 3.0, 3.0, 3.25, 3.25, 3.25],
         'arm_driver.schedule.value': [0.0, 25.0, 25.0, 0.0, 0.0, 0.0]}
_RULES: Mapping[str, Mapping[str, Any]] = {
    '': {}, ', short stops': {f'{_LIMITS}.braking_rule': 'short_stops'}}
_PUSHED = {'Panda': 'panda_link4', 'UR10': 'forearm_link'}
_TABLE = {'Panda': 0.2, 'UR10': 0.0}
_BOTH = 'governor and filter'
LEARNED = ', learned'
DURATION, OF_SCENES = 8.0, 10.0  # of a run [s]
SPEEDS = ((0.05, 0.2), (0.2, 0.5))  # from which to which a sphere comes [m/s]


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
        learns: Whether the identifier narrows the prior.
        moving: What moves, for each seed.
        duration: Of a run [s].
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
    learns: bool = False
    moving: Callable[[int], MovingSphere | None] = _nothing
    duration: float = DURATION


def cases(config: Path, seeds: tuple[int, ...], scenes: int) -> Iterator[Case]:
    """Yield the rows.

    Args:
        config: Folder of the scenarios.
        seeds: Where something is random.
        scenes: Number of random scenes.
    """
    def wrong(seed: int) -> Mapping[str, Any]:
        return _wrong_masses(config, seed)

    for arm in _PUSHED:
        for case in _arm_cases(arm, seeds):
            yield case
            if case.law == _BOTH:
                yield replace(case, plant='mujoco')
    yield Case('masses 10 % off at random, sphere and table', 'Panda', _BOTH, wrong, seeds=seeds)
    yield from _delay_cases()
    yield from _scene_cases(config, tuple(range(scenes)))


def _always(*parts: Mapping[str, Any]) -> Callable[[int], Mapping[str, Any]]:
    return lambda seed: {name: value for part in parts for name, value in part.items()}


def _push(arm: str) -> Mapping[str, Any]:
    return {**_PUSH, 'arm_driver.schedule.parameter': [
        f'torque.{_PUSHED[arm]}.{axis}' for axis in 'xyzxyz']}


def _heavy(error: float, payload: float) -> Mapping[str, Any]:
    return {f'{_LIMITS}.prior.mass_error': error, f'{_LIMITS}.prior.payload': payload,
            'arm_driver.payload': payload}


def _arm_cases(arm: str, seeds: tuple[int, ...]) -> Iterator[Case]:
    for name, speed, there in (('reference x 1', 1.0, _FREE), ('reference x 3', 3.0, _FREE),
                               ('x 1, sphere and table', 1.0, {}),
                               ('x 2, sphere and table', 2.0, {})):
        yield Case(name, arm, 'law alone', _always(there, NO_FILTER), speed)
        if arm == 'Panda' and speed == 1.0:
            yield Case(name, arm, 'filter', _always(there, _ALONE), speed)
        yield Case(name, arm, _BOTH, _always(there), speed)
        if speed > 1.0:
            yield Case(name + LEARNED, arm, _BOTH, _always(there), speed, learns=True)
    for error, payload in ((0.2, 1.0), (0.3, 3.0)):
        name = f'x 2, prior of {100 * error:.0f} % and {payload:g} kg, which it carries'
        yield from _with_rules(Case(name, arm, _BOTH, _always(_FREE, _heavy(error, payload)), 2.0,
                                    tight=True))
    for learns in (False, True):
        yield Case('x 1, sphere and table, push of 25 N m for 0.25 s, short stops'
                   f'{LEARNED if learns else ""}', arm, _BOTH,
                   _always(_push(arm), _RULES[', short stops']), learns=learns)
    for law, changes in (('law alone', NO_FILTER), (_BOTH, {})):
        yield Case('x 1, sphere and table, push of 25 N m for 0.25 s', arm, law,
                   _always(_push(arm), changes))
        yield Case('into a joint limit at full speed', arm, law, _always(_FREE, changes),
                   towards=1)
        yield Case('sensors, noise and 4 ms, file of configure, sphere and table', arm, law,
                   lambda seed, changes=changes: {  # type: ignore[misc]
                       'arm_driver.sensors.seed': seed, **changes}, seeds=seeds, real=True)


def _with_rules(case: Case) -> Iterator[Case]:
    """Yield a case with each rule of braking, with the prior alone and with what is learned."""
    for words, rule in _RULES.items():
        changes = {**case.changes(0), **rule}
        for learns in (False, True):
            yield replace(case, name=f'{case.name}{words}{LEARNED if learns else ""}',
                          changes=_always(changes), learns=learns)


def with_learning(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return a parameter file in which the identifier narrows the prior of the safety filter."""
    prior = node_settings(data, ControllerNodeSettings).limits.prior.values()
    return apply_changes(data, {
        f'{_LIMITS}.learn': True, 'identifier.parameter_set.period': 0.02,
        **{f'identifier.parameter_set.prior.{name}': value for name, value in prior.items()}})


def _delay_cases() -> Iterator[Case]:
    exact: Mapping[str, Any] = {'controller.loop.delay': 0.0, 'arm_driver.actuator.delay': 0.0,
                                f'{_LIMITS}.period': 0.0}
    yield Case('x 1, sphere and table, push of 25 N m for 0.25 s, no delay, held for 1 ms',
               'Panda', _BOTH, _always(_push('Panda'), exact))
    name = 'x 2, prior of 30 % and 3 kg, which it carries, no delay, held for 1 ms'
    yield from _with_rules(Case(name, 'Panda', _BOTH, _always(_FREE, exact, _heavy(0.3, 3.0)),
                                2.0, tight=True))
    late = {'arm_driver.actuator.jitter': 0.001}
    for stated, told in (('1 ms', late), ('none', {**late, 'controller.loop.delay': 0.0})):
        yield Case(f'x 1, sphere and table, delay of 1 to 2 ms, {stated} stated', 'Panda', _BOTH,
                   _always(told))


def _scene_cases(config: Path, numbers: tuple[int, ...]) -> Iterator[Case]:
    for law, changes in (('law alone', NO_FILTER), (_BOTH, {})):
        def scene(seed: int, changes: Mapping[str, Any] = changes) -> Mapping[str, Any]:
            return {**random_scene(config, seed), **changes}

        ways = (False,) if changes is NO_FILTER else (False, True)
        for learns in ways:
            yield Case(f'random scenes{LEARNED if learns else ""}', 'Panda', law, scene,
                       seeds=numbers, learns=learns, duration=OF_SCENES)
        for slowest, fastest in SPEEDS:
            def moving(seed: int, slowest: float = slowest,
                       fastest: float = fastest) -> MovingSphere:
                return moving_sphere(config, seed, slowest, fastest)

            for learns in ways:
                yield Case(f'random scenes, a sphere comes at {slowest:g} to {fastest:g} m/s'
                           f'{LEARNED if learns else ""}', 'Panda', law, scene, seeds=numbers,
                           moving=moving, learns=learns, duration=OF_SCENES)


def data_of(config: Path, case: Case) -> dict[str, Any]:
    """Return the parameter file of a case."""
    panda = load_yaml(config / 'panda_obstacles.yaml')
    if case.arm == 'Panda' and not case.real:
        stated = node_settings(panda, ControllerNodeSettings).loop.delay
        return apply_changes(_faster(panda, case.speed), {
            'arm_driver.plant': case.plant, 'arm_driver.actuator.delay': stated})
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
    controller = build_closed_loop(apply_changes(data, NO_FILTER))
    scene = crossing(arm, controller.controller.reference, _TABLE[case.arm],
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
