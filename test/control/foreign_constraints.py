# SPDX-License-Identifier: Apache-2.0
"""Constraints that share no code with ours: a limit of the velocity, and a table."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control import Bounded


class VelocityLimit:
    """|q̇| < 2 rad/s for every joint."""

    name, quantity, unit = 'velocity', 'velocity', 'rad/s'
    recovery = 'slow the reference down'
    limit = 2.0

    def __init__(self, arm, settings) -> None:
        self.bodies = arm.joints

    def bounded(self, state):
        return Bounded(state.qd, -self.limit, self.limit)


class Table:
    """The tip of a two-link arm with links of 1 m stays above a table 3 m below its base."""

    name, quantity, unit = 'table', 'distance', 'm'
    recovery = 'lift the tip'
    bodies = ('tip',)

    def __init__(self, arm, settings) -> None:
        pass

    def bounded(self, state):
        first, second = state.q  # fails for a whole run
        height = np.sin(first) + np.sin(first + second)
        return Bounded(np.array([3.0 + height]), 0.0, np.inf)
