# SPDX-License-Identifier: Apache-2.0
"""Everything that a bag holds of a run; what it does not hold is named, not fatal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import yaml

from adaptive_blf_control.bags.reader import Bag, JointSeries, read_bag, TopicInfo
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import node_settings
from adaptive_blf_control.control.constraints import Constraints
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.control.settings import PerformanceSettings, SafetySettings
from adaptive_blf_control.errors import BagError, BlfError
from adaptive_blf_control.messages.cdr import decode_string
from adaptive_blf_control.messages.diagnostics import drop_counters
from adaptive_blf_control.messages.topics import (
    BARRIER,
    COMMANDS,
    EXTERNAL_TORQUE,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    JOINT_STATES,
    REFERENCE,
    RESERVE,
    ROBOT_DESCRIPTION,
    THETA_HAT,
    TRACKING_ERROR,
)
from adaptive_blf_control.runs.bag_payload import payload_masses
from adaptive_blf_control.runs.bag_run import (
    bag_parameters,
    constraints_of,
    run_of_bag,
    topic_named,
)
from adaptive_blf_control.runs.margins import Margins, margins_along, published_margins
from adaptive_blf_control.runs.summary import Run, state_along

__all__ = ['Recording', 'Series', 'read_recording']

T = TypeVar('T')
TOGETHER = 0.1  # s: external torques closer to one another are one interval


class Series(NamedTuple):
    """Values over time: ``t`` of shape (N,) [s], ``values`` of shape (N,) or (N, k)."""

    t: np.ndarray
    values: np.ndarray


class Answered(NamedTuple):
    """States the controller answered, matched by stamp.

    Attributes:
        t: Shape (N,) [s].
        q: Shape (N, n) [rad].
        qd: Shape (N, n) [rad/s].
        e1: Shape (N, n) [rad].
        e2: Shape (N, n) [rad/s].
    """

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    e1: np.ndarray
    e2: np.ndarray


@dataclass(frozen=True)
class Recording:
    """A run as its bag shows it. Time is 0 at the first state that the controller answered.

    Attributes:
        name: Short name for legends.
        path: Where the bag is.
        problem: Why the bag is not whole, or None.
        missing: What could not be read, one sentence each.
        topics: Topics by name.
        parameters: The parameter file of the run, or None.
        robot_description: URDF of the arm, or None.
        joints: Joint names, length n; () where nothing names them.
        theta_names: Parameter names, length m.
        safety: Safety set (7), or None.
        performance: Performance set (8), or None.
        q: Positions [rad], (N, n).
        reference: y_d [rad], (N, n).
        e1: Tracking error [rad], (N, n).
        constraints: What counts as inside, as far as it can be made here, or None.
        published: Margins of all constraints, as published.
        torque: Applied torque [N·m], (N, n); the commanded one where effort was not measured.
        theta_hat: Estimates, (N, m).
        rank: Rank of the history stack, (N,).
        sigma_min: σ_min of the history stack, (N,).
        lyapunov: V as published, (N,).
        payload: Mass of the load and its standard deviation [kg], (N, 2); None where none was
            looked for.
        external: What is measured beyond what the recorded pairs predict, and its bound [N·m],
            (N, 2n); None where nobody tells it.
        reserve: What a safety filter said of itself, (N, k); None without one.
        reserve_names: What each of these is, length k.
        answered: States and errors matched by stamp.
        run: The run as `summarise` wants it; None where the bag lacks something it needs.
        states: joint_states as read, for timing.
        errors: controller/tracking_error as read, for timing.
        commands_ns: Times of reception of the commands, shape (N,) [ns].
        drops: Counters of dropped messages from the diagnostics.
    """

    name: str
    path: str
    problem: str | None
    missing: tuple[str, ...]
    topics: dict[str, TopicInfo]
    parameters: dict[str, Any] | None = None
    robot_description: str | None = None
    joints: tuple[str, ...] = ()
    theta_names: tuple[str, ...] = ()
    safety: JointInterval | None = None
    performance: JointInterval | None = None
    q: Series | None = None
    reference: Series | None = None
    e1: Series | None = None
    constraints: Constraints | None = None
    published: tuple[Margins, ...] = ()
    torque: Series | None = None
    theta_hat: Series | None = None
    rank: Series | None = None
    sigma_min: Series | None = None
    lyapunov: Series | None = None
    payload: Series | None = None
    external: Series | None = None
    reserve: Series | None = None
    reserve_names: tuple[str, ...] = ()
    answered: Answered | None = None
    run: Run | None = None
    states: JointSeries | None = None
    errors: JointSeries | None = None
    commands_ns: np.ndarray | None = None
    drops: list[dict[str, str | int]] = field(default_factory=list)

    @property
    def disturbed(self) -> tuple[tuple[float, float], ...]:
        """Intervals in which an external torque is beyond its bound, (begin, end) [s]."""
        if self.external is None:
            return ()
        n = len(self.joints)
        size, bound = np.abs(self.external.values[:, :n]), self.external.values[:, n:]
        found: list[tuple[float, float]] = []
        for t in self.external.t[(size > bound).any(axis=1)].tolist():
            begin = found.pop()[0] if found and t - found[-1][1] <= TOGETHER else t
            found.append((begin, t))
        return tuple(found)

    @property
    def margins(self) -> tuple[Margins, ...]:
        """Margins from states and errors, for other constraints as they were published."""
        answered, made = self.answered, self.constraints
        if answered is None or made is None or self.performance is None:
            return self.published
        known = {part.name for part in made.parts}
        run = state_along(answered.t, answered.q, answered.qd, answered.e1, self.performance)
        return margins_along(made, run) + tuple(
            each for each in self.published if each.constraint not in known)


class _Tolerant:
    """Reads one bag topic by topic and remembers what failed."""

    def __init__(self, bag: Bag) -> None:
        self.bag = bag
        self.missing: list[str] = []

    def attempt(self, what: str, read: Callable[[], T]) -> T | None:
        """Return what ``read`` returns, or note why ``what`` is missing."""
        try:
            return read()
        except (BlfError, yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
            reason = str(error).removeprefix(f'{self.bag.path}: ')
            self.missing.append(f'{what}: {reason}')
            return None

    def joints(self, topic: str, what: str,
               joints: tuple[str, ...] | None = None) -> JointSeries | None:
        return self.attempt(what, lambda: self.bag.joint_states(
            self._named(topic), joints, skip_foreign=True))

    def doubles(self, topic: str, what: str) -> tuple[np.ndarray, np.ndarray] | None:
        return self.attempt(what, lambda: self.bag.doubles(self._named(topic)))

    def _named(self, topic: str) -> str:
        try:
            return topic_named(self.bag, topic)
        except BagError:
            raise BagError(f'no topic {topic!r}') from None


class _Clock:
    """Turns stamps, and times of reception by way of the joint states, into seconds."""

    def __init__(self, zero_ns: int, states: JointSeries | None) -> None:
        self._zero = zero_ns
        self._states = states

    def of_stamp(self, stamp_ns: np.ndarray) -> np.ndarray:
        return (stamp_ns - self._zero) * 1e-9

    def of_log(self, log_ns: np.ndarray) -> np.ndarray:
        if self._states is None:
            return (log_ns - self._zero) * 1e-9
        heard = np.maximum.accumulate(self._states.log_time_ns)
        # Differences first: absolute nanoseconds do not fit a double.
        return np.interp((log_ns - heard[0]) * 1e-9, (heard - heard[0]) * 1e-9,
                         self.of_stamp(self._states.stamp_ns))


def read_recording(path: Path | str) -> Recording:
    """Read a bag as far as it goes.

    Raises:
        BagError: the path holds no bag, or not one message.
    """
    bag = read_bag(path)
    reader = _Tolerant(bag)
    parameters = reader.attempt('parameters', lambda: bag_parameters(bag))
    controller = reader.attempt('parameters of the controller', lambda: node_settings(
        parameters, ControllerNodeSettings)) if parameters else None
    named = controller.joints if controller else None
    states = reader.joints(JOINT_STATES, 'positions', named)
    joints = named or (states.names if states else ())
    errors = reader.joints(TRACKING_ERROR, 'tracking error', joints or None)
    joints = joints or (errors.names if errors else ())
    answered, zero = _answered(states, errors)
    clock = _Clock(zero if zero is not None else _first_time(bag), states)
    data = _topics(reader, clock, joints, states, errors)
    if answered is not None:
        data['answered'] = answered._replace(t=clock.of_stamp(answered.t))
    if controller:
        data['safety'] = _interval(reader, controller.safety, 'safety', len(joints))
        data['performance'] = _interval(reader, controller.performance, 'performance',
                                        len(joints))
        data['constraints'] = reader.attempt('sets', lambda: constraints_of(controller))
    run = _run(reader)
    drops = drop_counters(m.data for m in bag.messages(('/diagnostics',)))
    return Recording(
        name=_short_name(bag.path), path=str(bag.path), problem=bag.problem,
        missing=tuple(reader.missing), topics=bag.topics, parameters=parameters,
        robot_description=_description(bag), joints=joints, run=run, states=states,
        errors=errors, drops=drops, **data)


def _description(bag: Bag) -> str | None:
    """Return the URDF in a bag; None where there is none, as in bags of before that topic."""
    try:
        topic = topic_named(bag, ROBOT_DESCRIPTION)
        return next((decode_string(message.data) for message in bag.messages((topic,))), None)
    except BagError:
        return None


def _interval(reader: _Tolerant, bounds: SafetySettings | PerformanceSettings, name: str,
              n: int) -> JointInterval | None:
    def make() -> JointInterval:
        full = bounds.resolved(joints=n)
        return JointInterval(full.lower, full.upper, name)
    return reader.attempt(f'{name} set', make)


def _run(reader: _Tolerant) -> Run | None:
    """Return the whole run; where it fails for a reason not named yet, note it."""
    noted = list(reader.missing)
    run = reader.attempt('summary', lambda: run_of_bag(reader.bag))
    if noted:
        reader.missing[:] = noted
    return run


def _short_name(path: Path) -> str:
    """Name a bag by its folder; a folder that is just called bag, by the one around it."""
    path = path.resolve()
    name = path.name if path.is_dir() else path.stem
    return f'{path.parent.name}/{name}' if name in ('bag', 'bag_0') else name


def _first_time(bag: Bag) -> int:
    return next(iter(bag)).log_time_ns


def _answered(states: JointSeries | None,
              errors: JointSeries | None) -> tuple[Answered | None, int | None]:
    """Match states and errors by stamp (``t`` still in ns); and the stamp that is time 0."""
    if states is None:
        return None, int(errors.stamp_ns[0]) if errors else None
    if errors is None:
        return None, int(states.stamp_ns[0])
    stamps, at_state, at_error = np.intersect1d(states.stamp_ns, errors.stamp_ns,
                                                return_indices=True)
    if stamps.size == 0:
        return None, int(states.stamp_ns[0])
    return Answered(stamps, states.position[at_state], states.velocity[at_state],
                    errors.position[at_error], errors.velocity[at_error]), int(stamps[0])


def _topics(reader: _Tolerant, clock: _Clock, joints: tuple[str, ...],
            states: JointSeries | None, errors: JointSeries | None) -> dict[str, Any]:
    """Read the remaining topics into the fields of a `Recording`."""
    data: dict[str, Any] = {}
    if states is not None:
        data['q'] = Series(clock.of_stamp(states.stamp_ns), states.position)
    if errors is not None:
        data['e1'] = Series(clock.of_stamp(errors.stamp_ns), errors.position)
    if reference := reader.joints(REFERENCE, 'reference', joints or None):
        data['reference'] = Series(clock.of_stamp(reference.stamp_ns), reference.position)
    if estimates := reader.joints(THETA_HAT, 'estimates'):
        learning = estimates.stamp_ns >= (states or estimates).stamp_ns[0]
        data['theta_hat'] = Series(clock.of_stamp(estimates.stamp_ns[learning]),
                                   estimates.position[learning])
        data['theta_names'] = estimates.names
    for topic, name in ((HISTORY_RANK, 'rank'), (HISTORY_SIGMA_MIN, 'sigma_min')):
        if pair := reader.doubles(topic, f'{name} of the history stack'):
            data[name] = Series(clock.of_log(pair[0]), pair[1])
    data.update(_barrier(reader, clock))
    reserve = reader.joints(RESERVE, 'reserve') if _there(reader.bag, RESERVE) else None
    if reserve is not None:
        data['reserve'] = Series(clock.of_stamp(reserve.stamp_ns), reserve.position)
        data['reserve_names'] = reserve.names
    if load := reader.attempt('load', lambda: payload_masses(reader.bag)):
        data['payload'] = Series(clock.of_stamp(load[0]), load[1])
    data.update(_external(reader, clock, joints))
    commands = reader.doubles(COMMANDS, 'commands')
    if commands is not None:
        data['commands_ns'] = commands[0]
    if states is not None and np.isfinite(states.effort).any():
        data['torque'] = Series(clock.of_stamp(states.stamp_ns), states.effort)
    elif commands is not None and np.ndim(commands[1]) == 2 and \
            commands[1].shape[1] == len(joints):
        data['torque'] = Series(clock.of_log(commands[0]), commands[1])
    return data


def _there(bag: Bag, topic: str) -> bool:
    """Return whether a topic that not every run has was published."""
    try:
        return bag.topics[topic_named(bag, topic)].count > 0
    except BagError:
        return False


def _external(reader: _Tolerant, clock: _Clock, joints: tuple[str, ...]) -> dict[str, Any]:
    names = (*joints, *(f'{joint}.bound' for joint in joints))
    if not _there(reader.bag, EXTERNAL_TORQUE):
        return {}
    topic = topic_named(reader.bag, EXTERNAL_TORQUE)
    found = reader.attempt('external torque', lambda: reader.bag.joint_states(topic, names))
    return {} if found is None else {
        'external': Series(clock.of_stamp(found.stamp_ns), found.position)}


def _barrier(reader: _Tolerant, clock: _Clock) -> dict[str, Any]:
    barrier = reader.joints(BARRIER, 'barrier')
    if barrier is None:
        return {}
    t, names = clock.of_stamp(barrier.stamp_ns), barrier.names
    found: dict[str, Any] = {'published': published_margins(names, t, barrier.position)}
    if 'V' in names:
        found['lyapunov'] = Series(t, barrier.position[:, names.index('V')])
    return found
