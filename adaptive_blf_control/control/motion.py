# SPDX-License-Identifier: Apache-2.0
"""A motion: when it begins, goes on, is lost and resumed, and what it follows meanwhile.

Stamps and arrays come in, torques and reasons go out; clocks, topics and who may move the arm are
left to the caller.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.answered import Answered
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.parts import controller_parts
from adaptive_blf_control.control.reference import from_time, Reference
from adaptive_blf_control.control.refusal import Refusal
from adaptive_blf_control.control.safety_filter import narrow
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.control.start import (
    holding_controller,
    joined_controller,
)
from adaptive_blf_control.control.state_gate import StateGate
from adaptive_blf_control.errors import BlfError

__all__ = ['Motion', 'Plan', 'groups_of']

# Parameters of the start alone: a change of them concerns the next motion.
_OF_THE_START = ('reference.smooth_start', 'reference.resume_time')


def groups_of(changed: Iterable[str]) -> set[str]:
    """Return the first words of the changed parameters that concern a motion under way."""
    return {name.split('.')[0] for name in changed if name not in _OF_THE_START}


class Plan(NamedTuple):
    """What a way through given points was computed for.

    Attributes:
        controller: Of the motion.
        reference: What was followed then.
        safety: Safety set then.
        performance: Performance set then.
        t: When the way begins [s], in the time of the reference.
    """

    controller: Controller
    reference: Reference
    safety: JointInterval
    performance: JointInterval
    t: float


class Motion:
    """Motions of one arm, one after the other, each with a `Controller` of its own.

    Attributes:
        arm: The arm.
        settings: Gains, limits, sets and reference.
        controller: That of the motion; None between motions.
        answered: Last answer, None before the first.
        lost: Why the torque is zero until the next state, '' where it is not.
        gate: Order of the joint states.
        q: Positions measured last, shape (n,) [rad].
        qd: Velocities measured last, shape (n,) [rad/s].
        torque: Commanded last, shape (n,) [N·m], until the next answer; zero where the arm is left
            to itself.
        planned: Whether given points are followed instead of the reference of the settings.
    """

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Take the arm and the settings; nothing moves yet."""
        self.arm, self.settings = arm, settings
        self.controller: Controller | None = None
        self.answered: Answered | None = None
        self.lost = ''
        self.gate = StateGate(arm.joints)
        self.q, self.qd = np.zeros(arm.n), np.zeros(arm.n)
        self.torque = np.zeros(arm.n)
        self.planned = False
        self._resumes = False
        self._start_ns = 0
        self._not_measured = np.full(arm.n, np.nan)

    @property
    def t(self) -> float:
        """Time of the last sample since the start of the motion [s]."""
        return 0.0 if self.gate.last_ns is None else (self.gate.last_ns - self._start_ns) * 1e-9

    @property
    def output(self) -> ControlOutput | None:
        """All that belongs to the last answer, None before the first."""
        return None if self.answered is None else self.answered.output

    def refuse(self, stamp: int, q: np.ndarray, qd: np.ndarray,
               longest: float) -> Refusal | None:
        """Return why a state cannot be answered, None where it can.

        Once the states count as lost, whatever comes next begins a new motion on its own clock.
        So does a clock that has jumped ahead and stays there.

        Args:
            stamp: Of the state [ns].
            q: Measured positions, shape (n,) [rad].
            qd: Measured velocities, shape (n,) [rad/s].
            longest: Time between two states that is not too long [s].
        """
        gate = self.gate
        refusal = gate.not_finite(q, qd)
        if refusal is None and self.lost:
            refusal = gate.repeated(stamp)
        elif refusal is None and self.controller is not None:
            refusal = gate.out_of_order(stamp, longest)
            if refusal is None and gate.jumped(stamp, longest):
                self.end()
        return refusal

    def see(self, seen: Mapping[Hashable, Any], gone: frozenset[Hashable] | None) -> None:
        """Tell the safety filter which obstacles move, see `MovingObstacles.update`.

        Between motions nobody needs them, and their publisher goes on sending them.
        """
        see = getattr(getattr(self.controller, 'safety_filter', None), 'see', None)
        if see is not None:
            see(seen, gone)

    def narrow(self, bounds: Any) -> None:
        """Tell the safety filter what is known of the arm for sure, see `CauseBounds`.

        Raises:
            ParameterError: it cannot use them, and goes on with its prior.
        """
        if self.controller is not None:
            narrow(self.controller.safety_filter, bounds)

    def rest(self, q: np.ndarray, qd: np.ndarray) -> None:
        """Note a state, (n,) [rad] and [rad/s], that nobody answers."""
        self.q, self.qd = q, qd

    def check_start(self) -> None:
        """Check that a motion may begin where the arm is; SetViolation with the numbers."""
        joined_controller(self.settings, self.arm, self.q, self.qd, self._resumes)

    def prepare(self) -> None:
        """Let the next state begin a motion, joined to the reference of the settings."""
        self.controller, self.planned = None, False
        self.torque = np.zeros(self.arm.n)

    def begin(self, stamp: int, q: np.ndarray, qd: np.ndarray) -> Controller:
        """Begin a motion with the state of ``stamp`` [ns], (n,) [rad] and [rad/s].

        Where points were being followed, ``q`` is held until the planner speaks again: nobody
        asked for the way back to the reference of the parameters.

        Raises:
            SetViolation: the start is not inside.
        """
        if self.planned:
            controller = holding_controller(self.settings, self.arm, q, qd)
        else:
            controller = joined_controller(self.settings, self.arm, q, qd, self._resumes)
        controller.carry_on(self.torque)
        self.controller, self._start_ns = controller, stamp
        return controller

    def answer(self, stamp: int, q: np.ndarray, qd: np.ndarray, theta: np.ndarray,
               torque: np.ndarray | None = None, elapsed: float | None = None) -> Answered:
        """Answer a state of the motion, with arrays that the next answer may change.

        Args:
            stamp: Of the state [ns].
            q: Measured positions, shape (n,) [rad]; contiguous float64, as the other arrays.
            qd: Measured velocities, shape (n,) [rad/s].
            theta: Parameter estimate θ̂, shape (m,).
            torque: Measured torque, shape (n,) [N·m]; None where there is none.
            elapsed: Real time since the answer before [s]; None where only stamps count.
        """
        if self.controller is None:
            raise BlfError('no motion has begun')
        self.gate.take(stamp)
        self.q, self.qd, self.lost = q, qd, ''
        t = self.t
        if elapsed is not None:
            self.controller.shorten_interval(t, elapsed)
        answered = self.answered = self.controller.answer(
            t, q, qd, theta, self._not_measured if torque is None else torque)
        self.torque = answered.torque
        return answered

    def lose(self, reason: str) -> None:
        """Note that the torque is zero now; the next state begins another motion."""
        self.lost, self.torque = reason, np.zeros(self.arm.n)

    @property
    def begins_quickly(self) -> bool:
        """Whether there is a motion that can begin again between two samples.

        A safety filter takes 10 ms and more to make, in which the arm is left alone.
        """
        return self.controller is not None and self.controller.safety_filter is None

    def start_over(self) -> None:
        """Let the next state begin this motion again: its torques have not reached the arm."""
        self.controller = None

    def end(self) -> None:
        """End the motion; the next one is joined to the reference, wherever it begins."""
        self.controller, self._resumes = None, True

    def retune(self, settings: ControllerSettings, changed: set[str]) -> Controller:
        """Take other settings between two samples, all of them or, with an error, none.

        Args:
            settings: The new ones.
            changed: Names of the parameters that differ.

        Returns:
            The controller of the motion, else that of a trial.

        Raises:
            SetViolation: a set does not hold the present state, or one exceeds the other.
            ParameterError: a value cannot be used.
        """
        controller = self.controller
        groups = groups_of(changed)
        if controller is None or self.gate.last_ns is None:
            controller = Controller(self.arm, settings)
        else:
            parts = controller_parts(settings, self.arm.joints)
            controller.retune(
                self.t, self.q, settings=parts.settings,
                safety=parts.safety if 'safety' in groups else None,
                performance=parts.performance if 'performance' in groups else None,
                reference=parts.reference if 'reference' in groups else None,
                blend_time=settings.reference.resume_time)
            self.planned = self.planned and 'reference' not in groups
        self.settings = settings
        return controller

    def plan(self, head_start: float) -> Plan | None:
        """Return what a way that begins in ``head_start`` [s] starts from; None without motion."""
        controller = self.controller
        if controller is None or self.gate.last_ns is None or self.lost:
            return None
        return Plan(controller, controller.reference, controller.safety, controller.performance,
                    controller.path_time(self.t) + head_start)

    def follow(self, plan: Plan, way: Reference) -> bool:
        """Follow a way computed for ``plan``; False where the moment of its start has passed.

        Raises:
            BlfError: the motion, its reference or its sets have changed since.
        """
        present = self.plan(0.0)
        if present is None or any(now is not then for now, then in zip(present[:4], plan[:4])):
            raise BlfError('the motion has changed meanwhile: send it again')
        now = plan.controller.path_time(self.t)
        if now >= plan.t:
            return False
        plan.controller.follow(from_time(way, now))
        self.planned = True
        return True
