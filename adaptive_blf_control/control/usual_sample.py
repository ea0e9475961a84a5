# SPDX-License-Identifier: Apache-2.0
"""A sample of (38) in one call from Python, its answer in arrays that lie in a handle.

Reference and bounds are given with the sample. Of the usual motion, which follows sinusoids within
bounds at rest, they are known before it comes, and the call gives the measured state alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, entry_for, Handle, handle, jit
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

__all__ = ['PreparedSamples', 'sinusoids_at', 'UsualSamples']


class PreparedMotion(NamedTuple):
    """What the samples of a motion have in common, and where their answers are written.

    Attributes:
        controller: The law (38) with its limits.
        lower: Of the safety set, shape (n,) [rad].
        upper: Likewise.
        bounds: Performance bounds with their rates.
        point: y_d with two derivatives.
        answer: Is written.
        regressor: X, shape (n, m); is written.
        margins: To both sets, the safety set first, shape (2 n,) [rad]; is written.
    """

    controller: ControllerArrays
    lower: np.ndarray
    upper: np.ndarray
    bounds: Bounds
    point: ReferencePoint
    answer: Answer
    regressor: np.ndarray
    margins: np.ndarray


class UsualMotion(NamedTuple):
    """A motion whose ``point`` is that of sinusoids and is written with each sample."""

    prepared: PreparedMotion
    sinusoids: Sinusoids


@jit
def answer_prepared_sample(motion: Handle, t: float, q: np.ndarray, qd: np.ndarray,
                           theta: np.ndarray) -> float:
    """Answer one sample of a `PreparedMotion`, see `answer_prepared`, called from Python."""
    return answer_prepared(motion.value, t, borrowed(q), borrowed(qd), borrowed(theta))


@jit
def answer_usual_sample(motion: Handle, t: float, q: np.ndarray, qd: np.ndarray,
                        theta: np.ndarray) -> float:
    """Answer one sample of a `UsualMotion`, see `answer_prepared`, called from Python."""
    usual = motion.value
    write_sinusoids(usual.prepared.point, t, usual.sinusoids)
    return answer_prepared(usual.prepared, t, borrowed(q), borrowed(qd), borrowed(theta))


@jit
def answer_prepared(motion: PreparedMotion, t: float, q: np.ndarray, qd: np.ndarray,
                    theta: np.ndarray) -> float:
    """Answer one sample as `write_answer` does.

    Args:
        motion: Its memory is changed in place, too.
        t: Time of the sample since the start of the motion [s].
        q: Measured positions, shape (n,) [rad].
        qd: Measured velocities, shape (n,) [rad/s].
        theta: θ̂, shape (m,).

    Returns:
        The smallest margin [rad]; NaN where one is.
    """
    n, answer, bounds = q.size, motion.answer, motion.bounds
    safe_lower, safe_upper = motion.lower, motion.upper
    e1, lower, upper, margins = answer.e1, bounds.lower, bounds.upper, motion.margins
    write_answer(motion.regressor, motion.controller, answer, t, q, qd, theta, motion.point,
                 bounds)
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


class PreparedSamples:
    """Answers the samples of a motion while its law and its sets stay what they are.

    It is also the answer to the last one, an `Answered`.

    Attributes:
        torque: See `Answered`, as the other attributes.
    """

    def __init__(self, controller: ControllerArrays, m: int, safety: JointInterval,
                 bounds: Bounds | None = None) -> None:
        """Take what the samples have in common, for m parameters; ``bounds`` where they rest."""
        n = controller.memory.torque.size
        self._rows, self._products = np.empty((10, n)), np.empty((n + 1, m))
        rows, products = self._rows, self._products
        answer = Answer(rows[0], products[n], rows[1], rows[2], rows[8], rows[9], rows[3], rows[4])
        self.torque, self.adaptation_term, self.e1, self.e2 = answer[:4]
        self.reference = ReferencePoint(rows[5], rows[6], rows[7])
        self.margins, self.smallest = np.full(2 * n, np.nan), np.nan
        self._bounds = Bounds(*np.empty((4, n))) if bounds is None else bounds
        self._motion = PreparedMotion(
            controller, safety.lower.copy(), safety.upper.copy(), self._bounds, self.reference,
            answer, products[:n], self.margins)
        self.t, self._q, self._qd = np.nan, np.empty(n), np.empty(n)
        self._output: ControlOutput | None = None
        self._prepare()

    def _prepare(self) -> None:
        self._use(answer_prepared_sample, self._motion)

    def _use(self, answer: Callable[..., float], motion: tuple[Any, ...]) -> None:
        """Call the machine code of ``answer`` with ``motion`` from now on."""
        self._handle = handle(motion)
        self._answer = entry_for(answer, self._handle, self.t, self._q, self._qd,
                                 self.adaptation_term)

    def answered_at(self, t: float, q: np.ndarray, qd: np.ndarray, theta: np.ndarray,
                    point: ReferencePoint, bounds: Bounds) -> PreparedSamples:
        """Return the answer to a sample that reference and bounds are given with."""
        place, used = self.reference, self._motion.bounds
        place.position[:], place.velocity[:], place.acceleration[:] = point
        used.lower[:], used.upper[:], used.lower_rate[:], used.upper_rate[:] = bounds
        self._bounds = bounds
        return self.answered(t, q, qd, theta)

    def answered(self, t: float, q: np.ndarray, qd: np.ndarray,
                 theta: np.ndarray) -> PreparedSamples:
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


class UsualSamples(PreparedSamples):
    """Answers the samples of a motion whose sinusoids, too, stay what they are."""

    def __init__(self, controller: ControllerArrays, m: int, safety: JointInterval,
                 bounds: Bounds, sinusoids: SumOfSinusoids) -> None:
        """Take what the samples have in common, for m parameters."""
        self._sinusoids = sinusoids
        super().__init__(controller, m, safety, bounds)

    def _prepare(self) -> None:
        self._use(answer_usual_sample, UsualMotion(self._motion, self._sinusoids.arrays))

    def fits(self, sinusoids: SumOfSinusoids, bounds: Bounds) -> bool:
        """Return whether these are the sinusoids and the bounds of the handle."""
        return sinusoids is self._sinusoids and bounds is self._bounds
