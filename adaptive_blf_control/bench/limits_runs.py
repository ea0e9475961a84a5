# SPDX-License-Identifier: Apache-2.0
"""Runs of ``bench limits``: one closed loop each, what left its limits, and what it took."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import time
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.bench.limits_cases import Case, data_of, NO_FILTER, with_learning
from adaptive_blf_control.bench.limits_scenes import MovingSphere
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import apply_changes, node_settings
from adaptive_blf_control.control.constraints import MotionState
from adaptive_blf_control.control.reference import full_range, Reference, ReferencePoint
from adaptive_blf_control.control.safety_filter import FilterSample, Governed
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.limits.limit_constraints import ClearanceConstraint
from adaptive_blf_control.limits.link_spheres import sphere_centres
from adaptive_blf_control.limits.obstacles import sphere
from adaptive_blf_control.limits.safety_filter import LimitsFilter
from adaptive_blf_control.limits.scene import scene_of
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace

__all__ = ['loop_of', 'run_of', 'RunFigures', 'Timed']

SIGHTS = 20  # samples from one sight of a sphere that moves to the next


class RunFigures(NamedTuple):
    """What one run gave.

    Attributes:
        outside: Samples outside of positions, velocities, e1 and obstacles.
        worst: Smallest margins to them [rad, rad/s, rad, m]; inf for what is not there.
        progress: Path time over time.
        off: Distance of the reference from its path, mean and most [rad]; empty without a filter.
        counts: Samples by kind; empty without a filter.
        times: Median and 99th percentile of the processor's time for a sample that was let
            through, another one, and the governor [µs]; empty where there was none.
        refused: Why there was no run; '' where there was one.
    """

    outside: list[int] = []
    worst: list[float] = []
    progress: float = 1.0
    off: list[float] = []
    counts: list[int] = []
    times: list[list[float]] = [[], [], []]
    refused: str = ''


def run_of(case: Case, config: Path, duration: float, seed: int) -> RunFigures:
    """Run a case for ``duration`` [s] with a seed."""
    try:
        loop = loop_of(case, config, seed)
    except BlfError as error:
        return RunFigures(refused=str(error))
    moving = case.moving(seed)
    inner, timed = loop.controller.safety_filter, None
    if isinstance(inner, LimitsFilter):
        timed = Timed(inner, moving)
    trace = loop.run(duration)
    margins = list(_margins(loop, trace, moving))
    margins += [np.array([np.inf])] * (4 - len(margins))
    outside = [int((part < 0.0).sum()) for part in margins]
    worst = [float(part.min()) for part in margins]
    if timed is None or not isinstance(inner, LimitsFilter):
        return RunFigures(outside, worst)
    progress = 1.0 if inner.governor is None else inner.governor.pace.time / trace.t[-1]
    spent: tuple[list[float], ...] = ([], [], timed.governing)
    for kind, each in zip(timed.kinds, timed.times):
        spent[min(kind, 1)].append(each)
    return RunFigures(
        outside, worst, float(progress),
        [float(np.mean(timed.off)), float(np.max(timed.off))] if timed.off else [],
        list(inner.counts),
        [np.percentile(part, (50, 99)).tolist() if part else [] for part in spent])


def loop_of(case: Case, config: Path, seed: int) -> ClosedLoop:
    """Return the closed loop of a run.

    Raises:
        BlfError: what its parameters cannot have.
    """
    data = apply_changes(data_of(config, case), dict(case.changes(seed)))
    if case.tight:
        settings = node_settings(data, ControllerNodeSettings)
        trial = build_closed_loop(apply_changes(data, dict(NO_FILTER)))
        lower, upper = full_range(trial.controller.reference)
        width = float(settings.performance.upper.max()) + 0.02
        data = apply_changes(data, {'controller.safety.lower': (lower - width).tolist(),
                                    'controller.safety.upper': (upper + width).tolist()})
    loop = build_closed_loop(with_learning(data) if case.learns else data)
    loop.warm_up()  # before a reference that no controller would take at its start
    if case.towards is not None:
        controller, j = loop.controller, case.towards
        assert isinstance(loop.arm, UrdfArm)
        speed = float(np.broadcast_to(loop.arm.velocity_limit, loop.arm.n)[j])
        controller.follow(_Onwards(controller.reference, j, speed, controller.safety.lower[j],
                                   controller.safety.upper[j]))
    return loop


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


class Timed:
    """Takes the time of each sample of a safety filter and of its governor.

    Attributes:
        kinds: What became of the torque of each sample.
        times: Of the processor for the filter [µs].
        governing: Likewise for the governor [µs].
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
        begin = time.thread_time()
        torque = self._filtered(sample)
        self.times.append(1e6 * (time.thread_time() - begin))
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
        begin = time.thread_time()
        result = self._governed(t, q, reference)
        self.governing.append(1e6 * (time.thread_time() - begin))
        return result


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
