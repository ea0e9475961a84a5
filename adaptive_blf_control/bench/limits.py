# SPDX-License-Identifier: Apache-2.0
"""``bench limits``: the Panda beside a sphere and a table, with and without the safety filter."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import time
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.configuration.build import build_closed_loop
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import apply_changes, node_settings
from adaptive_blf_control.control.constraints import MotionState
from adaptive_blf_control.control.safety_filter import FilterSample
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.limits.limit_constraints import ClearanceConstraint
from adaptive_blf_control.limits.safety_filter import LimitsFilter
from adaptive_blf_control.limits.scene import scene_of
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace

__all__ = ['Case', 'cases', 'row', 'TITLES']

TITLES = ('case', 'law', 'outside: position / velocity / e1 / obstacle',
          'worst margin [rad, rad/s, rad, m]', 'progress', 'idle / active / braking / softened',
          'idle p50, p99; other p50, p99 [µs]')
_OFF = {'controller.safety_filter': 'none'}
_ALONE = {'controller.limits.govern': False}
_FREE = {'controller.limits.obstacles.spheres': [0.0],
         'controller.limits.obstacles.half_spaces': [0.0]}


class Case(NamedTuple):
    """A row of the table.

    Attributes:
        name: What is asked of the arm.
        law: What answers.
        speed: Times the reference of the parameter file.
        changes: Parameters that differ.
    """

    name: str
    law: str
    speed: float
    changes: Mapping[str, Any]


def cases() -> Iterator[Case]:
    """Yield the rows."""
    for name, speed, scene in (('reference x 1', 1.0, _FREE), ('reference x 3', 3.0, _FREE),
                               ('x 1, sphere and table', 1.0, {}),
                               ('x 2, sphere and table', 2.0, {})):
        yield Case(name, 'law alone', speed, {**scene, **_OFF})
        if speed != 2.0:
            yield Case(name, 'filter', speed, {**scene, **_ALONE})
        yield Case(name, 'governor and filter', speed, scene)
    for error, payload in ((0.2, 1.0), (0.3, 3.0)):
        heavy = {'controller.limits.prior.mass_error': error,
                 'controller.limits.prior.payload': payload, 'arm_driver.payload': payload}
        yield Case(f'x 2, prior of {100 * error:.0f} % and {payload:g} kg, which the arm carries',
                   'governor and filter', 2.0, {**_FREE, **heavy})


class _Timed:
    """A safety filter with the time that each sample takes."""

    def __init__(self, inner: LimitsFilter) -> None:
        self._inner = inner
        self.kinds: list[int] = []
        self.times: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def filtered(self, sample: FilterSample) -> np.ndarray:
        begin = time.perf_counter()
        torque = self._inner.filtered(sample)
        self.times.append(1e6 * (time.perf_counter() - begin))
        assert self._inner.report is not None
        self.kinds.append(self._inner.report.kind)
        return torque


def row(data: Mapping[str, Any], case: Case, duration: float) -> str:
    """Run a case for ``duration`` [s] and return its row of the table."""
    try:
        loop = build_closed_loop(apply_changes(_faster(data, case.speed), dict(case.changes)))
    except BlfError as error:
        return f'| {case.name} | {case.law} | refused: {error} |  |  |  |  |'
    loop.warm_up()
    inner, timed = loop.controller.safety_filter, None
    if isinstance(inner, LimitsFilter):
        loop.controller.safety_filter = timed = _Timed(inner)
    trace = loop.run(duration)
    margins = list(_margins(loop, trace))
    outside = ' / '.join(str(int((part < 0.0).sum())) for part in margins)
    worst = ', '.join(f'{part.min():.3f}' for part in margins)
    if timed is None or not isinstance(inner, LimitsFilter):
        return f'| {case.name} | {case.law} | {outside} | {worst} | 1 |  |  |'
    progress = 1.0 if inner.governor is None else inner.governor.pace.time / trace.t[-1]
    kinds, times = np.array(timed.kinds), np.array(timed.times)
    spent = '; '.join(', '.join(f'{value:.0f}' for value in np.percentile(part, (50, 99)))
                      for part in (times[kinds == 0], times[kinds > 0]) if part.size)
    return (f'| {case.name} | {case.law} | {outside} | {worst} | {progress:.2f} | '
            f'{" / ".join(map(str, inner.counts))} | {spent} |')


def _faster(data: Mapping[str, Any], speed: float) -> dict[str, Any]:
    """Return a parameter file's data with all frequencies of the reference higher."""
    reference = node_settings(data, ControllerNodeSettings).reference
    return apply_changes(dict(data), {
        f'controller.reference.{joint}.frequency': (speed * each.frequency).tolist()
        for joint, each in reference.of_joint.items()})


def _margins(loop: ClosedLoop, trace: Trace) -> Iterator[np.ndarray]:
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
        yield np.array([near.bounded(MotionState(t, q, qd, e1, bounds)).margin().min()
                        for t, q, qd, e1 in zip(trace.t, trace.q, trace.qd, trace.e1)])
