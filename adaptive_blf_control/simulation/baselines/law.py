# SPDX-License-Identifier: Apache-2.0
"""What a law is to the comparison: a measured state in, a torque out."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from adaptive_blf_control.simulation.sensors import Measurement

__all__ = ['Law']


class Law(Protocol):
    """A controller with all it needs to learn along."""

    @property
    def theta(self) -> np.ndarray | None:
        """θ̂ it uses next, shape (m,); None for a law without a model."""
        ...

    def update(self, t: float, measured: Measurement) -> np.ndarray:
        """Answer the sample taken at ``t`` [s] with a torque, shape (n,) [N·m]."""
        ...
