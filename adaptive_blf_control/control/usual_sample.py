# SPDX-License-Identifier: Apache-2.0
"""A sample of the usual motion in one call from Python: sinusoids to follow, bounds at rest.

What is asked of a sample there is known before it comes: y_d at any time, the performance bounds
and the safety set. So they lie in one handle, and the call gives the measured state alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import entry_for, Handle, handle, jit
from adaptive_blf_control.control.constraints import MotionState
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.reference import (
    Crossfade,
    Reference,
    ReferencePoint,
    Sinusoids,
    SmoothStart,
    SumOfSinusoids,
    write_sinusoids,
)
from adaptive_blf_control.control.sets import Bounds, JointInterval
from adaptive_blf_control.control.step import Answer, ControllerArrays, write_answer

__all__ = ['answer_usual_sample', 'sinusoids_at', 'UsualMotion', 'UsualSamples']


class UsualMotion(NamedTuple):
    """What the samples of a motion have in common, and where their answers are written.

    Attributes:
        controller: The law (38) with its limits.
        sinusoids: Those of y_d.
        bounds: Performance bounds with their rates.
        lower: Of the safety set, shape (n,) [rad].
        upper: Likewise.
        answer: Is written.
        point: y_d with two derivatives; is written.
        regressor: X, shape (n, m); is written.
        margins: To both sets, the safety set first, shape (2 n,) [rad]; is written.
    """

    controller: ControllerArrays
    sinusoids: Sinusoids
    bounds: Bounds
    lower: np.ndarray
    upper: np.ndarray
    answer: Answer
    point: ReferencePoint
    regressor: np.ndarray
    margins: np.ndarray


@jit
def answer_usual_sample(motion: Handle, t: float, q: np.ndarray, qd: np.ndarray,
                        theta: np.ndarray) -> float:
    """Answer one sample as `write_answer` does, called from Python.

    Args:
        motion: A `UsualMotion`; its memory is changed in place.
        t: Time of the sample since the start of the motion [s].
        q: Measured positions, shape (n,) [rad].
        qd: Measured velocities, shape (n,) [rad/s].
        theta: θ̂, shape (m,).

    Returns:
        The smallest margin [rad]; NaN where one is.
    """
    parts = motion.value
    n, answer, point, bounds = q.size, parts.answer, parts.point, parts.bounds
    safe_lower, safe_upper = parts.lower, parts.upper
    e1, lower, upper, margins = answer.e1, bounds.lower, bounds.upper, parts.margins
    write_sinusoids(point, t, parts.sinusoids)
    write_answer(parts.regressor, parts.controller, answer, t, q, qd, theta, point, bounds)
    smallest = np.inf
    for i in range(n):
        margins[i] = np.minimum(q[i] - safe_lower[i], safe_upper[i] - q[i])
        margins[n + i] = np.minimum(e1[i] - lower[i], upper[i] - e1[i])
        smallest = np.minimum(smallest, np.minimum(margins[i], margins[n + i]))
    return smallest


def sinusoids_at(reference: Reference, t: float) -> SumOfSinusoids | None:
    """Return the sinusoids that a reference is at ``t`` [s]; None where it is another one."""
    while type(reference) in (SmoothStart, Crossfade):
        if not t - reference.begin >= reference.duration:  # type: ignore[attr-defined]
            return None
        reference = reference.after  # type: ignore[attr-defined]
    return reference if type(reference) is SumOfSinusoids else None


class UsualSamples:
    """Answers the samples of a motion while its sinusoids, bounds and sets stay what they are.

    It is also the answer to the last one, an `Answered`.

    Attributes:
        torque: See `Answered`, as the other attributes.
    """

    def __init__(self, controller: ControllerArrays, m: int, sinusoids: SumOfSinusoids,
                 bounds: Bounds, safety: JointInterval) -> None:
        """Take what the samples have in common, see `UsualMotion`, for m parameters."""
        n = controller.memory.torque.size
        self._rows, self._products = np.empty((10, n)), np.empty((n + 1, m))
        rows, products = self._rows, self._products
        answer = Answer(rows[0], products[n], rows[1], rows[2], rows[8], rows[9], rows[3], rows[4])
        self.torque, self.adaptation_term, self.e1, self.e2 = answer[:4]
        self.reference = ReferencePoint(rows[5], rows[6], rows[7])
        self.margins, self.smallest = np.full(2 * n, np.nan), np.nan
        self._sinusoids, self._bounds = sinusoids, bounds
        self._handle = handle(UsualMotion(
            controller, sinusoids.arrays, bounds, safety.lower.copy(), safety.upper.copy(),
            answer, self.reference, products[:n], self.margins))
        self.t, self._q, self._qd = np.nan, np.empty(n), np.empty(n)
        self._answer = entry_for(answer_usual_sample, self._handle, self.t, self._q, self._qd,
                                 self.adaptation_term)
        self._output: ControlOutput | None = None

    def fits(self, sinusoids: SumOfSinusoids, bounds: Bounds) -> bool:
        """Return whether these are the sinusoids and the bounds of the handle."""
        return sinusoids is self._sinusoids and bounds is self._bounds

    def answered(self, t: float, q: np.ndarray, qd: np.ndarray,
                 theta: np.ndarray) -> UsualSamples:
        """Return the answer to a sample: this object, with other numbers in its arrays."""
        self.t, self._q, self._qd, self._output = t, q, qd, None
        self.smallest = self._answer(self._handle, t, q, qd, theta)
        return self

    @property
    def output(self) -> ControlOutput:
        """All that belongs to the last answer, in arrays of its own."""
        if self._output is None:
            rows, products = self._rows.copy(), self._products.copy()
            # Row by row: an array that is unpacked takes twice as long.
            self._output = ControlOutput(
                rows[0], products[-1], MotionState(self.t, self._q, self._qd, rows[1],
                                                    self._bounds),
                rows[2], ReferencePoint(rows[5], rows[6], rows[7]), products[:-1], rows[3],
                rows[4])
        return self._output
