# SPDX-License-Identifier: Apache-2.0
"""What follows when present data contradict the recorded pairs.

With ``change.suspicion`` 0 the recorded pairs are forgotten at once. Else:

* in *doubt*, from that mean of d² on, nothing is recorded, so that what contradicts the recorded
  pairs does not come among them and hide;
* *held*, from ``change.threshold`` on, no pair moves θ̂, recorded or present, and Xᵀe2 does with
  ``change.adapt`` only: it holds a load, and pushes ever harder against a wall. With it θ̂ also
  is that of the arm with a load for as long as one predicts the residual, in what is certain of
  it. That lasts until one of three explanations holds: the residual is gone, so it was a contact,
  and θ̂ is again what it was before; one load at the tip predicts it; or neither within
  ``change.patience``, so the arm is another one;
* *loaded*, θ̂ and the recorded pairs become those of the arm with the load (`tip_load`): what they
  say about everything else stays. It ends when what is open of the load is below what the monitor
  notices;
* for another arm the pairs are forgotten, but a part of what they said stays beside the new ones
  until these are as strong: θ̂ changes where the new pairs ask for it, and nowhere else.

d² is divided by what it ordinarily is for pairs that are not recorded. At first that is taken to
be as large as an alarm: a history that has just got full rank, with a tiny σ_min, explains itself
only. It follows the pairs within seconds, and in a doubt within ``change.patience``, so that a
doubt that neither ends nor becomes an alarm is given up: the model is less exact than it was.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, by_type, jit
from adaptive_blf_control.identification.change_monitor import (
    ChangeMonitor,
    contradicted,
    nothing_compared,
    ResidualArrays,
)
from adaptive_blf_control.identification.history import History
from adaptive_blf_control.identification.stack_arrays import (
    COUNT,
    Pairs,
    RANK,
    REVISION,
    shift_torques,
    SIGMA_MIN,
    sum_again,
)
from adaptive_blf_control.identification.tip_load import (
    certain_part,
    fit_tip_load,
    forget_tip_load,
    new_tip_load,
    open_torque,
    TipLoad,
)
from adaptive_blf_control.linear_algebra import product

__all__ = ['ADAPT', 'ALARMS', 'CONTACTS', 'DOUBT', 'FORGET', 'HELD', 'KEEP', 'KNOWN', 'LEARN',
           'LOADED', 'LOADS', 'QUIET', 'RECALL', 'REMEMBERS', 'ResponseArrays', 'STATE', 'STATES',
           'forget_response', 'judged', 'new_response', 'remembered', 'respond', 'retreat']

STATES = ('quiet', 'doubt', 'held', 'loaded')
QUIET, DOUBT, HELD, LOADED = range(4)

# What `respond` lets be done with a pair: everything; nothing but learning from the recorded
# ones; nothing but Xᵀe2, without any pair; nothing at all; or the recorded ones are forgotten.
LEARN, RECALL, ADAPT, KEEP, FORGET = range(5)

# Elements of `ResponseArrays.counts` ...
STATE, ALARMS, CONTACTS, LOADS, REMEMBERS = range(5)
# ... and of `ResponseArrays.clock`.
SINCE, CLEAR, EXPLAINED, KNOWN = range(4)

CONFIRM = 3.0  # windows for which a load has to predict the pairs
SLOWLY = 20.0  # windows over which the ordinary d² is followed
MOST = 4.0  # suspicions: no d² in a doubt counts more for it, so that it hides no change
LONG = 5.0  # windows for which it is fitted further at least
REMAINS = 0.01  # part of what forgotten pairs said that stays beside new ones ...
ENOUGH = 0.5  # ... until their σ_min is this part of what it was


class ResponseArrays(NamedTuple):
    """The response and its settings as compiled functions take it; arrays are changed in place.

    Attributes:
        counts: By name: STATE, one of `STATES`; how many ALARMS there were, how many of them were
            CONTACTS or LOADS; whether it REMEMBERS what forgotten pairs said; shape (5,).
        clock: By name: time SINCE the state began, for which the residual was CLEAR, for which a
            load EXPLAINED it, and for which the recorded pairs have determined a model, KNOWN,
            shape (4,) [s].
        before: θ̂ before the doubt, shape (m,).
        gram: What is left of Q of forgotten pairs, shape (m, m).
        moment: Likewise Σ Y_fjᵀ τ_fj, shape (m,).
        strength: σ_min of those pairs, shape (1,).
        load: The load that is looked for.
        suspicion: Mean of d² from which on nothing is recorded; 0: the response is off.
        memory: How long the filters remember a sample [s].
        settling: Time after an alarm after which they have forgotten what was before it [s].
        patience: Longest time that is waited for an explanation [s].
        contact: Whether a contact is known of.
        adapts: Whether Xᵀe2 moves θ̂ while it is held.
    """

    counts: np.ndarray
    clock: np.ndarray
    before: np.ndarray
    gram: np.ndarray
    moment: np.ndarray
    strength: np.ndarray
    load: TipLoad
    suspicion: float
    memory: float
    settling: float
    patience: float
    contact: bool
    adapts: bool


def new_response(n: int, m: int, directions: np.ndarray) -> ResponseArrays:
    """Return a quiet response that is off, for n joints, m parameters and loads along B."""
    return ResponseArrays(
        np.zeros(5, dtype=np.int64), np.zeros(4), np.zeros(m), np.zeros((m, m)), np.zeros(m),
        np.zeros(1), new_tip_load(n, directions), 0.0, 0.0, 0.0, 0.0, False, False)


@jit
def forget_response(response: ResponseArrays) -> None:
    """Be quiet: the recorded pairs are gone, by request."""
    response = borrowed(response)
    response.counts[STATE] = QUIET
    response.counts[REMEMBERS] = 0
    response.clock[:] = 0.0


@jit
def _enter(response: ResponseArrays, state: int) -> None:
    response = borrowed(response)
    response.counts[STATE] = state
    response.clock[:KNOWN] = 0.0


@jit
def _hold(response: ResponseArrays, monitor: ResidualArrays, theta: np.ndarray) -> int:
    """Begin to look for an explanation, from θ̂ as it was before."""
    response, monitor = borrowed(response), borrowed(monitor)
    if response.counts[STATE] == DOUBT:
        theta[:] = response.before
    response.before[:] = theta
    forget_tip_load(response.load, monitor.theta)
    _enter(response, HELD)
    return _moved(response)


@jit
def _moved(response: ResponseArrays) -> int:
    return ADAPT if response.adapts else KEEP


@jit
def respond(response: ResponseArrays, monitor: ResidualArrays, history: Pairs, theta: np.ndarray,
            dt: float, regressor: np.ndarray, torque: np.ndarray, settled: bool) -> int:
    """Compare a pair with the recorded ones, and say what may be done with it.

    Args:
        response: The response; changed in place.
        monitor: What compares; likewise.
        history: The recorded pairs; those of an arm with a load become others.
        theta: θ̂, shape (m,); likewise.
        dt: Time since the last pair [s].
        regressor: Y_f, shape (n, m).
        torque: τ_f, shape (n,) [N·m].
        settled: Whether the filters have forgotten their start.

    Returns:
        LEARN, RECALL, KEEP or FORGET.
    """
    response, monitor = borrowed(response), borrowed(monitor)
    counts, clock, suspicion = response.counts, response.clock, response.suspicion
    contradiction = settled and contradicted(monitor, dt, regressor, torque, history)
    if response.contact:
        if counts[STATE] != HELD:
            _hold(response, monitor, theta)
        clock[:KNOWN] = 0.0
        return KEEP
    if not settled:
        return _moved(response) if counts[STATE] == HELD else LEARN
    clock[SINCE] += dt
    top = np.max(monitor.statistic) if suspicion > 0.0 else 0.0
    if counts[STATE] == HELD:
        return _held(response, monitor, history, theta, dt, regressor, torque, top)
    if suspicion <= 0.0:
        return FORGET if contradiction else LEARN
    if contradiction:
        counts[ALARMS] += 1
        return _hold(response, monitor, theta)
    if counts[STATE] == LOADED:
        return _loaded(response, monitor, history, theta, dt, regressor, torque)
    _forget_what_remains(response, history)
    _follow_ordinary(response, monitor, dt)
    return _doubt(response, theta, top)


@jit
def _follow_ordinary(response: ResponseArrays, monitor: ResidualArrays, dt: float) -> None:
    """Let what d² is divided by follow the pairs; a doubt slows that down."""
    response, monitor = borrowed(response), borrowed(monitor)
    if not np.isfinite(monitor.scale[0]):
        response.clock[KNOWN] = 0.0
        return
    if response.clock[KNOWN] == 0.0:
        monitor.ordinary[:] = monitor.threshold
    response.clock[KNOWN] += dt
    doubt = response.counts[STATE] == DOUBT
    part = min(dt / (response.patience if doubt else SLOWLY * monitor.window), 1.0)
    most = min(MOST * response.suspicion if doubt else monitor.threshold, monitor.threshold)
    for i in range(monitor.ordinary.size):
        square = min(monitor.residual[i] ** 2 / monitor.scale[i], most)
        followed = monitor.ordinary[i] * (1.0 + part * (square - 1.0))
        monitor.ordinary[i] = max(followed, 1.0)


@jit
def _doubt(response: ResponseArrays, theta: np.ndarray, top: float) -> int:
    response = borrowed(response)
    if top < response.suspicion:
        response.counts[STATE] = QUIET
        return LEARN
    if response.counts[STATE] == QUIET:
        response.before[:] = theta
        _enter(response, DOUBT)
    return RECALL


@jit
def _held(response: ResponseArrays, monitor: ResidualArrays, history: Pairs, theta: np.ndarray,
          dt: float, regressor: np.ndarray, torque: np.ndarray, top: float) -> int:
    response, monitor = borrowed(response), borrowed(monitor)
    counts, clock, load = response.counts, response.clock, response.load
    window, settled = max(monitor.window, 1e-6), clock[SINCE] >= response.settling
    clock[CLEAR] = clock[CLEAR] + dt if top < max(response.suspicion, 1e-300) else 0.0
    if response.suspicion <= 0.0:  # a contact that was known of is over
        return _released(response, theta) if settled else KEEP
    if clock[CLEAR] > window and settled:
        return _released(response, theta)
    if settled and load.found.size > 0:
        fit_tip_load(load, min(dt / response.memory, 1.0), -math.expm1(-dt / window), regressor,
                 torque, monitor.scale)
        predicted = np.max(load.statistic) < response.suspicion
        if not predicted and clock[EXPLAINED] > 0.0:
            theta[:] = response.before
        clock[EXPLAINED] = clock[EXPLAINED] + dt if predicted else 0.0
    if clock[EXPLAINED] > CONFIRM * window:
        counts[LOADS] += 1
        _enter(response, LOADED)
        monitor.statistic[:] = 0.0
        theta[:] = response.before
        _follow_load(load, monitor, history, theta)
        return RECALL
    if clock[SINCE] >= response.patience:
        return FORGET
    if response.adapts and clock[EXPLAINED] > 0.0:
        theta[:] = response.before + product(load.directions, certain_part(load))
        return KEEP
    return _moved(response)


@jit
def _released(response: ResponseArrays, theta: np.ndarray) -> int:
    response = borrowed(response)
    theta[:] = response.before
    response.counts[CONTACTS] += 1
    _enter(response, QUIET)
    return LEARN


@jit
def _loaded(response: ResponseArrays, monitor: ResidualArrays, history: Pairs, theta: np.ndarray,
            dt: float, regressor: np.ndarray, torque: np.ndarray) -> int:
    """Go on fitting the load, and let θ̂ and the recorded pairs follow."""
    response, monitor = borrowed(response), borrowed(monitor)
    load, since = response.load, response.clock[SINCE]
    fit_tip_load(load, min(dt / response.memory, 1.0), -math.expm1(-dt / monitor.window),
                 regressor, torque, monitor.scale)
    _follow_load(load, monitor, history, theta)
    if since >= LONG * monitor.window:
        rest = open_torque(load, history.regressors[:history.counters[COUNT]])
        if np.all(rest <= monitor.scale) or since >= response.patience:
            sum_again(history)
            _enter(response, QUIET)
    return RECALL


@jit
def _follow_load(load: TipLoad, monitor: ResidualArrays, history: Pairs,
                 theta: np.ndarray) -> None:
    """Let θ̂, θ_s and the recorded pairs be those of the arm with the load."""
    load, monitor = borrowed(load), borrowed(monitor)
    change = product(load.directions, load.found - load.applied)
    load.applied[:] = load.found
    shift_torques(history, change)
    theta[:] = theta + change
    monitor.theta[:] = load.base + product(load.directions, load.found)
    monitor.revision[0] = history.counters[REVISION]


@jit
def retreat(response: ResponseArrays, monitor: ResidualArrays, history: Pairs,
            theta: np.ndarray) -> None:
    """Keep a part of what the pairs say that are forgotten next; θ̂ becomes that of before."""
    response = borrowed(response)
    if response.suspicion <= 0.0:
        return
    theta[:] = response.before
    response.gram[:] = REMAINS * history.gram
    response.moment[:] = product(response.gram, theta)
    response.strength[0] = history.figures[SIGMA_MIN]
    response.counts[REMEMBERS] = 1
    _enter(response, QUIET)


@by_type
def judged(monitor: ChangeMonitor, response: ResponseArrays, history: History, theta: np.ndarray,
           dt: float, regressor: np.ndarray, torque: np.ndarray, settled: bool) -> int:
    """Return what may be done with a pair, see `respond`.

    A foreign monitor says only whether the arm has changed. A contact that is known of is heeded
    beside it, until the filters have forgotten it.
    """
    if response.contact:
        if response.counts[STATE] != HELD:
            _enter(response, HELD)
        response.clock[SINCE] = 0.0
        return KEEP
    if response.counts[STATE] == HELD:
        response.clock[SINCE] += dt
        if response.clock[SINCE] < response.settling:
            return KEEP
        response.counts[CONTACTS] += 1
        _enter(response, QUIET)
    return FORGET if settled and contradicted(monitor, dt, regressor, torque, history) else LEARN


@jit
def _judged_by_ours(monitor: ResidualArrays, response: ResponseArrays, history: Pairs,
                    theta: np.ndarray, dt: float, regressor: np.ndarray, torque: np.ndarray,
                    settled: bool) -> int:
    response = borrowed(response)
    if not settled:
        nothing_compared(monitor)
    if response.suspicion > 0.0 or response.contact or response.counts[STATE] != QUIET:
        verdict = respond(response, monitor, history, theta, dt, regressor, torque, settled)
        if verdict == FORGET:
            retreat(response, monitor, history, theta)
        return verdict
    contradiction = settled and contradicted(monitor, dt, regressor, torque, history)
    return FORGET if contradiction else LEARN


judged.register(ResidualArrays, _judged_by_ours)


@jit
def _forget_what_remains(response: ResponseArrays, history: Pairs) -> None:
    response = borrowed(response)
    if response.counts[REMEMBERS] and history.counters[RANK] == response.moment.size and (
            history.figures[SIGMA_MIN] >= ENOUGH * response.strength[0]):
        response.counts[REMEMBERS] = 0


@jit
def remembered(response: ResponseArrays, gram: np.ndarray, moment: np.ndarray,
               ) -> tuple[np.ndarray, np.ndarray]:
    """Return the sums over the recorded pairs, with what is left of forgotten ones."""
    return gram + response.gram, moment + response.moment
