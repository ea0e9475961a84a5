# SPDX-License-Identifier: Apache-2.0
"""What a control law is: measured state, reference and estimate in, torque and regressor out.

The controller around a law holds the reference, the constraints, the limits of torque and its rate
and the anti-windup; a law is only the formula. The ABLF law (38) is one of them.
"""

from __future__ import annotations

from abc import abstractmethod
import functools
from typing import NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.arrays import record
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.sets import Bounds
from adaptive_blf_control.errors import with_hints

__all__ = ['Law', 'LawAnswer', 'LawSample', 'own_estimate', 'uses_estimate']


@record
@functools.partial(with_hints, instead={
    **dict.fromkeys(('e1', 'e', 'error'), 'q - reference.position'),
    **dict.fromkeys(('e2', 'de', 'velocity_error'), 'qd - reference.velocity'),
    **dict.fromkeys(('q_d', 'q_des', 'y_d'), 'reference.position'),
    'dt': 'the time between two t', 'arm': 'a law is made with the arm: law(arm, settings)'})
class LawSample(NamedTuple):
    """What a law is asked about; arrays of shape (n,) unless another is given.

    Attributes:
        t: Time since the start of the motion [s].
        q: Measured positions [rad].
        qd: Measured velocities [rad/s].
        torque: Mean torque applied over the sample interval that ends at ``t`` [N·m]; NaN where it
            is not measured.
        reference: y_d with two derivatives.
        bounds: Performance bounds in use, with their rates.
        theta: Parameter estimate θ̂, shape (m,).
    """

    t: float
    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray
    reference: ReferencePoint
    bounds: Bounds
    theta: np.ndarray


@record
class LawAnswer(NamedTuple):
    """What a law answers; arrays of shape (n,) unless another is given.

    Attributes:
        torque: Torque before any limit [N·m].
        e2: Velocity error whose Xᵀe2 the identifier is to hear [rad/s].
        regressor: X, shape (n, m); None for a law without an adaptation term.
    """

    torque: np.ndarray
    e2: np.ndarray
    regressor: np.ndarray | None = None


class Law(Protocol):
    """A control law, made as ``law(arm, settings)`` for a motion and with every new setting.

    What a law may have besides ``answer``:

    * ``uses_estimate = False``: it needs no θ̂, and so no identifier;
    * ``theta``: its own θ̂, shape (m,), of a law that adapts by itself;
    * ``retuned(settings)``: returns the law that goes on with other settings, for a law with a
      state of its own, which would be lost where it is made again.
    """

    @abstractmethod
    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample of shape (n,) with a torque before any limit, shape (n,) [N·m]."""
        ...


def uses_estimate(law: Law) -> bool:
    """Whether a law looks at θ̂ of the sample."""
    return bool(getattr(law, 'uses_estimate', True))


def own_estimate(law: Law) -> np.ndarray | None:
    """Return θ̂ of a law that adapts by itself, shape (m,); None for any other."""
    theta: np.ndarray | None = getattr(law, 'theta', None)
    return theta
