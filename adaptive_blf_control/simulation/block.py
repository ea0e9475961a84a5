# SPDX-License-Identifier: Apache-2.0
"""Many samples of the closed loop in one compiled function, with what they leave behind as rows.

The order within a sample is that of :meth:`ClosedLoop.samples`; the steps are those that the
classes call one at a time. Other Python threads run meanwhile.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.compiled import jit_without_gil
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.sets import Bounds
from adaptive_blf_control.control.step import Answer, controller_step, ControllerArrays
from adaptive_blf_control.identification.recorded_pairs import INSERTIONS, RANK, SIGMA_MIN
from adaptive_blf_control.identification.step import identifier_step, IdentifierState
from adaptive_blf_control.simulation.step import (
    delayed,
    plant_step,
    PlantArrays,
    sensor_step,
    SensorArrays,
)

__all__ = ['BlockInputs', 'LoopArrays', 'LoopMemory', 'ObservedRows', 'TraceRows',
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


class ObservedRows(NamedTuple):
    """What an observer sees besides: rows of shape (N, n) unless said; none without an observer.

    Attributes:
        q: Measured positions [rad].
        qd: Measured velocities [rad/s].
        torque: Measured torque [N·m].
        theta_used: θ of the controller, shape (N, m).
        term: Adaptation term, shape (N, m).
        x: Regressor, shape (N, n, m).
        e1: Tracking error as measured [rad].
        e2: q̇ − α [rad/s].
        bound: Active bound [rad].
        wanted: Torque before the limits [N·m].
        insertions: Pairs taken so far, shape (N,).
        excitation_parts: Completed parts of the window of (21), shape (N,).
    """

    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray
    theta_used: np.ndarray
    term: np.ndarray
    x: np.ndarray
    e1: np.ndarray
    e2: np.ndarray
    bound: np.ndarray
    wanted: np.ndarray
    insertions: np.ndarray
    excitation_parts: np.ndarray


def trace_rows(samples: int, n: int, m: int) -> TraceRows:
    """Return room for the trace of so many samples."""
    return TraceRows(*(np.empty((samples, n)) for _ in range(4)), np.empty((samples, m)),
                     np.empty(samples, dtype=np.int64), np.empty(samples))


def observed_rows(samples: int, n: int, m: int) -> ObservedRows:
    """Return room for what an observer sees of so many samples."""
    joints, parameters, counts = (samples, n), (samples, m), samples
    return ObservedRows(
        np.empty(joints), np.empty(joints), np.empty(joints), np.empty(parameters),
        np.empty(parameters), np.empty((samples, n, m)), np.empty(joints), np.empty(joints),
        np.empty(joints), np.empty(joints), np.empty(counts, dtype=np.int64),
        np.empty(counts, dtype=np.int64))


@jit_without_gil
def run_block(loop: LoopArrays, memory: LoopMemory, given: BlockInputs, trace: TraceRows,
              observed: ObservedRows) -> None:
    """Run the samples of a block; the arm has moved on after each, the last one included.

    Args:
        loop: The parts; their arrays are changed in place.
        memory: Of the loop; likewise.
        given: What the samples are given.
        trace: Its rows are written.
        observed: Likewise, where it has rows.
    """
    plant, answer = loop.plant, memory.answer
    pairs, learned = loop.identifier.learner.history, loop.identifier.learner.theta
    q, qd = np.empty_like(plant.q), np.empty_like(plant.q)
    torque = np.empty_like(plant.q)
    observes = observed.q.shape[0] > 0
    for k in range(given.t.size):
        interval = given.dt if given.first + k > 0 else 0.0
        for i in range(q.size):
            torque[i] = plant.torque[i] + given.noise[k, i]
        if plant.delays:
            delayed(plant.line, plant.commanded, plant.torque)
        sensor_step(loop.sensor, plant.q, plant.qd, interval, q, qd)
        point = ReferencePoint(given.reference.position[k], given.reference.velocity[k],
                               given.reference.acceleration[k])
        bounds = Bounds(given.bounds.lower[k], given.bounds.upper[k], given.bounds.lower_rate[k],
                        given.bounds.upper_rate[k])
        x = controller_step(loop.controller, answer, given.t[k], q, qd, memory.theta, point,
                            bounds)
        identifier_step(loop.identifier_arm, loop.identifier, given.t[k], q, qd, torque,
                        memory.term)
        for i in range(q.size):
            trace.q[k, i], trace.qd[k, i] = plant.q[i], plant.qd[i]
            trace.e1[k, i] = plant.q[i] - point.position[i]
            trace.torque[k, i] = answer.torque[i]
        trace.theta_hat[k] = learned
        trace.rank[k] = pairs.counters[RANK]
        trace.sigma_min[k] = pairs.figures[SIGMA_MIN]
        if observes:
            observed.q[k], observed.qd[k], observed.torque[k] = q, qd, torque
            observed.theta_used[k], observed.term[k] = memory.theta, answer.term
            observed.x[k], observed.e1[k], observed.e2[k] = x, answer.e1, answer.e2
            observed.bound[k], observed.wanted[k] = answer.bound, answer.wanted
            observed.insertions[k] = pairs.counters[INSERTIONS]
            observed.excitation_parts[k] = loop.identifier.learner.excitation.completed[0]
        memory.term[:] = answer.term
        if not loop.known:
            memory.theta[:] = learned
        plant_step(plant, answer.torque, given.dt)
