# SPDX-License-Identifier: Apache-2.0
"""The adaptive controller: measured state and θ̂ in, torque and adaptation term out."""

from __future__ import annotations

from collections.abc import Mapping
import copy
import functools
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm, checked_arm
from adaptive_blf_control.arms.regressors import arrays_of
from adaptive_blf_control.arrays import (
    are_vectors,
    checked_array,
    checked_number,
    checked_vectors,
)
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.compiled import handle
from adaptive_blf_control.control.barrier import barrier
from adaptive_blf_control.control.constraints import Constraint, Constraints, MotionState
from adaptive_blf_control.control.given_parts import (
    given_part,
    Group,
    is_group,
    reference_in_arrays,
)
from adaptive_blf_control.control.law import limited_answer, unwound_term
from adaptive_blf_control.control.laws.ablf import AblfLaw
from adaptive_blf_control.control.laws.choice import checked_law, make_law, retuned_law
from adaptive_blf_control.control.laws.protocol import Law, LawSample
from adaptive_blf_control.control.parts import controller_parts
from adaptive_blf_control.control.reference import (
    Crossfade,
    from_time,
    full_range,
    Reference,
    ReferencePoint,
    SmoothStart,
)
from adaptive_blf_control.control.safety_filter import (
    FilterSample,
    made_filter,
    SafetyFilter,
)
from adaptive_blf_control.control.set_constraints import (
    made_constraint,
    OwnConstraints,
    PerformanceConstraint,
    SafetyConstraint,
    several_constraints,
)
from adaptive_blf_control.control.sets import (
    Bounds,
    check_inside,
    check_no_further_out,
    check_performance_inside_safety,
    GrowingBounds,
    JointInterval,
)
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.control.step import (
    answer_sample,
    ControllerArrays,
    FIRST_INTERVAL,
    Memory,
    new_memory,
)
from adaptive_blf_control.errors import ParameterError, UnknownParameter, with_hints
from adaptive_blf_control.parameters.guided import Guided
from adaptive_blf_control.parameters.settings import Settings

__all__ = ['Controller', 'ControlOutput']


@functools.partial(with_hints, instead={
    **dict.fromkeys(('margin', 'margins', 'distance'), 'controller.margins(output)'),
    **dict.fromkeys(('q', 'qd'), 'state has the sample: state.q and state.qd')})
class ControlOutput(NamedTuple):
    """What one sample of the controller gives; arrays of shape (n,) unless another is given.

    Attributes:
        torque: Commanded torque after the limits [N·m]; always finite.
        adaptation_term: Xᵀ e2 of (37) without what would wind up against a limit, shape (m,).
        state: The sample as the constraints see it.
        e2: q̇ − α [rad/s].
        reference: y_d with derivatives.
        x: Regressor X, shape (n, m); zeros for a law without an adaptation term.
        bound: Active bound (11) [rad].
        wanted: Torque before the limits [N·m].
    """

    torque: np.ndarray
    adaptation_term: np.ndarray
    state: MotionState
    e2: np.ndarray
    reference: ReferencePoint
    x: np.ndarray
    bound: np.ndarray
    wanted: np.ndarray

    @property
    def e1(self) -> np.ndarray:
        """Tracking error (5) [rad]."""
        return self.state.e1

    @property
    def bounds(self) -> Bounds:
        """Performance bounds in use."""
        return self.state.bounds

    @property
    def saturated(self) -> np.ndarray:
        """Where the limit of the torque or of its rate is at work, shape (n,), bool."""
        return self.torque != self.wanted


class _Sets(NamedTuple):
    """What of a controller keeps the arm where it belongs, checked together."""

    safety: JointInterval
    performance: JointInterval
    reference: Reference
    bounds: GrowingBounds


class _Tuning(NamedTuple):
    """What follows from the settings alone, made before any of it is taken."""

    settings: ControllerSettings
    law: Law
    constraints: tuple[Constraint, ...]
    safety_filter: SafetyFilter | None
    barrier_weight: np.ndarray
    torque_limit: np.ndarray
    torque_rate_limit: np.ndarray


class Controller(Guided, settings=ControllerSettings,
                 instead={**dict.fromkeys(
                              ('output', 'torque', 'e1', 'e2', 'error'),
                              'update returns it: output.torque, output.e1, output.e2'),
                          **dict.fromkeys(
                              ('from_yaml', 'from_file', 'from_config', 'load'),
                              'simulate(file, 0.001).controller is that of a parameter file'),
                          **dict.fromkeys(
                              ('publish', 'subscribe', 'spin'),
                              '`python -m adaptive_blf_control controller` is the node'),
                          **dict.fromkeys(
                              ('reset', 'restart', 'start'),
                              'a Controller belongs to one motion: make another one, '
                              'Controller(arm, ..., start=q)'),
                          **dict.fromkeys(
                              ('save', 'to_yaml', 'dump'),
                              'settings.values() has all that it was made with by name; what is '
                              'learned is in the Identifier'),
                          **dict.fromkeys(
                              ('margin_names', 'margins_names', 'names', 'constraint_names'),
                              'constraints.names has them, in the order of margins(output)'),
                          'theta': 'update is given it: the theta of an Identifier',
                          'gains': 'settings has them, retune(k2=...) changes them',
                          'set_reference': 'retune(t, q, reference=...) changes it'}):
    """Equation (38) (or (34), when θ* is passed as θ̂) inside the sets (7) and (8).

    Holds the torque commanded last, so one object belongs to one motion.

    Attributes:
        arm: The arm.
        settings: Gains and limits.
        safety_filter: What the torque passes behind the law; None where there is none.
        safety: Safety set (7).
        performance: Performance set (8), as wide as it gets.
        reference: y_d.
        constraints: What counts as inside: both sets, then those of the safety filter, those of
            the settings and those given.
    """

    settings: ControllerSettings
    safety: JointInterval
    performance: JointInterval
    reference: Reference
    constraints: Constraints
    safety_filter: SafetyFilter | None

    @checked_call
    def __init__(self, arm: Arm, settings: ControllerSettings | None = None,
                 safety: JointInterval | Group | None = None,
                 performance: JointInterval | Group | None = None,
                 reference: Reference | Group | None = None,
                 law: Law | type[Law] | str | None = None,
                 constraints: OwnConstraints = (), *, start: Any = None,
                 velocity: Any = None, **changes: Any) -> None:
        """Check 𝒫̄ ⊆ 𝒮̄ (9); SetViolation names joint and numbers where it fails.

        With a `SmoothStart` the performance bounds grow along with it (`GrowingBounds`), so that
        the motion may begin anywhere inside the safety set.

        Args:
            arm: The arm.
            settings: Gains, limits, sets and reference; the defaults where None.
            safety: Safety set (7) in place of that of the settings, or its settings, or
                ``(-1.0, 1.0)`` for every joint.
            performance: Performance set (8), likewise.
            reference: y_d in place of the sinusoids of the settings, or their settings by joint.
            law: In place of the law that the settings name: a law, a class of laws, which is
                called with the arm and the settings, or a name.
            constraints: Beside those that the settings name: a constraint, a class or a name, or
                several of them.
            start: Posture that the motion begins in, shape (n,) [rad]: it is joined to the
                reference over ``reference.smooth_start``. None begins on the reference.
            velocity: Velocity that it begins with, shape (n,) [rad/s]; at rest where None.
            changes: Settings by name: ``k1=40.0``, ``safety={'upper': 2.0}``,
                ``reference={'joint1': {'amplitude': 0.5}}``, ``**{'safety.upper': 2.0}``.

        Raises:
            ParameterError: a setting is not known, cannot be used or does not fit the arm.
            SetViolation: see above, or the start lies outside a set.
        """
        self.arm = checked_arm('arm', arm)
        groups = {'safety': safety, 'performance': performance, 'reference': reference}
        changes.update((name, value) for name, value in groups.items() if is_group(name, value))
        if isinstance(law, str):
            changes['law'] = law
        try:
            settings = ControllerSettings.taken(settings, changes, of_any_arm=True)
        except UnknownParameter as error:  # may also be meant for an argument
            raise error.beside(('settings', 'start', 'velocity')) from None
        parts: dict[str, Any] = controller_parts(settings, arm.joints)._asdict()
        for name, value in groups.items():
            if value is not None and name not in changes:
                parts[name] = given_part(name, value)
        follow = reference_in_arrays(parts['reference'], arm.joints)
        if start is not None:
            start = checked_array('start', start, (arm.n,), arm.joints)
            if settings.reference.smooth_start > 0.0:
                follow = SmoothStart(follow, settings.reference.smooth_start, start)
        self._given_law = None if isinstance(law, str) else law
        self._given_constraints = several_constraints(constraints)
        self._no_regressor = np.zeros((arm.n, arm.m))
        self._not_measured = np.full(arm.n, np.nan)
        self._n, self._m = (arm.n,), (arm.m,)
        self._memory = new_memory(arm.n)
        self._path_time = 0.0
        self._smooth_start = follow if isinstance(follow, SmoothStart) else None
        self._take(self._tuned(_with_safety(settings, parts['safety'])),
                   self._checked(0.0, parts['safety'], parts['performance'], follow))
        self.constraints.check(self.state(0.0, follow.at(0.0).position, np.zeros(arm.n)))
        if start is not None:
            self.check_start(start, velocity)

    def __repr__(self) -> str:
        """Name the arm and its sets."""
        return (f'<Controller of {self.arm!r}: safety {self.safety.lower.tolist()} to '
                f'{self.safety.upper.tolist()} rad>')

    def __copy__(self) -> Controller:
        """Return a controller that goes on from here and leaves this one unchanged."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other._memory = Memory(*(array.copy() for array in self._memory))
        vars(other)['safety_filter'] = copy.copy(self.safety_filter)
        if self._arrays is not None:
            other._arrays, other._handle = self._arrays._replace(memory=other._memory), None
        return other

    def __getstate__(self) -> dict[str, Any]:
        """Return what a deep copy or a pickle takes: all but the handle, which it makes again."""
        return {**self.__dict__, '_handle': None}

    def _tuned(self, settings: ControllerSettings, before: Law | None = None,
               filter_before: SafetyFilter | None = None) -> _Tuning:
        full, given = settings.resolved(joints=self.arm.n), self._given_law
        law = None if before is None else retuned_law(before, full)
        if law is None:
            law = (make_law(self.arm, full) if given is None else
                   checked_law('law', given, given, self.arm, full))
        names = (name for name in full.constraints if name)
        # Copies that may be written to: the compiled functions take those.
        return _Tuning(full, law, tuple(made_constraint(self.arm, full, each)
                                        for each in (*names, *self._given_constraints)),
                       made_filter(self.arm, full, filter_before), full.barrier_weight.copy(),
                       full.torque_limit.copy(), full.torque_rate_limit.copy())

    def _checked(self, t: float, safety: JointInterval, performance: JointInterval,
                 reference: Reference) -> _Sets:
        """Return the sets and the reference for the motion from ``t`` on; SetViolation by (9)."""
        joints, begun = self.arm.joints, self._smooth_start
        check_performance_inside_safety(safety, performance, full_range(reference), joints)
        if begun is None or t >= begun.duration:
            return _Sets(safety, performance, reference, GrowingBounds(performance))
        check_inside(safety.lower, safety.upper, begun.start, joints,
                     'start position outside the safety set', SafetyConstraint.recovery)
        return _Sets(safety, performance, reference,
                     GrowingBounds(performance, safety, begun.start, begun.duration))

    def _take(self, tuning: _Tuning, sets: _Sets) -> None:
        (settings, self._law, _, safety_filter, self._weight, self._limit,
         self._rate_limit) = self._tuning = tuning
        self._bounds = sets.bounds
        joints = self.arm.joints
        arm = arrays_of(self.arm)
        self._handle: Any = None  # of the arrays, made with the first sample
        self._arrays = None if arm is None or type(self._law) is not AblfLaw else (
            ControllerArrays(arm, self._law.gains, self._limit, self._rate_limit, self._memory))
        constraints = Constraints([SafetyConstraint(joints, sets.safety),
                                   PerformanceConstraint(joints),
                                   *getattr(safety_filter, 'constraints', ()),
                                   *tuning.constraints], joints)
        # Not as attributes are set: there these names are refused, see `Guided`.
        vars(self).update(settings=settings, safety=sets.safety, performance=sets.performance,
                          reference=sets.reference, constraints=constraints,
                          safety_filter=safety_filter)

    def state(self, t: float, q: np.ndarray, qd: np.ndarray) -> MotionState:
        """Return a state as the constraints see it: with e1 and the bounds in use.

        Args:
            t: Time since the start of the motion [s].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
        """
        return MotionState(t, q, qd, q - self.reference.at(t).position, self._bounds.at(t))

    def path_time(self, t: float) -> float:
        """Return the time of the reference that belongs to the sample at ``t`` [s], the last one.

        They differ where a reference governor slows the reference down.
        """
        governed = getattr(self.safety_filter, 'governor', None) is not None
        return self._path_time if governed else t

    @checked_call
    def check_start(self, q: Any, qd: Any = None) -> None:
        """Raise SetViolation where the first measured state is not inside.

        Args:
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s]; at rest where None.
        """
        q = checked_array('q', q, self._n, self.arm.joints)
        qd = (np.zeros(self.arm.n) if qd is None
              else checked_array('qd', qd, self._n, self.arm.joints))
        self.constraints.check_start(self.state(0.0, q, qd))

    @property
    def law(self) -> Law:
        """The law in use."""
        return self._law

    @property
    def arrays(self) -> ControllerArrays | None:
        """The controller as `controller_step` takes it; None where it has to be asked itself.

        It is None for another law than (38), an arm without arrays, or with a safety filter.
        """
        return self._arrays if self.safety_filter is None else None

    def bounds(self, t: float) -> Bounds:
        """Return the performance bounds in use at ``t`` [s], with their rates."""
        return self._bounds.at(t)

    def bounds_along(self, times: np.ndarray) -> Bounds:
        """Return the bounds in use at N times, (N,) [s]; the arrays have shape (N, n)."""
        return self._bounds.along(times)

    @checked_call
    def retune(self, t: float | None = None, q: Any = None, *,
               settings: ControllerSettings | None = None,
               safety: JointInterval | Group | None = None,
               performance: JointInterval | Group | None = None,
               reference: Reference | Group | None = None, blend_time: float = 0.0,
               **changes: Any) -> None:
        """Change what is given, from ``t`` on: all of it or, with an error, nothing.

        Gains and limits alone are taken whatever the state. A new set has to hold the present
        state strictly inside; what is outside already may not get further
        out. (9) has to hold with all that is new, both references included.

        Args:
            t: Time of the last sample [s] since the start of the motion; needed where a set or
                the reference changes.
            q: Positions measured then, shape (n,) [rad]; likewise.
            settings: Gains and limits.
            safety: Safety set (7), or what changes of its settings.
            performance: Performance set (8), likewise.
            reference: Reference to follow, likewise; its time is that of the motion.
            blend_time: Crossfade from the present reference to it [s]; 0 goes over at once.
            changes: Settings by name, as the constructor takes them: ``k2=50.0``.

        Raises:
            SetViolation: with joint, value and bound.
            ParameterError: a value cannot be used.
        """
        joints = self.arm.joints
        if isinstance(t, (str, Mapping, Settings)):
            raise ParameterError('t', t, 'a time; parameters are given by name, retune(k2=50.0), '
                                 'or as retune(settings=...)')
        groups: dict[str, Any] = {'safety': safety, 'performance': performance,
                                  'reference': reference}
        changes.update((name, value) for name, value in groups.items() if is_group(name, value))
        wanted = None
        if settings is not None or changes:
            wanted = ControllerSettings.taken(self.settings if settings is None else settings,
                                              changes)
        for name, value in groups.items():
            if value is not None and name not in changes:
                part = given_part(name, value)
                groups[name] = (reference_in_arrays(part, self.arm.joints)
                                if name == 'reference' else part)
        made = controller_parts(wanted, joints)._asdict() if wanted and changes else {}
        for name in groups:
            if any(given.partition('.')[0] == name for given in changes):
                groups[name] = made[name]
        self._retune(t, q, wanted, **groups, blend_time=blend_time)

    def _retune(self, t: float | None, q: Any, settings: ControllerSettings | None,
                safety: JointInterval | None, performance: JointInterval | None,
                reference: Reference | None, blend_time: float) -> None:
        moved = any(part is not None for part in (safety, performance, reference))
        for name, value in (('t', t), ('q', q)):
            if moved and value is None:
                raise ParameterError(name, None, 'that of the last sample: new sets and '
                                     'references are checked against it')
        joints = self.arm.joints
        q = np.zeros(self.arm.n) if q is None else checked_array('q', q, self._n, joints)
        t = 0.0 if t is None else self.path_time(checked_number('t', t))
        tuning = self._tuning
        if settings is not None or (safety is not None and self.safety_filter is not None):
            taken = self.settings if settings is None else ControllerSettings.taken(settings, {})
            tuning = self._tuned(_with_safety(taken, safety or self.safety), self._law,
                                 self.safety_filter)
        if not moved:
            self._take(tuning, _Sets(self.safety, self.performance, self.reference, self._bounds))
            return
        sets = _Sets(self.safety, self.performance, self.reference, self._bounds)
        follow = from_time(self.reference, t)
        if reference is not None and blend_time != 0.0:
            follow = Crossfade(follow, from_time(reference, t), t, blend_time)
        elif reference is not None:
            follow = from_time(reference, t)
        if any(part is not None for part in (safety, performance, reference)):
            sets = self._checked(t, safety or self.safety, performance or self.performance, follow)
            if safety is not None:
                check_no_further_out(safety.lower, safety.upper, q, self.safety.margin(q), joints,
                                     'present position outside the new safety set')
            bounds, present = sets.bounds.at(t), self._bounds.at(t)
            # Those of a smooth start depend on the safety set, too.
            if (performance is not None or reference is not None
                    or (bounds.lower > present.lower).any()
                    or (bounds.upper < present.upper).any()):
                error = q - self.reference.at(t).position
                check_no_further_out(
                    bounds.lower, bounds.upper, q - follow.at(t).position,
                    np.minimum(error - present.lower, present.upper - error), joints,
                    'present error outside the new performance set')
        self._take(tuning, sets)

    def follow(self, reference: Reference) -> None:
        """Go over to a reference that is known to fit; :meth:`retune` is for any other.

        Args:
            reference: One that goes on from the present one, its range inside the sets.
        """
        vars(self)['reference'] = reference

    def carry_on(self, torque: np.ndarray) -> None:
        """Begin the motion with an arm that already is under ``torque``, shape (n,) [N·m]."""
        self._memory.torque[:] = torque

    def shorten_interval(self, t: float, longest: float) -> None:
        """Let the torque at ``t`` [s] change no more than it may within ``longest`` [s].

        For stamps that run ahead of the clock: the rate is limited in real time.
        """
        time = self._memory.time
        time[0] = max(time[0], t - longest)  # NaN stays: max takes its first argument then

    @checked_call
    def update(self, t: float, q: np.ndarray, qd: np.ndarray, theta: np.ndarray,
               torque: np.ndarray | None = None) -> ControlOutput:
        """Compute the torque for the sample taken at ``t`` [s] since the start of the motion.

        Args:
            t: Time of the sample [s].
            q: Measured positions, shape (n,) [rad].
            qd: Measured velocities, shape (n,) [rad/s].
            theta: Parameter estimate θ̂, shape (m,).
            torque: Mean torque applied since the sample before, shape (n,) [N·m]; None where it
                is not measured. For laws that learn by themselves; (38) does not look at it.

        Returns:
            The torque and what it was made of. Nothing is raised for a state that cannot be used:
            with q, q̇ or θ̂ not finite the torque is zero. Outside a set nothing is guaranteed, and
            the torque leads back as far as its limit lets it; :meth:`margins` is then negative.
        """
        t, torque = checked_number('t', t), self._not_measured if torque is None else torque
        if not are_vectors(self._n, q, qd, torque):
            q, qd, torque = checked_vectors(self.arm.joints, q=q, qd=qd, torque=torque)
        theta = checked_array('theta', theta, self._m, self.arm.parameters)
        if self.safety_filter is not None:
            point, bounds = self._governed(self.safety_filter, t, q)
            return self._filtered(self.safety_filter,
                                  LawSample(t, q, qd, torque, point, bounds, theta))
        point, bounds = self.reference.at(t), self._bounds.at(t)
        return self._answered(LawSample(t, q, qd, torque, point, bounds, theta))

    def _governed(self, safety_filter: SafetyFilter, t: float,
                  q: np.ndarray) -> tuple[ReferencePoint, Bounds]:
        """Return the reference and the bounds at a sample as a governor lets them pass."""
        governor = getattr(safety_filter, 'governor', None)
        if governor is None:
            return self.reference.at(t), self._bounds.at(t)
        point, self._path_time, rate = governor.governed(t, q, self.reference)
        bounds = self._bounds.at(self._path_time)
        bounds = bounds._replace(lower_rate=rate * bounds.lower_rate,
                                 upper_rate=rate * bounds.upper_rate)
        governor.heed(bounds)
        return point, bounds

    def _answered(self, sample: LawSample) -> ControlOutput:
        """Answer a sample with the law and the limits of torque and its rate."""
        if self._arrays is None:
            return self._asked(sample)
        t, q, qd, _, point, bounds, theta = sample
        if self._handle is None:
            self._handle = handle(self._arrays)
        answer, x = answer_sample(self._handle, t, q, qd, theta, point, bounds)
        return ControlOutput(answer.torque, answer.term,
                             MotionState(t, q, qd, answer.e1, bounds), answer.e2, point, x,
                             answer.bound, answer.wanted)

    def _filtered(self, safety_filter: SafetyFilter, sample: LawSample) -> ControlOutput:
        """Answer a sample with what the safety filter lets through of the law's torque."""
        memory = self._memory
        last, before = memory.torque.copy(), memory.time[0]
        output = self._answered(sample)
        dt = FIRST_INTERVAL if np.isnan(before) else max(sample.t - before, 0.0)
        reach = self._rate_limit * dt
        least = np.maximum(-self._limit, np.minimum(last - reach, self._limit))
        most = np.minimum(self._limit, np.maximum(last + reach, -self._limit))
        torque = safety_filter.filtered(FilterSample(
            sample.t, sample.q, sample.qd, output.torque, least, most))
        if torque is output.torque:
            return output
        memory.torque[:] = torque
        return output._replace(torque=torque, adaptation_term=unwound_term(
            output.x, output.e2, output.wanted, torque))

    def _asked(self, sample: LawSample) -> ControlOutput:
        """Answer a sample by asking the law in Python: a plug-in, or for an arm without arrays."""
        t, q, qd, _, point, bounds, _ = sample
        answer, memory = self._law.answer(sample), self._memory
        dt = FIRST_INTERVAL if np.isnan(memory.time[0]) else t - memory.time[0]
        e1 = q - point.position
        x = self._no_regressor if answer.regressor is None else answer.regressor
        tau, term, bound = limited_answer(
            answer.torque, x, answer.e2, self._limit, memory.torque, self._rate_limit, dt, e1,
            bounds.lower, bounds.upper)
        memory.torque[:], memory.time[0] = tau, t
        return ControlOutput(tau, term, MotionState(t, q, qd, e1, bounds), answer.e2, point, x,
                             bound, answer.torque)

    @checked_call
    def margins(self, output: ControlOutput) -> np.ndarray:
        """Return the margins of all constraints at a sample, shape (K,).

        A margin is the distance to the nearer bound, negative outside. ``constraints.names`` has
        body, constraint and unit of each: ``dict(zip(map(str, controller.constraints.names),
        controller.margins(output)))``.
        """
        return self.constraints.margins(output.state)

    @checked_call
    def lyapunov(self, output: ControlOutput, theta: np.ndarray) -> float:
        """V = V1 + ½ e2ᵀ M(q) e2 (30), M from ``theta``; a monitor, not part of the law."""
        kinetic = 0.5 * output.e2 @ self.arm.Y1(output.state.q, output.e2) @ theta
        return barrier(output.e1, output.bound, self._weight) + float(kinetic)

    def warm_up(self, theta: np.ndarray) -> None:
        """Compile all that a motion calls; this controller stays unchanged.

        Args:
            theta: Any estimate, shape (m,).
        """
        start = self.reference.at(0.0).position
        trial = Controller(self.arm, self.settings, self.safety, self.performance,
                           SmoothStart(from_time(self.reference, np.inf), 1.0, start),
                           self._given_law if isinstance(self._given_law, type) else None,
                           self._given_constraints)
        for t in (0.5, 0.501):  # what leads a reference begins with the second sample
            output = trial.update(t, start, np.zeros(self.arm.n), theta)
        trial.lyapunov(output, theta)
        trial.margins(output)
        unwound_term(output.x, output.e2, output.wanted, output.torque)  # behind a safety filter


def _with_safety(settings: ControllerSettings, safety: JointInterval) -> ControllerSettings:
    """Return settings whose safety set is the one in use, where a safety filter is to keep it."""
    if settings.safety_filter == 'none':
        return settings
    return settings.replace(safety={'lower': safety.lower, 'upper': safety.upper})
