# SPDX-License-Identifier: Apache-2.0
"""A closed loop whose parts are all ours, run in blocks of samples by one compiled function."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.regressors import arrays_of
from adaptive_blf_control.compiled import handle
from adaptive_blf_control.control.constraints import MotionState
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.reference import along, ReferencePoint
from adaptive_blf_control.control.sets import Bounds
from adaptive_blf_control.control.step import new_answer
from adaptive_blf_control.identification.change_monitor import external_torque
from adaptive_blf_control.identification.excitation import PARTS
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.simulation.block import (
    Block,
    BlockInputs,
    LoopArrays,
    LoopMemory,
    observed_rows,
    ObservedRows,
    run_block,
    trace_rows,
    TraceRows,
)
from adaptive_blf_control.simulation.plant import Plant, SimulatedArm
from adaptive_blf_control.simulation.sample import Sample
from adaptive_blf_control.simulation.sensors import Measurement, sensor_arrays, torque_noise

__all__ = ['BlockRun', 'LoopParts', 'parts_in_python']

LONGEST = 1000  # samples of a block that is observed: few enough to stay in the processor's cache
LONGEST_UNSEEN = 20_000  # of one that is not: each call costs as much as hundreds of its samples
Observer = Callable[[Sample], None]


class LoopParts(NamedTuple):
    """The parts of a closed loop, see `ClosedLoop`.

    Attributes:
        plant: What is driven.
        controller: The law.
        identifier: Learns along.
        period: Sample interval [s].
        initial_estimate: θ the controller starts with, shape (m,).
        known: Whether it keeps that θ.
    """

    plant: Plant
    controller: Controller
    identifier: Identifier
    period: float
    initial_estimate: np.ndarray
    known: bool


def parts_in_python(parts: LoopParts) -> tuple[str, ...]:
    """Return the parts of a loop that can only be asked one sample at a time, in words."""
    plant, controller, identifier = parts[:3]
    found = []
    if not isinstance(plant, SimulatedArm) or plant.arrays() is None:
        found.append(f'plant {type(plant).__name__}')
    elif sensor_arrays(plant.sensor, controller.arm.n) is None:
        found.append('sensor')
    if type(controller) is not Controller or controller.arrays is None:
        law = getattr(controller, 'law', controller)
        found.append(f'controller with {type(getattr(law, "given", law)).__name__} '
                     f'of {type(controller.arm).__name__}')
    if type(identifier) is not Identifier or identifier.state is None:
        found.append(f'identifier of {type(identifier.arm).__name__}')
    return tuple(found)


class _Span(NamedTuple):
    """A block of a run: its samples are those from ``begin`` to before ``end``."""

    begin: int
    end: int


class BlockRun:
    """Runs a loop in which nothing is in Python, see `parts_in_python`."""

    def __init__(self, parts: LoopParts) -> None:
        """Take the parts; the controller starts with the initial estimate."""
        self._parts, self._arm = parts, parts.controller.arm
        self._plant: Any = parts.plant
        self._memory = LoopMemory(parts.initial_estimate.copy(), np.zeros(self._arm.m),
                                  new_answer(self._arm.n, self._arm.m))

    def run(self, times: np.ndarray, trace: TraceRows, observer: Observer | None) -> None:
        """Run the samples at ``times``, (N,) [s], and write their rows of the trace."""
        for block in self._blocks(times.size, observer is not None):
            rows = _rows(trace, block)
            given, observed = self._given(times, block), self._room(block, observer)
            before = self._parts.identifier.excitation if observer is not None else None
            arrays = self._arrays(block.end - block.begin)
            run_block(handle(Block(arrays, self._memory, given, rows, observed)))
            self._plant.take(arrays.plant)
            if observer is not None:
                for sample in self._samples(given, rows, observed, before):
                    observer(sample)

    def warm_up(self) -> None:
        """Compile the block, without a trace in the loop."""
        arm = self._arm
        given = self._given(np.zeros(1), _Span(0, 1), noise=np.zeros((1, arm.n)))
        run_block(handle(Block(_copied(self._arrays(1)), _copied(self._memory), given,
                               trace_rows(1, arm.n, arm.m), observed_rows(0, arm.n, arm.m))))

    def _arrays(self, samples: int) -> LoopArrays:
        plant: Any = self._plant
        controller: Any = self._parts.controller
        identifier: Any = self._parts.identifier
        sensor: Any = sensor_arrays(plant.sensor, self._arm.n)
        return LoopArrays(plant.arrays(samples), sensor, controller.arrays,
                          arrays_of(identifier.arm), identifier.state,
                          self._parts.known)

    def _blocks(self, samples: int, observed: bool) -> Iterator[_Span]:
        """Yield blocks in which the true arm is one; each after the one before has been run."""
        longest, period = LONGEST if observed else LONGEST_UNSEEN, self._parts.period
        if observed:  # then at most one part of its window is completed in a block
            window = self._parts.identifier.settings.excitation.window
            longest = min(longest, max(int(window / PARTS / period), 1) if window else longest)
        begin = 0
        while begin < samples:
            self._plant.enter_epoch()
            length = self._plant.steady(min(longest, samples - begin), period)
            yield _Span(begin, begin + length)
            begin += length

    def _given(self, times: np.ndarray, block: _Span,
               noise: np.ndarray | None = None) -> BlockInputs:
        controller, t = self._parts.controller, times[block.begin:block.end]
        if noise is None:
            noise = torque_noise(self._plant.sensor, t.size, self._arm.n)
        return BlockInputs(t, along(controller.reference, t), controller.bounds_along(t), noise,
                           block.begin, self._parts.period)

    def _room(self, block: _Span, observer: Observer | None) -> ObservedRows:
        arm = self._arm
        return observed_rows(0 if observer is None else block.end - block.begin, arm.n, arm.m)

    def _samples(self, given: BlockInputs, trace: TraceRows, observed: ObservedRows,
                 before: float | None) -> Iterator[Sample]:
        """Yield the samples of a block; ``before`` is the excitation index before it."""
        after = self._parts.identifier.excitation
        completed = observed.excitation_parts[-1]
        threshold = self._parts.identifier.settings.change.threshold
        for k, t in enumerate(given.t.tolist()):
            seen = Measurement(*(each[k] for each in trace.measured))
            bounds = Bounds(*(each[k] for each in given.bounds))
            output = ControlOutput(
                trace.torque[k], observed.term[k],
                MotionState(t, seen.q, seen.qd, observed.e1[k], bounds), observed.e2[k],
                ReferencePoint(*(each[k] for each in given.reference)), observed.x[k],
                observed.bound[k], observed.wanted[k])
            index = after if observed.excitation_parts[k] == completed else before
            yield Sample(t, seen, output, observed.theta_used[k], trace.theta_hat[k],
                         int(trace.rank[k]), float(trace.sigma_min[k]),
                         int(observed.insertions[k]), index,
                         external_torque(observed.residual[k], observed.scale[k], threshold))


def _rows(value: Any, block: _Span) -> Any:
    """Return NamedTuples of arrays with the rows of a block."""
    if isinstance(value, tuple):
        return type(value)(*(_rows(each, block) for each in value))
    return value[block.begin:block.end]


def _copied(value: Any) -> Any:
    """Return NamedTuples of arrays and random generators with such of their own."""
    if isinstance(value, tuple):
        return type(value)(*map(_copied, value))
    return deepcopy(value)
