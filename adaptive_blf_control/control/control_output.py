# SPDX-License-Identifier: Apache-2.0
"""What one sample of the controller gives."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arrays import record
from adaptive_blf_control.control.constraints import MotionState
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.sets import Bounds
from adaptive_blf_control.errors import with_hints

__all__ = ['ControlOutput']


@record
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
