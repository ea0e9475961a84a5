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

ROWS = 12  # of what a sample writes for each joint, see `answer_usual_sample`


class UsualMotion(NamedTuple):
    """What the samples of a motion have in common.

    Attributes:
        controller: The law (38) with its limits.
        sinusoids: Those of y_d.
        bounds: Performance bounds with their rates.
        lower: Of the safety set, shape (n,) [rad].
        upper: Likewise.
    """

    controller: ControllerArrays
    sinusoids: Sinusoids
    bounds: Bounds
    lower: np.ndarray
    upper: np.ndarray


@jit
def answer_usual_sample(motion: Handle, t: float, q: np.ndarray, qd: np.ndarray,
                        theta: np.ndarray, rows: np.ndarray, products: np.ndarray) -> None:
    """Answer one sample as `write_answer` does, called from Python.

    Args:
        motion: A `UsualMotion`; its memory is changed in place.
        t: Time of the sample since the start of the motion [s].
        q: Measured positions, shape (n,) [rad].
        qd: Measured velocities, shape (n,) [rad/s].
        theta: θ̂, shape (m,).
        rows: To be filled with the margins to the safety and the performance set, torque, e1, e2,
            active bound, torque before the limits, y_d with two derivatives, α and α̇; (12, n).
        products: To be filled with X and below it the adaptation term, shape (n + 1, m).
    """
    parts = motion.value
    n = q.size
    bounds, safe_lower, safe_upper = parts.bounds, parts.lower, parts.upper
    e1, lower, upper = rows[3], bounds.lower, bounds.upper
    point = borrowed(ReferencePoint(rows[7], rows[8], rows[9]))
    write_sinusoids(point, t, parts.sinusoids)
    answer = Answer(rows[2], products[n], e1, rows[4], rows[10], rows[11], rows[5], rows[6])
    write_answer(products[:n], parts.controller, borrowed(answer), t, q, qd, theta, point, bounds)
    for i in range(n):
        rows[0, i] = np.minimum(q[i] - safe_lower[i], safe_upper[i] - q[i])
        rows[1, i] = np.minimum(e1[i] - lower[i], upper[i] - e1[i])


def sinusoids_at(reference: Reference, t: float) -> SumOfSinusoids | None:
    """Return the sinusoids that a reference is at ``t`` [s]; None where it is another one."""
    while type(reference) in (SmoothStart, Crossfade):
        if not t - reference.begin >= reference.duration:  # type: ignore[attr-defined]
            return None
        reference = reference.after  # type: ignore[attr-defined]
    return reference if type(reference) is SumOfSinusoids else None


class UsualSamples:
    """Answers the samples of a motion while its sinusoids, bounds and sets stay what they are."""

    def __init__(self, controller: ControllerArrays, sinusoids: SumOfSinusoids, bounds: Bounds,
                 safety: JointInterval) -> None:
        """Take what the samples have in common; see `UsualMotion`."""
        self._sinusoids, self._bounds = sinusoids, bounds
        self._handle = handle(UsualMotion(controller, sinusoids.arrays, bounds,
                                          safety.lower.copy(), safety.upper.copy()))

    def fits(self, sinusoids: SumOfSinusoids, bounds: Bounds) -> bool:
        """Return whether these are the sinusoids and the bounds of the handle."""
        return sinusoids is self._sinusoids and bounds is self._bounds

    def answered(self, t: float, q: np.ndarray, qd: np.ndarray,
                 theta: np.ndarray) -> tuple[ControlOutput, np.ndarray]:
        """Return the answer to a sample, and the margins to both sets, shape (2 n,) [rad]."""
        rows = np.empty((ROWS, q.size))
        products = np.empty((q.size + 1, theta.size))
        answer_usual_sample(self._handle, t, q, qd, theta, rows, products)
        _, _, torque, e1, e2, bound, wanted, y, yd, ydd, _, _ = rows
        return ControlOutput(torque, products[-1], MotionState(t, q, qd, e1, self._bounds), e2,
                             ReferencePoint(y, yd, ydd), products[:-1], bound,
                             wanted), rows[:2].reshape(-1)
