# SPDX-License-Identifier: Apache-2.0
"""A sample of the usual motion in one call from Python: sinusoids to follow, bounds at rest.

What is asked of a sample there is known before it comes: y_d at any time, the performance bounds
and the safety set. So they lie in one handle, and the call gives the measured state alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, Handle, handle, jit
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

ROWS = 8  # of what a sample writes for each joint, see `answer_usual_sample`


class UsualMotion(NamedTuple):
    """What the samples of a motion have in common.

    Attributes:
        controller: The law (38) with its limits.
        sinusoids: Those of y_d.
        bounds: Performance bounds with their rates.
        lower: Of the safety set, shape (n,) [rad].
        upper: Likewise.
        margins: To both sets in the last sample, the safety set first, shape (2 n,) [rad].
        alpha: Room for α [rad/s] and α̇ [rad/s²], shape (2, n).
    """

    controller: ControllerArrays
    sinusoids: Sinusoids
    bounds: Bounds
    lower: np.ndarray
    upper: np.ndarray
    margins: np.ndarray
    alpha: np.ndarray


@jit
def answer_usual_sample(motion: Handle, t: float, q: np.ndarray, qd: np.ndarray,
                        theta: np.ndarray, rows: np.ndarray, products: np.ndarray) -> None:
    """Answer one sample as `write_answer` does, called from Python.

    Args:
        motion: A `UsualMotion`; its memory, margins and room are changed in place.
        t: Time of the sample since the start of the motion [s].
        q: Measured positions, shape (n,) [rad].
        qd: Measured velocities, shape (n,) [rad/s].
        theta: θ̂, shape (m,).
        rows: To be filled with torque, e1, e2, active bound, torque before the limits, and y_d
            with two derivatives, shape (8, n).
        products: To be filled with X and below it the adaptation term, shape (n + 1, m).
    """
    parts = motion.value
    n = q.size
    bounds, safe_lower, safe_upper = parts.bounds, parts.lower, parts.upper
    e1, lower, upper, margins = rows[1], bounds.lower, bounds.upper, parts.margins
    point = borrowed(ReferencePoint(rows[5], rows[6], rows[7]))
    write_sinusoids(point, t, parts.sinusoids)
    answer = Answer(rows[0], products[n], e1, rows[2], parts.alpha[0], parts.alpha[1], rows[3],
                    rows[4])
    write_answer(products[:n], parts.controller, borrowed(answer), t, q, qd, theta, point, bounds)
    for i in range(n):
        margins[i] = np.minimum(q[i] - safe_lower[i], safe_upper[i] - q[i])
        margins[n + i] = np.minimum(e1[i] - lower[i], upper[i] - e1[i])


def sinusoids_at(reference: Reference, t: float) -> SumOfSinusoids | None:
    """Return the sinusoids that a reference is at ``t`` [s]; None where it is another one."""
    while type(reference) in (SmoothStart, Crossfade):
        if not t - reference.begin >= reference.duration:  # type: ignore[attr-defined]
            return None
        reference = reference.after  # type: ignore[attr-defined]
    return reference if type(reference) is SumOfSinusoids else None


class UsualSamples:
    """Answers the samples of a motion while its sinusoids, bounds and sets stay what they are.

    Attributes:
        margins: To both sets in the last sample, the safety set first, shape (2 n,) [rad].
    """

    def __init__(self, controller: ControllerArrays, sinusoids: SumOfSinusoids, bounds: Bounds,
                 safety: JointInterval) -> None:
        """Take what the samples have in common; see `UsualMotion`."""
        n = controller.memory.torque.size
        self.margins = np.full(2 * n, np.nan)
        self._sinusoids, self._bounds = sinusoids, bounds
        self._handle = handle(UsualMotion(
            controller, sinusoids.arrays, bounds, safety.lower.copy(), safety.upper.copy(),
            self.margins, np.empty((2, n))))

    def fits(self, sinusoids: SumOfSinusoids, bounds: Bounds) -> bool:
        """Return whether these are the sinusoids and the bounds of the handle."""
        return sinusoids is self._sinusoids and bounds is self._bounds

    def answered(self, t: float, q: np.ndarray, qd: np.ndarray,
                 theta: np.ndarray) -> ControlOutput:
        """Return the answer to a sample."""
        rows = np.empty((ROWS, q.size))
        products = np.empty((q.size + 1, theta.size))
        answer_usual_sample(self._handle, t, q, qd, theta, rows, products)
        # Row by row: an array that is unpacked takes twice as long.
        return ControlOutput(rows[0], products[-1], MotionState(t, q, qd, rows[1], self._bounds),
                             rows[2], ReferencePoint(rows[5], rows[6], rows[7]), products[:-1],
                             rows[3], rows[4])
