# SPDX-License-Identifier: Apache-2.0
"""Forces on the links of an arm by name."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.simulation.targets import row_of_wrench, Target

__all__ = ['Wrenches']


class Wrenches:
    """Force and moment at the origin of each link that is pushed, axes of the base.

    Attributes:
        by_link: (f, m) of shape (6,) [N, N·m] by the link's name; only those that are not zero.
    """

    def __init__(self) -> None:
        """Start without any."""
        self.by_link: dict[str, np.ndarray] = {}

    def set(self, target: Target, value: float) -> None:
        """Set one component, ``force.LINK.x`` [N] or ``torque.LINK.x`` [N·m]."""
        wrench = self.by_link.setdefault(target.name, np.zeros(6))
        wrench[row_of_wrench(target)] = value
        if not wrench.any():
            del self.by_link[target.name]
