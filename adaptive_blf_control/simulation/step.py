# SPDX-License-Identifier: Apache-2.0
"""One sample of the simulated arm as compiled functions over arrays changed in place.

`SimulatedArm` holds the arrays between samples; the closed loop calls the functions itself, for
many samples in one compiled function.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.integrator import move
from adaptive_blf_control.compiled import assign_vector, borrowed, jit, jitable
from adaptive_blf_control.control.barrier import Each
from adaptive_blf_control.control.law import limited_joint
from adaptive_blf_control.simulation.actuators import (
    acting_torque,
    ActuatorArrays,
    command,
    let_act,
    measured_torque,
    next_switch,
    note_span,
)
from adaptive_blf_control.simulation.delay_line import delayed
from adaptive_blf_control.simulation.pushes import add_push_torque, let_push, next_push, PushArrays

__all__ = ['EncoderState', 'PlantArrays', 'ROUNDING', 'SensorArrays', 'begin_span',
           'encoder_step', 'in_counts', 'new_encoder_state', 'plant_step', 'sensor_step',
           'torque_step']

ROUNDING = 1e-9  # s that summed intervals may fall short of the time of a change


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
        q, qd = sensor.state.q, sensor.state.qd
    assign_vector(measured_q, q)
    assign_vector(measured_qd, qd)


class PlantArrays(NamedTuple):
    """The simulated arm between two changes of its parameters.

    Attributes:
        true_arm: Of a type that `integrator.acceleration` knows.
        q: True positions, shape (n,) [rad].
        qd: True velocities, shape (n,) [rad/s].
        clock: Time since the start, shape (1,) [s].
        substeps: Runge-Kutta steps per sample.
        actuated: Whether commands act late or wrongly, or there are pushes. Where not, limit and
            dead time are all there is of the actuators.
        actuators: What makes a torque of a command.
        pushes: What acts besides.
    """

    true_arm: Any
    q: np.ndarray
    qd: np.ndarray
    clock: np.ndarray
    substeps: int
    actuated: bool
    actuators: ActuatorArrays
    pushes: PushArrays


@jit
def torque_step(plant: PlantArrays, interval: float, measured: np.ndarray) -> None:
    """Measure the torque of an ``interval`` [s] that ends now, and let dead times go on.

    Args:
        plant: The arm.
        interval: 0 for the first sample, where what acts is measured.
        measured: Is written, shape (n,) [N·m].
    """
    plant = borrowed(plant)
    actuators = plant.actuators
    acting, gain = actuators.acting, actuators.gain
    for i in range(measured.size):
        measured[i] = gain[i] * acting[i]
    if plant.actuated:
        torque = measured_torque(actuators, plant.clock[0])
        if interval > 0.0:
            measured[:] = torque
    elif actuators.waits:
        delayed(actuators.line, actuators.commanded, acting)


@jit
def plant_step(plant: PlantArrays, torque: np.ndarray, dt: float) -> None:
    """Command a torque, shape (n,) [N·m], and move on by ``dt`` [s]."""
    plant = borrowed(plant)
    actuators, clock = plant.actuators, plant.clock
    arm, pushes, substeps, q, qd = plant.true_arm, plant.pushes, plant.substeps, plant.q, plant.qd
    commanded, acting, limit = actuators.commanded, actuators.acting, actuators.limit
    left = dt
    if plant.actuated:
        command(actuators, clock[0], torque)
    else:
        for i in range(torque.size):
            commanded[i] = limited_joint(torque[i], limit[i])
            if not actuators.waits:
                acting[i] = commanded[i]
    while left > 0.0:  # exactly to each command and each force that comes to act
        span, applied = left, acting
        if plant.actuated:
            span = begin_span(actuators, pushes, clock[0], left)
            applied = acting_torque(actuators)
            add_push_torque(pushes, q, applied)
        move(arm, q, qd, applied, span, substeps)
        clock[0] += span
        left -= span
        if plant.actuated:
            note_span(actuators, span)
            left = left if left > ROUNDING else 0.0
    if plant.actuated:
        begin_span(actuators, pushes, clock[0], 0.0)


@jitable
def begin_span(actuators: ActuatorArrays, pushes: PushArrays, t: float, left: float) -> float:
    """Let act what is due at ``t`` [s]; return for how long at most ``left`` it goes on so [s]."""
    let_push(pushes, t + ROUNDING)
    let_act(actuators, t + ROUNDING)
    return min(left, min(next_switch(actuators), next_push(pushes)) - t)
