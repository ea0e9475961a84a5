# SPDX-License-Identifier: Apache-2.0
"""A motion as its constraints see it: the sets in use, the reference inside them, margins, V."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.control.answered import Answered
from adaptive_blf_control.control.barrier import barrier
from adaptive_blf_control.control.constraints import Constraints, MotionState
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.motion_sets import MotionSets
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.control.safety_filter import SafetyFilter
from adaptive_blf_control.control.set_constraints import (
    PerformanceConstraint,
    SafetyConstraint,
)
from adaptive_blf_control.control.sets import Bounds, JointInterval
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.control.tuned_parts import TunedParts
from adaptive_blf_control.parameters.guided import Guided

__all__ = ['BoundedMotion']


class BoundedMotion(Guided, instead={
        **dict.fromkeys(('output', 'torque', 'e1', 'e2', 'error'),
                        'update returns it: output.torque, output.e1, output.e2'),
        **dict.fromkeys(('margin_names', 'margins_names', 'names', 'constraint_names'),
                        'constraints.names has them, in the order of margins(output)')}):
    """What is read of a motion, nothing of which changes it; `Controller` has the attributes."""

    arm: Arm
    settings: ControllerSettings
    safety: JointInterval
    performance: JointInterval
    reference: Reference
    constraints: Constraints
    safety_filter: SafetyFilter | None

    def __init__(self, arm: Arm) -> None:
        """Begin without sets; `_use` takes them."""
        self.arm = arm
        self._n = (arm.n,)
        self._path_time = 0.0
        self._judged: Answered | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return what a deep copy or a pickle takes: all but the last answer and its margins."""
        return {**self.__dict__, '_judged': None}

    def _use(self, tuned: TunedParts, sets: MotionSets) -> None:
        """Take what follows from the settings, and the sets that were checked with it."""
        self._tuned, self._bounds, joints = tuned, sets.bounds, self.arm.joints
        constraints = Constraints([SafetyConstraint(joints, sets.safety),
                                   PerformanceConstraint(joints),
                                   *getattr(tuned.safety_filter, 'constraints', ()),
                                   *tuned.constraints], joints)
        self._judged = None  # the last answer, with its margins to the sets of then
        self._sets_alone = len(constraints.parts) == 2
        # Not as attributes are set: there these names are refused, see `Guided`.
        vars(self).update(settings=tuned.settings, safety=sets.safety,
                          performance=sets.performance, reference=sets.reference,
                          constraints=constraints, safety_filter=tuned.safety_filter)

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

    def bounds(self, t: float) -> Bounds:
        """Return the performance bounds in use at ``t`` [s], with their rates."""
        return self._bounds.at(t)

    def bounds_along(self, times: np.ndarray) -> Bounds:
        """Return the bounds in use at N times, (N,) [s]; the arrays have shape (N, n)."""
        return self._bounds.along(times)

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

    @checked_call
    def margins(self, output: ControlOutput) -> np.ndarray:
        """Return the margins of all constraints at a sample, shape (K,).

        A margin is the distance to the nearer bound, negative outside. ``constraints.names`` has
        body, constraint and unit of each: ``dict(zip(map(str, controller.constraints.names),
        controller.margins(output)))``.
        """
        judged = self._judged
        if judged is not None and output is judged.output:
            return judged.margins.copy()
        return self.constraints.margins(output.state)

    @checked_call
    def lyapunov(self, output: ControlOutput, theta: np.ndarray) -> float:
        """V = V1 + ½ e2ᵀ M(q) e2 (30), M from ``theta``; a monitor, not part of the law."""
        kinetic = 0.5 * output.e2 @ self.arm.Y1(output.state.q, output.e2) @ theta
        return barrier(output.e1, output.bound, self._tuned.barrier_weight) + float(kinetic)
