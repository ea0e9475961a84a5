# SPDX-License-Identifier: Apache-2.0
"""What an identifier's recorded pairs say for sure about θ*: the sets beside θ̂."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.limits.cause_intervals import CauseBounds, CauseIntervals
from adaptive_blf_control.limits.parameter_set import ParameterSet
from adaptive_blf_control.limits.prior import Prior

__all__ = ['SetEstimator']


class SetEstimator:
    """Looks at the recorded pairs now and then: they narrow an ellipsoid and intervals.

    Both hold θ* for as long as it is constant. So they are the prior again while the identifier
    doubts that, and stay it until the pairs of before are forgotten where these are of no use:
    those of an arm with a load have been moved by an estimate of the load, and pairs that
    contradict the prior once may hide that they do.

    Attributes:
        ellipsoid: Of θ.
        intervals: Of what θ depends on.
        falsified: How often pairs contradicted the prior or the bound of the unexplained torque.
    """

    def __init__(self, prior: Prior, unexplained: np.ndarray, period: float) -> None:
        """Start with the prior.

        Args:
            prior: What is known of θ* before any motion.
            unexplained: Bound of what the model cannot explain of each joint's filtered torque,
                shape (n,) [N·m].
            period: From one look to the next [s].

        Raises:
            ParameterError: a bound is not > 0.
        """
        self.ellipsoid = ParameterSet(prior, unexplained)
        self.intervals = CauseIntervals(prior, unexplained)
        self.falsified = 0
        self._period = period
        self._due = -np.inf
        self._revision = -1
        self._insertions = self._others = 0
        self._found: dict[str, int] = {}
        self._useless = False

    def bounds(self) -> CauseBounds:
        """Return the intervals in the units of the causes."""
        return self.intervals.bounds()

    def observe(self, t: float, identifier: Any) -> bool:
        """Look at the pairs of an `Identifier` after its sample of time ``t`` [s].

        Returns:
            Whether it was time to.
        """
        if self._due - self._period <= t < self._due:
            return False
        self._due = t + self._period
        stack = identifier.stack
        if self._forgotten(stack.insertions, stack.revision) or self._doubts(identifier):
            self._reset()
        elif stack.revision != self._revision and not self._useless:
            self._revision = stack.revision
            self._take(stack.regressors[:stack.count], stack.torques[:stack.count])
        return True

    def _take(self, regressors: np.ndarray, torques: np.ndarray) -> None:
        agrees = (self.ellipsoid.update(regressors, torques),
                  self.intervals.update(regressors, torques))
        if not all(agrees):
            self.falsified += 1
            self._useless = True
            self._reset()

    def _reset(self) -> None:
        self.ellipsoid.reset()
        self.intervals.reset()
        self._revision = -1

    def _forgotten(self, insertions: int, revision: int) -> bool:
        """Return whether pairs were taken out since the last look, all of them or some.

        Both numbers count each pair that comes in; the second one all other changes as well, and
        the first one begins again where all pairs are forgotten.
        """
        others, before = revision - insertions, self._others
        self._useless = self._useless and insertions >= self._insertions
        self._insertions, self._others = insertions, others
        return others != before

    def _doubts(self, identifier: Any) -> bool:
        """Return whether the pairs are not to be believed now.

        The identifier found a contradiction since the last look, looks for its reason, or puts
        artificial noise into them (Remark 3), of which no bound is known.
        """
        before = self._found
        found = self._found = dict(getattr(identifier, 'found', {}))
        if found.get('loads', 0) > before.get('loads', 0):
            self._useless = True
        return bool((before and found != before)
                    or getattr(identifier, 'response', 'quiet') != 'quiet'
                    or getattr(identifier, 'artificial_noise', False))
