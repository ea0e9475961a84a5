# SPDX-License-Identifier: Apache-2.0
"""Whether gravity as told fits the beginning of a motion: logged and in the diagnostics."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.gravity_check import gravity_check_of
from adaptive_blf_control.runtime.fault_log import FaultLog

__all__ = ['GravityWatch']


class GravityWatch:
    """Looks at the states of a controller in the first moments of each motion.

    Attributes:
        found: What was found in this motion, in one sentence; '' while gravity fits.
    """

    def __init__(self, arm: Arm, faults: FaultLog) -> None:
        """Take the arm as the controller knows it."""
        self.found = ''
        self._check, self._faults, self._begin = gravity_check_of(arm), faults, 0

    def begin(self, stamp: int) -> None:
        """Begin with a motion whose first state has the stamp ``stamp`` [ns]."""
        self.found, self._begin = '', stamp
        if self._check is not None:
            self._check.restart()

    def fits(self, stamp: int, q: np.ndarray, qd: np.ndarray, torque: np.ndarray) -> bool:
        """Look at a state; return whether nothing in this motion speaks against gravity as told.

        Args:
            stamp: Of the state [ns].
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            torque: Measured torques, shape (n,) [N·m].
        """
        check = self._check
        if check is None or not check.watching:
            return not self.found
        check.take((stamp - self._begin) * 1e-9, q, qd, torque)
        if check.misfit is not None:
            self.found = check.misfit.text()
            self._faults.report('gravity does not fit', self.found)
        return not self.found
