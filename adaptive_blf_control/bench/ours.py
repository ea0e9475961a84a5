# SPDX-License-Identifier: Apache-2.0
"""Our own law behind the interface of the baselines; its variants are parameters, not code."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.simulation.closed_loop import ClosedLoop
from adaptive_blf_control.simulation.sensors import Measurement

__all__ = ['Ours']


class Ours:
    """Controller and identifier of a closed loop, in the order the loop itself has them.

    Attributes:
        theta: θ̂ the controller uses next, θ* where it is known, shape (m,).
    """

    def __init__(self, loop: ClosedLoop) -> None:
        """Take the parts of a loop; its plant is not touched."""
        self.theta: np.ndarray = loop.initial_estimate
        self._loop = loop
        self._term = np.zeros(loop.arm.m)

    def update(self, t: float, measured: Measurement) -> np.ndarray:
        """Answer a sample; see `Law`."""
        loop = self._loop
        output = loop.controller.update(t, measured.q, measured.qd, self.theta)
        estimate = loop.identifier.update(t, *measured, self._term)
        self._term = output.adaptation_term
        if loop.known is None:
            self.theta = estimate
        return output.torque
