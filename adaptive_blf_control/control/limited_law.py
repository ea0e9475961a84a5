# SPDX-License-Identifier: Apache-2.0
"""A law within the limits of torque and its rate, with a safety filter behind it."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.regressors import arrays_of
from adaptive_blf_control.control.constraints import MotionState
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.law import limited_answer, unwound_term
from adaptive_blf_control.control.laws.ablf import AblfLaw
from adaptive_blf_control.control.laws.protocol import LawSample
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.control.safety_filter import FilterSample, SafetyFilter
from adaptive_blf_control.control.sets import GrowingBounds, JointInterval
from adaptive_blf_control.control.step import (
    ControllerArrays,
    FIRST_INTERVAL,
    Memory,
)
from adaptive_blf_control.control.tuned_parts import TunedParts
from adaptive_blf_control.control.usual_sample import (
    PreparedSamples,
    sinusoids_at,
    UsualSamples,
)

__all__ = ['LimitedLaw']


class LimitedLaw:
    """What answers the samples of a motion, from one change of the settings to the next.

    (38) for an arm with arrays is a compiled function; any other law is asked in Python.

    Attributes:
        arrays: What the compiled function takes; None where the law is asked.
    """

    def __init__(self, arm: Arm, tuned: TunedParts, memory: Memory,
                 safety: JointInterval) -> None:
        """Take a law and its limits.

        Args:
            arm: The arm.
            tuned: The law, the limits of the torque and of its rate.
            memory: Of the motion; changed in place with every sample.
            safety: Safety set.
        """
        self._law, self._limit = tuned.law, tuned.torque_limit
        self._rate_limit, self._memory = tuned.torque_rate_limit, memory
        self._no_regressor = np.zeros((arm.n, arm.m))
        arrays = arrays_of(arm)
        self.arrays = None if arrays is None or type(self._law) is not AblfLaw else (
            ControllerArrays(arrays, self._law.gains, self._limit, self._rate_limit, memory))
        self._safety = safety
        self._prepared: PreparedSamples | None = None  # made with the first sample
        self._usual: UsualSamples | None = None  # likewise
        self._usual_reference: Reference | None = None  # what it was made for, and since when
        self._usual_from = np.inf  # s

    def __getstate__(self) -> dict[str, Any]:
        """Return what a deep copy or a pickle takes: all but the handles, which it makes again."""
        return {**self.__dict__, '_prepared': None, '_usual': None, '_usual_reference': None}

    def usual(self, t: float, reference: Reference,
              bounds: GrowingBounds) -> UsualSamples | None:
        """Return what answers a sample at ``t`` [s] in one call; None where it takes several.

        The bounds are the same in each call.
        """
        if reference is self._usual_reference and t >= self._usual_from:
            return self._usual  # what was at rest stays so
        resting = bounds.resting(t)
        if resting is None or self.arrays is None:
            return None
        sinusoids = sinusoids_at(reference, t)
        if sinusoids is None:
            return None
        if self._usual is None or not self._usual.fits(sinusoids, resting):
            self._usual = UsualSamples(self.arrays, self._no_regressor.shape[1], self._safety,
                                       resting, sinusoids)
        self._usual_reference, self._usual_from = reference, t
        return self._usual

    def answered(self, sample: LawSample) -> PreparedSamples | ControlOutput:
        """Answer a sample within the limits."""
        if self.arrays is None:
            return self._asked(sample)
        t, q, qd, _, point, bounds, theta = sample
        if self._prepared is None:
            self._prepared = PreparedSamples(self.arrays, theta.size, self._safety)
        return self._prepared.answered_at(t, q, qd, theta, point, bounds)

    def filtered(self, safety_filter: SafetyFilter, sample: LawSample) -> ControlOutput:
        """Answer a sample with what a safety filter lets through, likewise within the limits."""
        memory = self._memory
        last, before = memory.torque.copy(), memory.time[0]
        answered = self.answered(sample)
        output = answered if isinstance(answered, ControlOutput) else answered.output
        dt = FIRST_INTERVAL if np.isnan(before) else max(sample.t - before, 0.0)
        reach = self._rate_limit * dt
        least = np.maximum(-self._limit, np.minimum(last - reach, self._limit))
        most = np.minimum(self._limit, np.maximum(last + reach, -self._limit))
        torque = safety_filter.filtered(FilterSample(
            sample.t, sample.q, sample.qd, output.torque, least, most))
        if torque is output.torque:
            return output
        memory.torque[:] = torque
        return output._replace(torque=torque, adaptation_term=unwound_term(
            output.x, output.e2, output.wanted, torque))

    def _asked(self, sample: LawSample) -> ControlOutput:
        """Answer a sample by asking the law in Python: a plug-in, or for an arm without arrays."""
        t, q, qd, _, point, bounds, _ = sample
        answer, memory = self._law.answer(sample), self._memory
        dt = FIRST_INTERVAL if np.isnan(memory.time[0]) else t - memory.time[0]
        e1 = q - point.position
        x = self._no_regressor if answer.regressor is None else answer.regressor
        tau, term, bound = limited_answer(
            answer.torque, x, answer.e2, self._limit, memory.torque, self._rate_limit, dt, e1,
            bounds.lower, bounds.upper)
        memory.torque[:], memory.time[0] = tau, t
        return ControlOutput(tau, term, MotionState(t, q, qd, e1, bounds), answer.e2, point, x,
                             bound, answer.torque)
