# SPDX-License-Identifier: Apache-2.0
"""One sample of the controller as a compiled function over arrays.

`controller_step` is (38) with its limits, for an arm that has arrays
(:mod:`adaptive_blf_control.arms.regressors`). `Controller` holds the arrays and checks what comes
in; the closed loop calls the step itself, for many samples in one compiled function.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.regressors import law_regressor
from adaptive_blf_control.compiled import borrowed, jit, jit_apart
from adaptive_blf_control.control.law import (
    add_unwound,
    joint_errors,
    rate_limited_joint,
    write_torque,
)
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.sets import Bounds

__all__ = ['AblfGains', 'Answer', 'controller_step', 'ControllerArrays',
           'FIRST_INTERVAL', 'Memory', 'new_answer', 'new_memory', 'write_answer']

FIRST_INTERVAL = 1e-3  # s that the first torque of a motion may have taken to rise from zero


class AblfGains(NamedTuple):
    """Gains of (38); arrays of shape (n,).

    Attributes:
        k1: Of the stabilising function (27) [1/(s·rad⁴)].
        k2: On e2 [N·m·s/rad].
        weight: Of the barrier [J].
        smooth: Whether the barrier acts joint by joint; else by the paper's pseudoinverse.
        reach: Part of the bound beyond which the coupling is what it is there.
    """

    k1: np.ndarray
    k2: np.ndarray
    weight: np.ndarray
    smooth: bool
    reach: float


class Memory(NamedTuple):
    """What a motion remembers of the sample before; changed in place.

    Attributes:
        torque: Commanded then, shape (n,) [N·m].
        time: Of that sample, shape (1,) [s]; NaN before the first one.
    """

    torque: np.ndarray
    time: np.ndarray


class ControllerArrays(NamedTuple):
    """A controller as compiled functions take it.

    Attributes:
        arm: Arrays of the arm.
        gains: Of the law.
        torque_limit: Shape (n,) [N·m].
        torque_rate_limit: Shape (n,) [N·m/s].
        memory: Of the motion.
    """

    arm: Any
    gains: AblfGains
    torque_limit: np.ndarray
    torque_rate_limit: np.ndarray
    memory: Memory


class Answer(NamedTuple):
    """What a step writes; arrays of shape (n,) unless said.

    Attributes:
        torque: Commanded torque after the limits [N·m]; always finite.
        term: Adaptation term Xᵀe2 (37) without what would wind up against a limit, shape (m,).
        e1: Tracking error (5) [rad].
        e2: q̇ − α [rad/s].
        alpha: Stabilising function (27) [rad/s].
        alpha_dot: Its derivative [rad/s²].
        bound: Active bound (11) [rad].
        wanted: Torque before the limits [N·m].
    """

    torque: np.ndarray
    term: np.ndarray
    e1: np.ndarray
    e2: np.ndarray
    alpha: np.ndarray
    alpha_dot: np.ndarray
    bound: np.ndarray
    wanted: np.ndarray


def new_memory(n: int) -> Memory:
    """Return the memory of a motion of ``n`` joints that begins."""
    return Memory(np.zeros(n), np.full(1, np.nan))


@jit
def new_answer(n: int, m: int) -> Answer:
    """Return room for an answer for ``n`` joints and ``m`` parameters."""
    return Answer(np.zeros(n), np.zeros(m), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n),
                  np.zeros(n), np.zeros(n))


@jit
def controller_step(controller: ControllerArrays, answer: Answer, t: float, q: np.ndarray,
                    qd: np.ndarray, theta: np.ndarray, point: ReferencePoint,
                    bounds: Bounds) -> np.ndarray:
    """Answer one sample with (38) within the limits of torque and its rate.

    Args:
        controller: Its ``memory`` takes the torque and the time.
        answer: Is written.
        t: Time of the sample since the start of the motion [s].
        q: Measured positions, shape (n,) [rad].
        qd: Measured velocities, shape (n,) [rad/s].
        theta: θ̂, shape (m,).
        point: Reference with two derivatives.
        bounds: Performance bounds in use, with their rates.

    Returns:
        Regressor X, shape (n, m).
    """
    controller, answer = borrowed(controller), borrowed(answer)
    point, bounds = borrowed(point), borrowed(bounds)
    gains, memory = controller.gains, controller.memory
    e1, e2, bound = answer.e1, answer.e2, answer.bound
    alpha, alpha_dot, k1 = answer.alpha, answer.alpha_dot, gains.k1
    yd, yd_dot, yd_ddot = point.position, point.velocity, point.acceleration
    lower, upper = bounds.lower, bounds.upper
    lower_rate, upper_rate = bounds.lower_rate, bounds.upper_rate
    for i in range(q.size):
        e1[i], e2[i], alpha[i], alpha_dot[i], bound[i] = joint_errors(
            q[i], qd[i], yd[i], yd_dot[i], yd_ddot[i], lower[i], upper[i], lower_rate[i],
            upper_rate[i], k1[i])
    x = law_regressor(controller.arm, q, qd, alpha, alpha_dot)
    wanted, torque, last, term = answer.wanted, answer.torque, memory.torque, answer.term
    write_torque(wanted, x, theta, gains.k2, e1, e2, bound, gains.weight, gains.smooth,
                 gains.reach)
    dt = FIRST_INTERVAL if np.isnan(memory.time[0]) else t - memory.time[0]
    limit, rate_limit = controller.torque_limit, controller.torque_rate_limit
    for i in range(q.size):
        torque[i] = rate_limited_joint(wanted[i], limit[i], last[i], rate_limit[i], dt)
        last[i] = torque[i]
    memory.time[0] = t
    for j in range(term.size):
        term[j] = 0.0
    add_unwound(term, x, e2, wanted, torque)
    return x


@jit_apart
def write_answer(x: np.ndarray, controller: ControllerArrays, answer: Answer, t: float,
                 q: np.ndarray, qd: np.ndarray, theta: np.ndarray, point: ReferencePoint,
                 bounds: Bounds) -> None:
    """Answer one sample as `controller_step` does and write X into ``x``, shape (n, m)."""
    x[:] = controller_step(controller, answer, t, q, qd, theta, point, bounds)
