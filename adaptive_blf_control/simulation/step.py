# SPDX-License-Identifier: Apache-2.0
"""One sample of the simulated arm as compiled functions over arrays changed in place.

`SimulatedArm` holds the arrays between samples; the closed loop calls the functions itself, for
many samples in one compiled function.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.integrator import advance
from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.control.barrier import Each
from adaptive_blf_control.control.law import limited_joint

__all__ = ['DelayLine', 'EncoderState', 'PlantArrays', 'SensorArrays', 'delayed', 'encoder_step',
           'in_counts', 'new_delay_line', 'new_encoder_state', 'plant_step', 'sensor_step']


class DelayLine(NamedTuple):
    """Commands under way for D ≥ 1 samples.

    Attributes:
        commands: In the order in which they were given, a ring, shape (D, n) [N·m].
        place: Where the next one goes, shape (1,).
    """

    commands: np.ndarray
    place: np.ndarray


def new_delay_line(samples: int, commanded: np.ndarray) -> DelayLine:
    """Return a line of ``samples`` D ≥ 1 in which ``commanded``, (n,) [N·m], is under way."""
    return DelayLine(np.tile(commanded, (samples, 1)), np.zeros(1, dtype=np.intp))


@jit
def delayed(line: DelayLine, commanded: np.ndarray, torque: np.ndarray) -> None:
    """Send a command into the line, and write what comes out of it now.

    Args:
        line: Takes the command.
        commanded: Command that is held, shape (n,) [N·m].
        torque: Is written: the command of D − 1 samples ago, shape (n,) [N·m].
    """
    line = borrowed(line)
    place = line.place[0]
    line.commands[place] = commanded
    place = (place + 1) % line.commands.shape[0]
    line.place[0] = place
    torque[:] = line.commands[place]


class EncoderState(NamedTuple):
    """What an encoder remembers.

    Attributes:
        q: Positions measured last, shape (n,) [rad].
        qd: Velocities measured last, shape (n,) [rad/s].
        begun: Whether there are such, shape (1,).
    """

    q: np.ndarray
    qd: np.ndarray
    begun: np.ndarray


def new_encoder_state(n: int) -> EncoderState:
    """Return what an encoder of ``n`` joints remembers before its first sample."""
    return EncoderState(np.zeros(n), np.zeros(n), np.zeros(1, dtype=np.bool_))


@jit
def in_counts(q: Each, resolution: float) -> Each:
    """Return positions in whole counts of ``resolution`` [rad]."""
    return np.round(q / resolution) * resolution  # type: ignore[no-any-return]


@jit
def encoder_step(state: EncoderState, q: np.ndarray, qd: np.ndarray, dt: float,
                 resolution: float, time_constant: float) -> None:
    """Measure positions in counts, and velocities as their differences behind a low-pass.

    v_k = a v_{k−1} + (1 − a)(q_k − q_{k−1})/dt with a = exp(−dt/T); the true velocity where there
    is no difference yet.

    Args:
        state: Takes what is measured.
        q: True positions, shape (n,) [rad].
        qd: True velocities, shape (n,) [rad/s].
        dt: Time since the last sample [s].
        resolution: Step of one count [rad].
        time_constant: T [s]; 0 for none.
    """
    state = borrowed(state)
    differs = state.begun[0] and dt > 0.0
    keep = math.exp(-dt / time_constant) if time_constant > 0.0 else 0.0
    for i in range(q.size):
        position = in_counts(q[i], resolution)
        if differs:
            rate = (position - state.q[i]) / dt
            state.qd[i] = keep * state.qd[i] + (1.0 - keep) * rate
        else:
            state.qd[i] = qd[i]
        state.q[i] = position
    state.begun[0] = True


class SensorArrays(NamedTuple):
    """One of our sensors.

    Attributes:
        counts: Whether it is an encoder; else it shows the true state.
        resolution: Step of one count [rad].
        time_constant: T of the velocity's low-pass [s].
        state: Of an encoder.
    """

    counts: bool
    resolution: float
    time_constant: float
    state: EncoderState


@jit
def sensor_step(sensor: SensorArrays, q: np.ndarray, qd: np.ndarray, dt: float,
                measured_q: np.ndarray, measured_qd: np.ndarray) -> None:
    """Write what a sensor shows of true positions and velocities, ``dt`` [s] after the last."""
    sensor = borrowed(sensor)
    if sensor.counts:
        encoder_step(sensor.state, q, qd, dt, sensor.resolution, sensor.time_constant)
        measured_q[:] = sensor.state.q
        measured_qd[:] = sensor.state.qd
    else:
        measured_q[:] = q
        measured_qd[:] = qd


class PlantArrays(NamedTuple):
    """The simulated arm between two changes of its parameters; arrays of shape (n,).

    Attributes:
        true_arm: Of a type that `integrator.acceleration` knows.
        q: True positions [rad].
        qd: True velocities [rad/s].
        torque: That acts now [N·m].
        commanded: Commanded last, within the limit [N·m].
        torque_limit: Where the drives saturate [N·m].
        delays: Whether commands act after a dead time.
        line: Commands under way.
        substeps: Runge-Kutta steps per sample.
    """

    true_arm: Any
    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray
    commanded: np.ndarray
    torque_limit: np.ndarray
    delays: bool
    line: DelayLine
    substeps: int


@jit
def plant_step(plant: PlantArrays, torque: np.ndarray, dt: float) -> None:
    """Command a torque, shape (n,) [N·m], and move on by ``dt`` [s]."""
    plant = borrowed(plant)
    commanded, limit = plant.commanded, plant.torque_limit
    for i in range(torque.size):
        commanded[i] = limited_joint(torque[i], limit[i])
    if not plant.delays:
        plant.torque[:] = commanded
    q, qd = advance(plant.true_arm, plant.q, plant.qd, plant.torque, dt, plant.substeps)
    plant.q[:] = q
    plant.qd[:] = qd
