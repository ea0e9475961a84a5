# SPDX-License-Identifier: Apache-2.0
"""The answer to a sample as a node sends it: arrays that hold until the next sample.

A `ControlOutput` with arrays of its own takes longer to make than (38) takes to compute, and a
node needs one once a second. So a node asks `Controller.answer`, which gives an `Answered`.
"""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from adaptive_blf_control.control.constraints import Constraints
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.reference import ReferencePoint

__all__ = ['Answered', 'AnsweredOutput']


class Answered(Protocol):
    """What is sent of an answer; a caller that keeps an array beyond the next sample copies it.

    Attributes:
        t: Time since the start of the motion that it was answered at [s].
        torque: Commanded torque after the limits, shape (n,) [N·m].
        adaptation_term: See `ControlOutput`, shape (m,).
        e1: Tracking error, shape (n,) [rad].
        e2: Velocity error, shape (n,) [rad/s].
        reference: y_d with derivatives.
    """

    t: float
    torque: np.ndarray
    adaptation_term: np.ndarray
    e1: np.ndarray
    e2: np.ndarray
    reference: ReferencePoint

    @property
    def margins(self) -> np.ndarray:
        """Those of all constraints, shape (K,)."""
        ...

    @property
    def smallest(self) -> float:
        """The smallest of the margins; NaN where one is."""
        ...

    @property
    def output(self) -> ControlOutput:
        """All that belongs to the answer, in arrays of its own."""
        ...


class AnsweredOutput:
    """An answer that was made as a `ControlOutput`, an `Answered`."""

    def __init__(self, output: ControlOutput, constraints: Constraints) -> None:
        """Take the output, and the constraints, which are asked where the margins are."""
        self.output, self.t = output, float(output.state.t)
        self.torque, self.adaptation_term = output.torque, output.adaptation_term
        self.e1, self.e2, self.reference = output.e1, output.e2, output.reference
        self._constraints = constraints

    @cached_property
    def margins(self) -> np.ndarray:
        """Those of all constraints, shape (K,)."""
        return self._constraints.margins(self.output.state)

    @property
    def smallest(self) -> float:
        """The smallest of the margins; NaN where one is."""
        return float(self.margins.min())
