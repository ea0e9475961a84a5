# SPDX-License-Identifier: Apache-2.0
"""The adaptive controller: measured state and θ̂ in, torque and adaptation term out."""

from __future__ import annotations

from collections.abc import Mapping
import copy
from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm, checked_arm
from adaptive_blf_control.arrays import (
    are_vectors,
    checked_array,
    checked_number,
    checked_vectors,
)
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.control.answered import Answered, AnsweredOutput
from adaptive_blf_control.control.arm_limits import limit_warnings
from adaptive_blf_control.control.bounded_motion import BoundedMotion
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.controller_hints import INSTEAD
from adaptive_blf_control.control.given_parts import (
    given_part,
    given_settings,
    Group,
    is_group,
    reference_in_arrays,
)
from adaptive_blf_control.control.law import unwound_term
from adaptive_blf_control.control.laws.protocol import Law, LawSample
from adaptive_blf_control.control.limited_law import LimitedLaw
from adaptive_blf_control.control.motion_sets import check_change, checked_sets, MotionSets
from adaptive_blf_control.control.odd_times import OddTimes
from adaptive_blf_control.control.parts import controller_parts
from adaptive_blf_control.control.reference import (
    Crossfade,
    from_time,
    Reference,
    ReferencePoint,
    SmoothStart,
)
from adaptive_blf_control.control.safety_filter import SafetyFilter
from adaptive_blf_control.control.set_constraints import OwnConstraints, several_constraints
from adaptive_blf_control.control.sets import Bounds, JointInterval
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.control.step import ControllerArrays, Memory, new_memory
from adaptive_blf_control.control.tuned_parts import (
    GivenParts,
    tuned_parts,
    TunedParts,
    with_safety,
)
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.time_units import SLOWEST

__all__ = ['Controller', 'ControlOutput']


class Controller(BoundedMotion, settings=ControllerSettings, instead=INSTEAD):
    """Equation (38) (or (34), when θ* is passed as θ̂) inside the sets (7) and (8).

    ``safety_filter='limits'`` and ``limits={...}`` keep limits of joints and velocities and a
    distance to obstacles, for every θ of a set: a safety filter behind the law, docs/limits.md.

    Holds the torque commanded last, so one object belongs to one motion at a time; :meth:`begin`
    begins another one.

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
        super().__init__(checked_arm('arm', arm))
        groups = {'safety': safety, 'performance': performance, 'reference': reference}
        changes.update((name, value) for name, value in groups.items() if is_group(name, value))
        if isinstance(law, str):
            changes['law'] = law
        settings = given_settings(settings, changes)
        parts: dict[str, Any] = controller_parts(settings, arm.joints)._asdict()
        for name, value in groups.items():
            if value is not None and name not in changes:
                parts[name] = given_part(name, value)
        follow = self._wanted = reference_in_arrays(parts['reference'], arm.joints)
        if start is not None:
            start = checked_array('start', start, (arm.n,), arm.joints)
            if settings.reference.smooth_start > 0.0:
                follow = SmoothStart(follow, settings.reference.smooth_start, start)
        self._given = GivenParts(None if isinstance(law, str) else law,
                                 several_constraints(constraints))
        self._not_measured = np.full(arm.n, np.nan)
        self._m = (arm.m,)
        self._memory = new_memory(arm.n)
        self._odd_times = OddTimes()
        self._smooth_start = follow if isinstance(follow, SmoothStart) else None
        self._take(tuned_parts(arm, with_safety(settings, parts['safety']), self._given),
                   checked_sets(0.0, parts['safety'], parts['performance'], follow,
                                self._smooth_start, arm.joints))
        self.constraints.check(self.state(0.0, follow.at(0.0).position, np.zeros(arm.n)))
        if start is not None:
            self.check_start(start, velocity)

    def __repr__(self) -> str:
        """Name the arm and its sets."""
        notes = len(self.notes)
        return (f'<Controller of {self.arm!r}: safety {self.safety.lower.tolist()} to '
                f'{self.safety.upper.tolist()} rad'
                + (f', see its {notes} notes>' if notes > 1 else ', see its note>' if notes else
                   '>'))

    def __copy__(self) -> Controller:
        """Return a controller that goes on from here and leaves this one unchanged."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other._memory = Memory(*(array.copy() for array in self._memory))
        own = copy.copy(self.safety_filter)
        other._tuned = self._tuned._replace(safety_filter=own)
        vars(other)['safety_filter'] = own
        other._answers = LimitedLaw(self.arm, other._tuned, other._memory, self.safety)
        other._judged, other._odd_times = None, copy.copy(self._odd_times)
        return other

    def _take(self, tuned: TunedParts, sets: MotionSets) -> None:
        self._use(tuned, sets)
        self._answers = LimitedLaw(self.arm, tuned, self._memory, sets.safety)

    @property
    def notes(self) -> tuple[str, ...]:
        """Where settings exceed the arm's limits or name limits nobody keeps; odd times."""
        return (*limit_warnings(self.arm, self.settings), *self._odd_times.notes())

    @property
    def law(self) -> Law:
        """The law in use."""
        return self._tuned.law

    @property
    def arrays(self) -> ControllerArrays | None:
        """The controller as `controller_step` takes it; None where it has to be asked itself.

        It is None for another law than (38), an arm without arrays, or with a safety filter.
        """
        return self._answers.arrays if self.safety_filter is None else None

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
                groups[name] = reference_in_arrays(part, joints) if name == 'reference' else part
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
        present = MotionSets(self.safety, self.performance, self.reference, self._bounds)
        tuned = self._tuned
        if settings is not None or (safety is not None and self.safety_filter is not None):
            taken = self.settings if settings is None else ControllerSettings.taken(settings, {})
            tuned = tuned_parts(self.arm, with_safety(taken, safety or self.safety), self._given,
                                tuned)
        if not moved:
            self._take(tuned, present)
            return
        follow = from_time(self.reference, t)
        if reference is not None and blend_time != 0.0:
            follow = Crossfade(follow, from_time(reference, t), t, blend_time)
        elif reference is not None:
            follow = from_time(reference, t)
        sets = checked_sets(t, safety or self.safety, performance or self.performance, follow,
                            self._smooth_start, joints)
        check_change(present, sets, t, q, joints,
                     asked=performance is not None or reference is not None)
        self._take(tuned, sets)
        self._wanted = self._wanted if reference is None else reference

    @checked_call
    def begin(self, q: Any, qd: Any = None) -> None:
        """Begin another motion with the present settings, sets and reference.

        The time of its first sample is 0, its torque rises from zero, its reference is followed
        from the beginning. A law that was given as an object keeps what it has learned. With a
        safety filter this may take 0.1 s: it is not for an arm that moves.

        Args:
            q: Posture that the motion begins in, as ``start`` when it is made, shape (n,) [rad].
            qd: Velocity that it begins with, shape (n,) [rad/s]; at rest where None.

        Raises:
            SetViolation: the arm is outside a set; the motion so far can go on.
            ParameterError: an array has another shape.
        """
        vars(self).update(vars(Controller(
            self.arm, self.settings, self.safety, self.performance, self._wanted, self._given.law,
            self._given.constraints, start=q, velocity=qd)))

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
            with q, q̇ or θ̂ not finite the torque goes to zero as fast as ``torque_rate_limit``
            lets it, and stays where it was with a t that repeats, goes back or is not finite.
            Where t went back, or on by more than 0.5 s, ``notes`` says so: another motion is
            begun by :meth:`begin`.
            Outside a set nothing is guaranteed, and the torque leads back as far as its limit
            lets it; :meth:`margins` is then negative.

        Raises:
            ParameterError: an array has another shape, or the first t is one since 1970.
        """
        t, torque = checked_number('t', t), self._not_measured if torque is None else torque
        if not are_vectors(self._n, q, qd, torque):
            q, qd, torque = checked_vectors(self.arm.joints, q=q, qd=qd, torque=torque)
        theta = checked_array('theta', theta, self._m, self.arm.parameters)
        answered = self._judged = self.answer(t, q, qd, theta, torque)
        self._odd_times.warn()
        return answered.output

    def answer(self, t: float, q: np.ndarray, qd: np.ndarray, theta: np.ndarray,
               torque: np.ndarray) -> Answered:
        """Answer a sample as :meth:`update` does, with arrays that the next sample may change.

        For a node, whose arrays are known to be right: nothing is checked.

        Args:
            t: Time of the sample [s].
            q: Measured positions, shape (n,) [rad]; contiguous float64, as the other arrays.
            qd: Measured velocities, shape (n,) [rad/s].
            theta: Parameter estimate θ̂, shape (m,).
            torque: Mean torque applied since the sample before, shape (n,) [N·m]; NaN where it
                is not known.
        """
        if not 0.0 <= t - self._memory.time.item() <= SLOWEST:  # nor at the first, after NaN
            t = self._odd_times.answered(t, self._memory.time)
        if self.safety_filter is not None:
            point, bounds = self._governed(self.safety_filter, t, q)
            return AnsweredOutput(self._answers.filtered(self.safety_filter, LawSample(
                t, q, qd, torque, point, bounds, theta)), self.constraints)
        usual = self._answers.usual(t, self.reference, self._bounds)
        answered = (self._answers.answered(LawSample(
            t, q, qd, torque, self.reference.at(t), self._bounds.at(t), theta))
            if usual is None else usual.answered(t, q, qd, theta))
        if isinstance(answered, ControlOutput):
            return AnsweredOutput(answered, self.constraints)
        return (answered if self._sets_alone
                else AnsweredOutput(answered.output, self.constraints))

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

    def warm_up(self, theta: np.ndarray) -> None:
        """Compile all that a motion calls; this controller stays unchanged.

        Args:
            theta: Any estimate, shape (m,).
        """
        start, given = self.reference.at(0.0).position, self._given
        trial = Controller(self.arm, self.settings, self.safety, self.performance,
                           SmoothStart(from_time(self.reference, np.inf), 1.0, start),
                           given.law if isinstance(given.law, type) else None,
                           given.constraints)
        # What leads a reference begins with the second sample, the usual samples with the last.
        for t in (0.5, 0.501, 1.0):
            output = trial.update(t, start, np.zeros(self.arm.n), theta)
        trial.lyapunov(output, theta)
        trial.margins(output)
        unwound_term(output.x, output.e2, output.wanted, output.torque)  # behind a safety filter
