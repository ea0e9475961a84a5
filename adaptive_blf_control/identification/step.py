# SPDX-License-Identifier: Apache-2.0
"""One sample of the identifier: from a joint state to θ̂, as one function over its state.

It is compiled where the arm and every part are known as arrays, and runs as it stands here where
one of them is an object in Python. Parts are asked by functions with one implementation for each
type, see `adaptive_blf_control.compiled.by_type`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.regressors import regressors
from adaptive_blf_control.compiled import (
    all_finite,
    assign_vector,
    borrowed,
    Handle,
    jit,
    jit_apart,
)
from adaptive_blf_control.identification.artificial_noise import (
    ACTIVE,
    NoisyHistoryArrays,
    offer_with_noise,
)
from adaptive_blf_control.identification.change_monitor import forget_residuals
from adaptive_blf_control.identification.change_response import (
    ADAPT,
    FORGET,
    judged,
    KEEP,
    LEARN,
    remembered,
    REMEMBERS,
    ResponseArrays,
)
from adaptive_blf_control.identification.excitation import accumulate, ExcitationArrays
from adaptive_blf_control.identification.filter_distortion import (
    Distortion,
    follow_distortion,
    is_distorted,
)
from adaptive_blf_control.identification.history import facts, forget_pairs, offer, sums, UNJUDGED
from adaptive_blf_control.identification.position_limits import (
    any_limited,
    follow_limits,
    PositionLimits,
    true_rows,
)
from adaptive_blf_control.identification.state_filter import filtered, forget_states
from adaptive_blf_control.identification.torque_filter import (
    filter_pair,
    forget_pair,
    TorqueFilterArrays,
)
from adaptive_blf_control.identification.update_laws import Evidence, stepped

__all__ = ['AGE', 'AT_LIMIT', 'BEGUN', 'CHANGES', 'IdentifierState', 'LearnerState', 'Learning',
           'NOT_FINITE', 'PairState', 'REPEATED', 'RESTARTS', 'Running', 'TIME', 'TOO_LARGE',
           'UPDATES', 'WENT_BACK', 'has_settled', 'identifier_step', 'learn_pair', 'learn_step',
           'observe_sample', 'observe_step', 'take_sample', 'take_samples']

# Filtered regressors (rad/s², rad²/s², m/s² and the like) and torques [N·m] of a robot stay far
# below this; the squares of what does not would drown the update law in rounding.
LARGEST = 1e6

# Elements of `PairState.counts` ...
(RESTARTS, NOT_FINITE, TOO_LARGE, REPEATED, WENT_BACK, CHANGES, UPDATES, BEGUN,
 AT_LIMIT) = range(9)
# ... and of `PairState.clock`.
TIME, AGE = range(2)


class PairState(NamedTuple):
    """The present pair, and how the samples came; arrays are changed in place.

    Attributes:
        filter: The torque filter, which has the pair.
        counts: By name: RESTARTS of the filters; samples dropped as NOT_FINITE, TOO_LARGE, with a
            stamp that was REPEATED or WENT_BACK; CHANGES of the arm; UPDATES of θ̂; whether
            there is a last sample, BEGUN; and samples with a joint AT_LIMIT; shape (9,).
        clock: By name: TIME of the last sample and AGE of the filters [s], shape (2,).
        gap: Longest interval that is filtered across [s].
        settling: Age at which the filters have forgotten their start [s].
        limits: Between which positions a joint's row is that of the arm alone.
        distortion: Of the present pair by the state filter.
    """

    filter: TorqueFilterArrays
    counts: np.ndarray
    clock: np.ndarray
    gap: float
    settling: float
    limits: PositionLimits
    distortion: Distortion


class LearnerState(NamedTuple):
    """What is learned from pairs, and by which parts; arrays are changed in place.

    Attributes:
        theta: θ̂, shape (m,).
        history: The recorded pairs.
        noise: Those with artificial noise.
        monitor: What finds that the arm has changed.
        response: What follows then.
        excitation: The integral of (21).
        law: What moves θ̂.
    """

    theta: np.ndarray
    history: Any
    noise: NoisyHistoryArrays
    monitor: Any
    response: ResponseArrays
    excitation: ExcitationArrays
    law: Any


class IdentifierState(NamedTuple):
    """An identifier with its settings, as the step takes it.

    Attributes:
        state_filter: What filters the measured state.
        pair: The present pair.
        learner: What is learned.
    """

    state_filter: Any
    pair: PairState
    learner: LearnerState


@jit
def _interval(pair: PairState, t: float) -> float:
    """Return the time since the last sample [s], 0 for the first; NaN where it is dropped."""
    pair = borrowed(pair)
    if not pair.counts[BEGUN]:
        return 0.0
    dt = t - pair.clock[TIME]
    if -pair.gap < dt <= 0.0:
        pair.counts[REPEATED if dt == 0.0 else WENT_BACK] += 1
        return np.nan
    return float(dt)


@jit
def _finite_sample(t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray) -> bool:
    return math.isfinite(t) and all_finite(q) and all_finite(qd) and all_finite(tau)


@jit
def _usable(pair: TorqueFilterArrays) -> bool:
    pair = borrowed(pair)
    return _small(pair.regressor) and _small(pair.torque)


@jit
def _small(array: np.ndarray) -> bool:
    small = True
    for value in array.flat:
        small = small and abs(value) < LARGEST
    return small


@jit
def observe_step(arm: Any, state_filter: Any, pair: PairState, t: float, q: np.ndarray,
                 qd: np.ndarray, tau: np.ndarray) -> float:
    """Filter one sample without learning from it.

    Args:
        arm: The arm, see `adaptive_blf_control.arms.regressors`.
        state_filter: What filters the measured state; changed in place.
        pair: The present pair; changed in place.
        t: Time of the sample [s].
        q: Positions, shape (n,) [rad].
        qd: Velocities, shape (n,) [rad/s].
        tau: Mean torque over the interval that ends at ``t``, shape (n,) [N·m].

    Returns:
        The interval [s] the filters advanced by; 0 where they (re)started or the sample was
        dropped.
    """
    pair = borrowed(pair)
    counts, clock = pair.counts, pair.clock
    if not _finite_sample(t, q, qd, tau):
        counts[NOT_FINITE] += 1
        return 0.0
    dt = _interval(pair, t)
    if math.isnan(dt):
        return 0.0
    if not 0.0 < dt <= pair.gap:  # the first sample, a gap, or the clock jumped back
        forget_states(state_filter)
        forget_pair(pair.filter)
    clock[TIME] = t
    counts[BEGUN] = 1
    followed = dt if dt <= pair.gap else 0.0
    if follow_limits(pair.limits, followed, q):
        counts[AT_LIMIT] += 1
    q, qd, tau = filtered(state_filter, dt, q, qd, tau)
    follow_distortion(pair.distortion, followed, qd)
    y1, y2 = regressors(arm, q, qd)
    if not filter_pair(pair.filter, dt, y1, y2, tau):
        counts[RESTARTS] += 1
        clock[AGE] = 0.0
        return 0.0
    if not _usable(pair.filter):  # the filter would carry it on for ever
        counts[TOO_LARGE] += 1
        counts[BEGUN] = 0
        clock[AGE] = 0.0
        forget_pair(pair.filter)
        return 0.0
    clock[AGE] += dt
    return dt


@jit
def has_settled(pair: PairState) -> bool:
    """Return whether the pair is that of the arm alone, with nothing that the filters do to it."""
    pair = borrowed(pair)
    return bool(_follow_the_arm(pair) and not any_limited(pair.limits))


@jit
def _follow_the_arm(pair: PairState) -> bool:
    """Return whether what the filters have is the present motion."""
    pair = borrowed(pair)
    return bool(pair.clock[AGE] >= pair.settling and not is_distorted(pair.distortion))


@jit_apart
def learn_step(pair: PairState, learner: LearnerState, dt: float, term: np.ndarray) -> None:
    """Record the present pair, or forget the recorded ones, and advance θ̂.

    Args:
        pair: The present pair.
        learner: What is learned; changed in place.
        dt: Time since the last pair [s], > 0.
        term: Xᵀe2 held over that interval, shape (m,).
    """
    pair = borrowed(pair)
    learner = borrowed(learner)
    counts = pair.counts
    regressor, torque = true_rows(pair.limits, pair.filter.regressor, pair.filter.torque)
    if any_limited(pair.limits):
        term = np.zeros_like(term)
    settled = _follow_the_arm(pair)
    verdict = judged(learner.monitor, learner.response, learner.history, learner.theta, dt,
                     regressor, torque, settled)
    if verdict == FORGET:
        forget_pairs(learner.history)
        forget_residuals(learner.monitor)
        counts[CHANGES] += 1
        # The filters still remember the arm of before.
        pair.clock[AGE] = pair.settling - learner.response.settling
        settled = learner.response.settling <= 0.0
    elif verdict != LEARN:
        settled = False
    if settled:
        if offer(learner.history, regressor, torque) == UNJUDGED:
            counts[NOT_FINITE] += 1
        if learner.noise.counts[ACTIVE]:
            offer_with_noise(learner.noise, regressor, torque, facts(learner.history)[2])
    accumulate(learner.excitation, dt, regressor)
    gram, moment = sums(learner.history)
    if learner.noise.counts[ACTIVE]:
        gram, moment = sums(learner.noise.history)
    if learner.response.counts[REMEMBERS]:
        gram, moment = remembered(learner.response, gram, moment)
    theta = learner.theta
    if verdict == ADAPT:
        gram, moment = np.zeros_like(gram), np.zeros_like(moment)
    if verdict != KEEP:
        theta = stepped(learner.law, learner.theta, dt,
                        Evidence(regressor, torque, settled, gram, moment, term))
    if all_finite(theta):
        assign_vector(learner.theta, theta)
        counts[UPDATES] += 1
    else:  # overflow in data beyond reason: the last good estimate stays
        counts[NOT_FINITE] += 1


@jit
def identifier_step(arm: Any, state: IdentifierState, t: float, q: np.ndarray, qd: np.ndarray,
                    tau: np.ndarray, term: np.ndarray) -> float:
    """Filter one sample, record its pair and advance θ̂; see `observe_step` and `learn_step`."""
    state = borrowed(state)
    dt = observe_step(arm, state.state_filter, state.pair, t, q, qd, tau)
    if dt > 0.0:
        learn_step(state.pair, state.learner, dt, term)
    return dt


class Running(NamedTuple):
    """An identifier with its arm.

    Attributes:
        arm: The arm, see `adaptive_blf_control.arms.regressors`.
        state: The identifier.
    """

    arm: Any
    state: IdentifierState


class Learning(NamedTuple):
    """A pair with what is learned from it, where the filters before it are in Python."""

    pair: PairState
    learner: LearnerState


@jit
def learn_pair(learning: Handle, dt: float, term: np.ndarray) -> None:
    """Learn from the present pair as `learn_step` does, called from Python."""
    pair, learner = learning.value.pair, learning.value.learner
    learn_step(pair, learner, dt, term)


@jit
def observe_sample(running: Handle, t: float, q: np.ndarray, qd: np.ndarray,
                   tau: np.ndarray) -> float:
    """Take one sample as `observe_step` does, called from Python."""
    arm, state = running.value.arm, running.value.state
    return observe_step(arm, state.state_filter, state.pair, t, q, qd, tau)


@jit
def take_sample(running: Handle, t: float, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
                term: np.ndarray) -> float:
    """Take one sample as `identifier_step` does, called from Python."""
    arm, state = running.value.arm, running.value.state
    return identifier_step(arm, state, t, borrowed(q), borrowed(qd), borrowed(tau),
                           borrowed(term))


@jit
def take_samples(running: Handle, t: np.ndarray, q: np.ndarray, qd: np.ndarray, tau: np.ndarray,
                 term: np.ndarray, learning: np.ndarray, rows: np.ndarray, usable: np.ndarray,
                 recorded: np.ndarray) -> None:
    """Take samples one after the other, and show what each gave.

    Args:
        running: The identifier.
        t: Times, shape (N,) [s].
        q: Positions, shape (N, n) [rad].
        qd: Velocities, shape (N, n) [rad/s].
        tau: Mean torques over the intervals that end at ``t``, shape (N, n) [N·m].
        term: Xᵀe2 held over all of them, shape (m,).
        learning: Whether it is learned from a sample; else it is filtered only; shape (N,).
        rows: To be filled with [Y_f τ_f], shape (N, n, m + 1).
        usable: To be filled: whether the filters were settled in a sample they advanced by, (N,).
        recorded: To be filled: whether the history was another one after a sample, shape (N,).
    """
    arm, state = running.value.arm, running.value.state
    pair, learner = state.pair, state.learner
    m = learner.theta.size
    for k in range(t.size):
        revision = facts(learner.history)[3]
        dt = observe_step(arm, state.state_filter, pair, t[k], q[k], qd[k], tau[k])
        if dt > 0.0 and learning[k]:
            learn_step(pair, learner, dt, term)
        recorded[k] = facts(learner.history)[3] != revision
        usable[k] = dt > 0.0 and has_settled(pair)
        rows[k, :, :m] = pair.filter.regressor
        rows[k, :, m] = pair.filter.torque
