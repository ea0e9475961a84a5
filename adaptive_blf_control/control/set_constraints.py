# SPDX-License-Identifier: Apache-2.0
"""The safety set (7) and the performance set (8) as constraints, and those a parameter names."""

from __future__ import annotations

from collections.abc import Sequence

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.constraints import Bounded, Constraint, MotionState
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.parameters.plugin import load_plugin, made

__all__ = ['OwnConstraint', 'OwnConstraints', 'PerformanceConstraint', 'SafetyConstraint',
           'made_constraint', 'several_constraints']

OwnConstraint = Constraint | type[Constraint] | str
OwnConstraints = OwnConstraint | Sequence[OwnConstraint]
"""What a caller gives beside the two sets: one, or several of them."""

_ATTRIBUTES = ('name', 'quantity', 'unit', 'recovery', 'bodies', 'bounded')


class SafetyConstraint:
    """q inside the safety set (7)."""

    name, quantity, unit = 'safety', 'position', 'rad'
    whole_runs = True
    recovery = ('move the arm back by hand (start= of a Controller and initial_position= of '
                'simulate say where it begins), or widen controller.safety')

    def __init__(self, joints: tuple[str, ...], interval: JointInterval) -> None:
        """Take the names of the joints and the set."""
        self.bodies = joints
        self._interval = interval

    def __repr__(self) -> str:
        """Show the bounds of each joint."""
        ends = zip(self.bodies, self._interval.lower, self._interval.upper)
        return '<SafetyConstraint: ' + ', '.join(
            f'{joint} {lower:.5g} to {upper:.5g} rad' for joint, lower, upper in ends) + '>'

    def bounded(self, state: MotionState) -> Bounded:
        """Return the positions with the bounds of the set."""
        return Bounded(state.q, self._interval.lower, self._interval.upper)


class PerformanceConstraint:
    """e1 inside the performance set (8), as wide as it is at that time."""

    name, quantity, unit = 'performance', 'error', 'rad'
    whole_runs = True
    recovery = ('begin the motion where the arm is (start= of a Controller, or its begin(q, qd)) '
                'with a smooth start (reference.smooth_start > 0 s), which joins the reference '
                'from there, or on the reference (initial_position of a simulated arm)')

    def __init__(self, joints: tuple[str, ...]) -> None:
        """Take the names of the joints."""
        self.bodies = joints

    def __repr__(self) -> str:
        """Name the joints."""
        return f'<PerformanceConstraint: errors of {", ".join(self.bodies)}>'

    def bounded(self, state: MotionState) -> Bounded:
        """Return the errors with the bounds in use."""
        return Bounded(state.e1, state.bounds.lower, state.bounds.upper)


def several_constraints(given: OwnConstraints) -> tuple[OwnConstraint, ...]:
    """Return what a caller gave as a tuple; one constraint is a tuple of one."""
    return tuple(given) if isinstance(given, (list, tuple)) else (given,)  # type: ignore


def made_constraint(arm: Arm, settings: ControllerSettings, given: OwnConstraint) -> Constraint:
    """Return a constraint as it is, or what a class or ``module:name`` makes of both arguments.

    Raises:
        ParameterError: it cannot be imported or made, or lacks what a `Constraint` has.
    """
    name = 'controller.constraints' if isinstance(given, str) else 'constraints'
    part = load_plugin(name, given) if isinstance(given, str) else given
    constraint: Constraint = made(name, given, part, _ATTRIBUTES, arm, settings,
                                  base='Constraint')
    return constraint
