# SPDX-License-Identifier: Apache-2.0
"""Many samples of the closed loop in one compiled function, with what they leave behind as rows.

The order within a sample is that of :meth:`ClosedLoop.samples`; the steps are those that the
classes call one at a time. Other Python threads run meanwhile.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.compiled import assign_vector, borrowed, Handle, jit, jit_without_gil
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.sets import Bounds
from adaptive_blf_control.control.step import Answer, controller_step, ControllerArrays
from adaptive_blf_control.identification.stack_arrays import INSERTIONS, RANK, SIGMA_MIN
from adaptive_blf_control.identification.step import identifier_step, IdentifierState
from adaptive_blf_control.simulation.sensors import Measurement
from adaptive_blf_control.simulation.step import (
    plant_step,
    PlantArrays,
    sensor_step,
    SensorArrays,
    torque_step,
)

__all__ = ['Block', 'BlockInputs', 'LoopArrays', 'LoopMemory', 'ObservedRows', 'TraceRows',
           'observed_rows', 'run_block', 'trace_rows']


class LoopArrays(NamedTuple):
    """The parts of a closed loop as compiled functions take them.

    Attributes:
        plant: The simulated arm.
        sensor: What measures it.
        controller: The law (38) with its limits.
        identifier_arm: Arrays of the arm that is learned.
        identifier: What learns.
        known: Whether θ of `LoopMemory` stays, whatever is learned (34).
    """

    plant: PlantArrays
    sensor: SensorArrays
    controller: ControllerArrays
    identifier_arm: Any
    identifier: IdentifierState
    known: bool


class LoopMemory(NamedTuple):
    """What one sample of the loop leaves to the next; changed in place.

    Attributes:
        theta: θ that the controller uses, shape (m,).
        term: Adaptation term of the last sample, shape (m,).
        answer: Last answer of the controller.
    """

    theta: np.ndarray
    term: np.ndarray
    answer: Answer


class BlockInputs(NamedTuple):
    """What the N samples of a block are given; arrays of shape (N, n) unless said.

    Attributes:
        t: Times, shape (N,) [s].
        reference: y_d with two derivatives.
        bounds: Performance bounds with their rates.
        noise: What the sensor adds to the torque [N·m].
        first: Number of the first sample in the run: number 0 ends no interval.
        dt: Sample interval [s].
    """

    t: np.ndarray
    reference: ReferencePoint
    bounds: Bounds
    noise: np.ndarray
    first: int
    dt: float


class TraceRows(NamedTuple):
    """Rows of the trace, see `Trace`."""

    q: np.ndarray
    qd: np.ndarray
    e1: np.ndarray
    torque: np.ndarray
    theta_hat: np.ndarray
    rank: np.ndarray
    sigma_min: np.ndarray
    measured: Measurement


class ObservedRows(NamedTuple):
    """What an observer sees besides: rows of shape (N, n) unless said; none without an observer.

    Attributes:
        theta_used: θ of the controller, shape (N, m).
        term: Adaptation term, shape (N, m).
        x: Regressor, shape (N, n, m).
        e1: Tracking error as measured [rad].
        e2: q̇ − α [rad/s].
        bound: Active bound [rad].
        wanted: Torque before the limits [N·m].
        insertions: Pairs taken so far, shape (N,).
        excitation_parts: Completed parts of the window of (21), shape (N,).
        residual: Measured minus predicted torque behind the filters [N·m].
        scale: What its square is compared with [N²·m²].
    """

    theta_used: np.ndarray
    term: np.ndarray
    x: np.ndarray
    e1: np.ndarray
    e2: np.ndarray
    bound: np.ndarray
    wanted: np.ndarray
    insertions: np.ndarray
    excitation_parts: np.ndarray
    residual: np.ndarray
    scale: np.ndarray


class Block(NamedTuple):
    """All that a block is run with; its arrays are changed in place.

    Attributes:
        loop: The parts.
        memory: Of the loop.
        given: What the samples are given.
        trace: Its rows are written.
        observed: Likewise, where it has rows.
    """

    loop: LoopArrays
    memory: LoopMemory
    given: BlockInputs
    trace: TraceRows
    observed: ObservedRows


def trace_rows(samples: int, n: int, m: int) -> TraceRows:
    """Return room for the trace of so many samples."""
    q, qd, e1, torque, *measured = (np.empty((samples, n)) for _ in range(7))
    return TraceRows(q, qd, e1, torque, np.empty((samples, m)),
                     np.empty(samples, dtype=np.int64), np.empty(samples), Measurement(*measured))


def observed_rows(samples: int, n: int, m: int) -> ObservedRows:
    """Return room for what an observer sees of so many samples."""
    joints, parameters, counts = (samples, n), (samples, m), samples
    return ObservedRows(
        np.empty(parameters), np.empty(parameters), np.empty((samples, n, m)),
        np.empty(joints), np.empty(joints),
        np.empty(joints), np.empty(joints), np.empty(counts, dtype=np.int64),
        np.empty(counts, dtype=np.int64), np.empty(joints), np.empty(joints))


@jit_without_gil
def run_block(block: Handle) -> None:
    """Run the samples of a `Block`; the arm has moved on after each, the last one included."""
    parts = block.value
    loop, memory, given = parts.loop, parts.memory, parts.given
    trace, observed = parts.trace, parts.observed
    plant, sensor, controller = loop.plant, loop.sensor, loop.controller
    arm, identifier = loop.identifier_arm, loop.identifier
    theta, term, answer = memory.theta, memory.term, memory.answer
    pairs, excitation = identifier.learner.history, identifier.learner.excitation
    monitor = identifier.learner.monitor
    learned, counters, figures = identifier.learner.theta, pairs.counters, pairs.figures
    reference, rows, noise, times = given.reference, given.bounds, given.noise, given.t
    q, qd = np.empty_like(plant.q), np.empty_like(plant.q)
    torque = np.empty_like(plant.q)
    for k in range(times.size):
        interval = given.dt if given.first + k > 0 else 0.0
        torque_step(plant, interval, torque)
        for i in range(q.size):
            torque[i] += noise[k, i]
        sensor_step(sensor, plant.q, plant.qd, interval, q, qd)
        point = ReferencePoint(reference.position[k], reference.velocity[k],
                               reference.acceleration[k])
        bounds = Bounds(rows.lower[k], rows.upper[k], rows.lower_rate[k], rows.upper_rate[k])
        x = controller_step(controller, answer, times[k], q, qd, theta, point, bounds)
        identifier_step(arm, identifier, times[k], q, qd, torque, term)
        _write_trace(trace, k, plant.q, plant.qd, point.position, answer.torque, learned)
        trace.rank[k], trace.sigma_min[k] = counters[RANK], figures[SIGMA_MIN]
        _write_measured(trace.measured, k, q, qd, torque)
        if observed.term.shape[0] > 0:
            _write_observed(observed, k, theta, answer, x)
            observed.insertions[k] = counters[INSERTIONS]
            observed.excitation_parts[k] = excitation.completed[0]
            observed.residual[k] = monitor.residual
            observed.scale[k] = monitor.scale
        assign_vector(term, answer.term)
        if not loop.known:
            assign_vector(theta, learned)
        plant_step(plant, answer.torque, given.dt)


@jit
def _write_trace(trace: TraceRows, k: int, q: np.ndarray, qd: np.ndarray, reference: np.ndarray,
                 torque: np.ndarray, theta: np.ndarray) -> None:
    trace = borrowed(trace)
    for i in range(q.size):
        trace.q[k, i], trace.qd[k, i] = q[i], qd[i]
        trace.e1[k, i] = q[i] - reference[i]
        trace.torque[k, i] = torque[i]
    assign_vector(trace.theta_hat[k], theta)


@jit
def _write_measured(rows: Measurement, k: int, q: np.ndarray, qd: np.ndarray,
                    torque: np.ndarray) -> None:
    rows = borrowed(rows)
    for i in range(q.size):
        rows.q[k, i], rows.qd[k, i], rows.torque[k, i] = q[i], qd[i], torque[i]


@jit
def _write_observed(rows: ObservedRows, k: int, theta: np.ndarray, answer: Answer,
                    x: np.ndarray) -> None:
    rows.theta_used[k], rows.term[k], rows.x[k] = theta, answer.term, x
    rows.e1[k], rows.e2[k] = answer.e1, answer.e2
    rows.bound[k], rows.wanted[k] = answer.bound, answer.wanted
