# SPDX-License-Identifier: Apache-2.0
"""Control laws: measured state, reference and estimate in, torque and its regressor out.

The controller around a law holds the reference, the sets, the limits of torque and its rate and
the anti-windup; a law is only the formula. The ABLF law (38) is one of them.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.control.law import growing_errors, torque
from adaptive_blf_control.control.reference import ReferencePoint
from adaptive_blf_control.control.sets import Bounds
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.plugin import is_plugin, load_plugin, made

__all__ = ['AblfLaw', 'ComputedTorque', 'Law', 'LawAnswer', 'LawSample', 'ProportionalDerivative',
           'foreign_law', 'make_law']


class LawSample(NamedTuple):
    """What a law is asked about; arrays of shape (n,) unless said.

    Attributes:
        t: Time since the start of the motion [s].
        q: Measured positions [rad].
        qd: Measured velocities [rad/s].
        reference: y_d with two derivatives.
        bounds: Performance bounds in use, with their rates.
        theta: Parameter estimate θ̂, shape (m,).
    """

    t: float
    q: np.ndarray
    qd: np.ndarray
    reference: ReferencePoint
    bounds: Bounds
    theta: np.ndarray


class LawAnswer(NamedTuple):
    """What a law answers; arrays of shape (n,) unless said.

    Attributes:
        torque: Torque before any limit [N·m].
        e2: Velocity error whose Xᵀe2 the identifier is to hear [rad/s].
        regressor: X, shape (n, m); None for a law without an adaptation term.
    """

    torque: np.ndarray
    e2: np.ndarray
    regressor: np.ndarray | None


class Law(Protocol):
    """A control law, made as ``law(arm, settings)`` with every change of the settings."""

    @abstractmethod
    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample of shape (n,) with a torque before any limit, shape (n,) [N·m]."""
        ...


class AblfLaw:
    """Equation (38): τ = X θ̂ − k2 e2 − coupling, with the barrier in α and in the coupling."""

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Take the arm and the gains."""
        self._arm = arm
        # Copies that may be written to: the law is compiled for those.
        self._k1, self._k2 = settings.k1.copy(), settings.k2.copy()
        self._smooth = settings.coupling == 'per_joint'

    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample."""
        point, bounds = sample.reference, sample.bounds
        e1, e2, alpha, alpha_dot, b = growing_errors(
            sample.q, sample.qd, point.position, point.velocity, point.acceleration,
            bounds.lower, bounds.upper, bounds.lower_rate, bounds.upper_rate, self._k1)
        x = self._arm.X(sample.q, sample.qd, alpha, alpha_dot)
        return LawAnswer(torque(x, sample.theta, self._k2, e1, e2, b, self._smooth), e2, x)


class ProportionalDerivative:
    """τ = −K_p e1 − K_d ė1, with the stiffness and damping of the linearised ABLF law.

    Near e1 = 0 (38) is a PD around the model: K_d = k2 and K_p = k2 k1 b⁴ + 1/b², b² the mean of
    both sides of the performance set.
    """

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Take the gains."""
        square = 0.5 * (settings.performance.lower ** 2 + settings.performance.upper ** 2)
        self._damping = settings.k2
        self._stiffness = settings.k2 * settings.k1 * square ** 2 + 1.0 / square

    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample."""
        return LawAnswer(-self.pull(sample), sample.qd - sample.reference.velocity, None)

    def pull(self, sample: LawSample) -> np.ndarray:
        """Return K_p e1 + K_d ė1, shape (n,) [N·m]."""
        return np.asarray(self._stiffness * (sample.q - sample.reference.position)
                          + self._damping * (sample.qd - sample.reference.velocity))


class ComputedTorque(ProportionalDerivative):
    """τ = M̂ v + Ĉ q̇ + Ĝ + F̂ q̇ from θ̂, with v = ÿ_d − (K_p e1 + K_d ė1)/M̂_ii."""

    def __init__(self, arm: Arm, settings: ControllerSettings) -> None:
        """Take the arm and the gains."""
        super().__init__(arm, settings)
        self._arm = arm
        self._units = np.eye(arm.n)

    def answer(self, sample: LawSample) -> LawAnswer:
        """Answer one sample; a joint without a positive inertia in θ̂ is left to its PD."""
        inertia = np.array([(self._arm.Y1(sample.q, unit) @ sample.theta)[i]
                            for i, unit in enumerate(self._units)])
        known, pull = inertia > 0.0, self.pull(sample)
        wanted = sample.reference.acceleration - np.where(
            known, pull / np.where(known, inertia, 1.0), 0.0)
        # With α = q̇ the regressor X has no e2: it is that of the inverse dynamics.
        model = self._arm.X(sample.q, sample.qd, sample.qd, wanted) @ sample.theta
        return LawAnswer(model - np.where(known, 0.0, pull),
                         sample.qd - sample.reference.velocity, None)


_OURS: dict[str, Any] = {'ablf': AblfLaw, 'pd': ProportionalDerivative,
                         'computed_torque': ComputedTorque}


def make_law(arm: Arm, settings: ControllerSettings) -> Law:
    """Make the law that ``settings.law`` names: one of ours, or a stranger's ``module:name``.

    Args:
        arm: The arm.
        settings: With arrays of full length, see `Settings.resolved`.

    Raises:
        ParameterError: the stranger's law cannot be imported or has no ``answer``.
    """
    if not is_plugin(settings.law):
        law: Law = _OURS[settings.law](arm, settings)
        return law
    return foreign_law('controller.law', settings.law, load_plugin(
        'controller.law', settings.law), arm, settings)


def foreign_law(name: str, value: object, given: Any, arm: Arm,
                settings: ControllerSettings) -> Law:
    """Return a stranger's law behind a check of what it answers.

    Args:
        name: The parameter or argument that gives it, for messages.
        value: Its value, likewise.
        given: A law, or what is called with the arm and the settings and returns one.
        arm: The arm.
        settings: With arrays of full length.

    Raises:
        ParameterError: it cannot be made or has no ``answer``.
    """
    return _Checked(made(name, value, given, ('answer',), arm, settings), arm)


class _Checked:
    """A law whose answers are what the compiled functions after it take, or are refused."""

    def __init__(self, law: Law, arm: Arm) -> None:
        self._law, self._arm = law, arm

    def answer(self, sample: LawSample) -> LawAnswer:
        answer, arm = self._law.answer(sample), self._arm
        if not isinstance(answer, LawAnswer):
            raise ParameterError(f'{type(self._law).__name__}.answer', answer, 'a LawAnswer')
        x = answer.regressor
        return LawAnswer(
            checked_array('torque', answer.torque, (arm.n,), arm.joints),
            checked_array('e2', answer.e2, (arm.n,), arm.joints),
            None if x is None else checked_array('regressor', x, (arm.n, arm.m)))
