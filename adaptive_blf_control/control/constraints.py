# SPDX-License-Identifier: Apache-2.0
"""What "inside" means: quantities that have to stay strictly between two bounds.

A constraint says what it measures of a motion and between which bounds that has to stay; margins,
their names on topics and in diagnostics, the words about a violation and the check at the start
follow from it here, once. The safety set (7) and the performance set (8) are the first two
(:mod:`adaptive_blf_control.control.set_constraints`); a limit of the velocity is

    class VelocityLimit:
        name, quantity, unit = 'velocity', 'velocity', 'rad/s'
        recovery = 'slow down'

        def __init__(self, arm, settings):
            self.bodies, self._limit = arm.joints, np.full(arm.n, 2.0)

        def bounded(self, state):
            return Bounded(state.qd, -self._limit, self._limit)
"""

from __future__ import annotations

from collections.abc import Sequence
import re
from typing import NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.arrays import record
from adaptive_blf_control.control.sets import Bounds
from adaptive_blf_control.errors import ParameterError, SetViolation
from adaptive_blf_control.parameters.guided import Guided
from adaptive_blf_control.parameters.plugin import to_be_written

__all__ = ['Bounded', 'Constraint', 'Constraints', 'MarginName', 'MotionState', 'Violation']


@record
class MotionState(NamedTuple):
    """What a constraint looks at: one sample; arrays of shape (n,), for a run (N, n).

    Attributes:
        t: Time since the start of the motion [s]; for a run (N,).
        q: Measured positions [rad].
        qd: Measured velocities [rad/s].
        e1: Tracking error (5) [rad]; NaN where there is no reference.
        bounds: Performance bounds in use, (n,) also for a run.
    """

    t: float | np.ndarray
    q: np.ndarray
    qd: np.ndarray
    e1: np.ndarray
    bounds: Bounds


@record
class Bounded(NamedTuple):
    """Quantities with the bounds they have to stay strictly between; ±inf where there is none.

    Attributes:
        value: Shape (k,).
        lower: Shape (k,), or one for all.
        upper: Likewise.
    """

    value: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def margin(self) -> np.ndarray:
        """Return the distance to the nearer bound; negative outside, NaN where not known."""
        value, lower, upper = map(np.asarray, self)
        return np.minimum(value - lower, upper - value)


class Constraint(Protocol):
    """k quantities that have to stay between bounds.

    One with ``whole_runs = True`` is asked about all samples of a run at once, with arrays of
    shape (N, n), and answers with (N, k).

    Attributes:
        name: One word, e.g. ``safety``: names the margins and the set that is left.
        quantity: What is measured, in a word: position, velocity, distance.
        unit: Its unit, e.g. ``rad``.
        recovery: What brings the arm back inside, in a few words.
        bodies: Joint or body of each quantity, length k.
    """

    name: str
    quantity: str
    unit: str
    recovery: str
    bodies: tuple[str, ...]

    @to_be_written
    def bounded(self, state: MotionState) -> Bounded:
        """Return the quantities and their bounds in a sample."""
        ...


class MarginName(NamedTuple):
    """Whose margin it is.

    Attributes:
        body: Joint or body.
        constraint: Name of the constraint.
        unit: Of the margin.
    """

    body: str
    constraint: str
    unit: str = 'rad'

    def __str__(self) -> str:
        """Return the name in a message, ``joint1.safety_margin``; units other than rad follow."""
        unit = '' if self.unit == 'rad' else f' [{self.unit}]'
        return f'{self.body}.{self.constraint}_margin{unit}'

    @property
    def label(self) -> str:
        """The name for a person, e.g. ``joint1 safety margin [rad]``."""
        return f'{self.body} {self.constraint} margin [{self.unit}]'

    @classmethod
    def parse(cls, text: str) -> MarginName | None:
        """Return the name that has this text as its `str`; None for any other text."""
        found = re.fullmatch(r'(.+)\.([^.]+)_margin(?: \[(.*)\])?', text)
        return None if found is None else cls(found[1], found[2], found[3] or 'rad')


class Violation(NamedTuple):
    """A bound that a quantity has reached, or is beyond.

    Attributes:
        name: Body, constraint and unit.
        kind: ``joint`` or ``body``.
        quantity: What was measured.
        value: Measured value.
        lower: Lower bound.
        upper: Upper bound.
        margin: Distance to the nearer bound, ≤ 0 or NaN.
        recovery: What brings the arm back inside.
    """

    name: MarginName
    kind: str
    quantity: str
    value: float
    lower: float
    upper: float
    margin: float
    recovery: str

    def __str__(self) -> str:
        """Say it in words, with the numbers."""
        body, constraint, unit = self.name
        return (f'{self.kind} {body!r} has left its {constraint} set: {self.value:.5g} {unit} is '
                f'not within {self.lower:.5g} .. {self.upper:.5g} {unit} '
                f'(margin {self.margin:.3g} {unit})')

    @property
    def bound(self) -> float:
        """The bound that is violated."""
        return self.upper if self.value >= self.upper else self.lower


class Constraints(Guided, instead={
        **dict.fromkeys(('parts =', 'names ='), 'Controller(..., constraints=[...]) takes them'),
        **dict.fromkeys(('safety', 'performance'), 'the controller has it, with its bounds')}):
    """All constraints of a motion, in the order of their importance.

    Attributes:
        parts: The constraints.
        names: Names of all K margins, in their order.
    """

    def __init__(self, parts: Sequence[Constraint], joints: tuple[str, ...]) -> None:
        """Take the constraints; ParameterError where a name is no word or comes twice."""
        self.parts = tuple(parts)
        self._joints = joints
        words = [part.name for part in self.parts]
        for word in words:
            if not word.isidentifier() or words.count(word) > 1:
                raise ParameterError('constraints', words, f'one word each, all different: not '
                                                           f'{word!r}')
        self.names = tuple(MarginName(body, part.name, part.unit)
                           for part in self.parts for body in part.bodies)

    def __repr__(self) -> str:
        """Name each constraint with its bodies."""
        return '<Constraints: ' + '; '.join(
            f'{part.name}: {part.quantity} [{part.unit}] of {", ".join(part.bodies)}'
            for part in self.parts) + '>'

    def margins(self, state: MotionState) -> np.ndarray:
        """Return the distances to the nearer bounds in a sample, shape (K,).

        A margin is positive inside, and only there.
        """
        return np.concatenate([part.bounded(state).margin() for part in self.parts])

    def margins_along(self, run: MotionState) -> np.ndarray:
        """Return the margins in all N samples of a run, shape (N, K)."""
        return np.concatenate([_along(part, run) for part in self.parts], axis=1)

    def violation(self, state: MotionState) -> Violation | None:
        """Return what is violated at a sample: of the first such constraint the worst body."""
        for part in self.parts:
            bounded = part.bounded(state)
            margins = bounded.margin()
            if (margins > 0.0).all():
                continue
            i = int(np.argmin(margins))  # a NaN comes first
            lower, upper = (float(np.broadcast_to(bound, margins.shape)[i])
                            for bound in (bounded.lower, bounded.upper))
            body = part.bodies[i]
            return Violation(MarginName(body, part.name, part.unit),
                             'joint' if body in self._joints else 'body', part.quantity,
                             float(bounded.value[i]), lower, upper, float(margins[i]),
                             part.recovery)
        return None

    def check_start(self, state: MotionState) -> None:
        """Raise SetViolation where the first state of a motion is not inside."""
        found = self.violation(state)
        if found is not None:
            raise SetViolation(
                found.name.body, found.value, found.bound,
                f'start {found.quantity} outside the {found.name.constraint} set',
                unit=found.name.unit, kind=found.kind, recovery=found.recovery)

    def check(self, state: MotionState) -> None:
        """Raise ParameterError where a constraint does not give one margin for each body."""
        for part in self.parts:
            try:
                bounded = part.bounded(state)
                if not hasattr(bounded, 'margin'):
                    raise ParameterError(f'{type(part).__name__}.bounded', bounded,
                                         'a Bounded of value, lower and upper')
                shape = np.shape(bounded.margin())
            except ParameterError:
                raise
            except Exception as error:  # a plug-in may raise anything
                raise ParameterError('constraints', part.name, f'margins of the state '
                                     f'({type(error).__name__}: {error})') from error
            if shape != (len(part.bodies),):
                raise ParameterError('constraints', part.name, f'a margin for each of '
                                     f'{", ".join(part.bodies)}: their shape is {shape}')


def _along(part: Constraint, run: MotionState) -> np.ndarray:
    if getattr(part, 'whole_runs', False):
        return _of_run(part, run)
    margins = np.empty((len(run.q), len(part.bodies)))
    for k, (t, q, qd, e1) in enumerate(zip(np.asarray(run.t), run.q, run.qd, run.e1)):
        margins[k] = part.bounded(MotionState(float(t), q, qd, e1, run.bounds)).margin()
    return margins


def _of_run(part: Constraint, run: MotionState) -> np.ndarray:
    shape = (len(run.q), len(part.bodies))
    what = (f'margins of a whole run, N = {shape[0]} samples, of shape (N, k) = {shape} with k = '
            f'{shape[1]} bodies, as whole_runs is True')
    try:
        margins = np.asarray(part.bounded(run).margin())
    except Exception as error:  # a plug-in may raise anything
        raise ParameterError('constraints', part.name,
                             f'{what} ({type(error).__name__}: {error})') from error
    if margins.shape != shape:
        raise ParameterError('constraints', part.name, f'{what}: their shape is {margins.shape}')
    return margins
