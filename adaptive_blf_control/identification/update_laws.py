# SPDX-License-Identifier: Apache-2.0
"""Update laws as parts: what moves θ̂, given the present pair, the recorded ones and Xᵀe2."""

from __future__ import annotations

from abc import abstractmethod
import functools
from typing import Any, NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.arrays import checked_array, record
from adaptive_blf_control.compiled import borrowed, by_type, jit
from adaptive_blf_control.errors import ParameterError, with_hints
from adaptive_blf_control.identification.update_law import advance, kept_history, KeptHistory
from adaptive_blf_control.parameters.plugin import is_plugin, load_plugin, made, require_call

__all__ = ['AblfConcurrent', 'Concurrent', 'Evidence', 'Gains', 'Gradient', 'ImplicitArrays',
           'UPDATE_LAWS', 'UpdateLaw', 'check_answers', 'make_update_law',
           'plugin_update_law', 'stepped']


class Gains(Protocol):
    """What our laws read of the settings; every law is given all of `IdentifierSettings`."""

    @property
    def gamma(self) -> np.ndarray:
        """Diagonal of Γ, shape (m,)."""
        ...

    @property
    def kt(self) -> float:
        """Gain on the present data, k_t."""
        ...

    @property
    def kh(self) -> float:
        """Gain on the recorded data, k_h."""
        ...

    @property
    def update_law(self) -> str:
        """Name of the law."""
        ...


@functools.partial(with_hints, instead={
    **dict.fromkeys(('Y', 'Yf', 'Y_f', 'phi', 'W'), 'regressor is the present Y_f'),
    **dict.fromkeys(('tau', 'tau_f', 'y'), 'torque is the present tau_f'),
    **dict.fromkeys(('e', 'error', 'residual', 'prediction_error'),
                    'torque - regressor @ theta, with the theta that step is given'),
    **dict.fromkeys(('q', 'qd', 'X', 'e1', 'e2'),
                    'the state is not among it; adaptation_term is X.T @ e2 of the controller'),
    **dict.fromkeys(('Q', 'history', 'stack', 'pairs', 'regressors', 'torques'),
                    'gram and moment are the sums over the recorded pairs'),
    **dict.fromkeys(('dt', 'theta'), 'step is given it, beside the evidence')})
@record
class Evidence(NamedTuple):
    """What there is to learn from at one sample.

    Attributes:
        regressor: Present filtered regressor Y_f, shape (n, m).
        torque: Present filtered torque τ_f, shape (n,) [N·m].
        settled: Whether the filters have forgotten their start, so that the pair can be used.
        gram: Q = Σ Y_fjᵀ Y_fj of the recorded pairs, shape (m, m).
        moment: Σ Y_fjᵀ τ_fj, shape (m,).
        adaptation_term: Xᵀ e2 of the controller, shape (m,).
    """

    regressor: np.ndarray
    torque: np.ndarray
    settled: bool
    gram: np.ndarray
    moment: np.ndarray
    adaptation_term: np.ndarray


class UpdateLaw(Protocol):
    """An update law, made as ``law(settings)`` with every change of the settings."""

    @abstractmethod
    def step(self, theta: np.ndarray, dt: float, evidence: Evidence) -> np.ndarray:
        """Return θ̂ after ``dt`` [s], shape (m,); ``theta`` is not changed.

        Gains that are usual in continuous time make the equation stiff: an explicit Euler step
        diverges where dt times the largest eigenvalue of Γ (k_t Y_fᵀ Y_f + k_h Q) exceeds 2. Ours
        are implicit (docs/theory.md).
        """
        ...


@by_type
def stepped(law: UpdateLaw, theta: np.ndarray, dt: float, evidence: Evidence) -> np.ndarray:
    """Return θ̂ after ``dt`` [s], shape (m,); NaN where LAPACK finds no solution.

    Args:
        law: The law.
        theta: θ̂, shape (m,).
        dt: Step [s].
        evidence: What there is to learn from.

    Raises:
        ParameterError: the law returns another shape.
    """
    try:
        result = law.step(theta.copy(), dt, evidence)
    except np.linalg.LinAlgError:
        return np.full_like(theta, np.nan)
    return checked_array(f'{type(law).__name__}.step', result, theta.shape)


class ImplicitArrays(NamedTuple):
    """One of our laws as compiled functions take it.

    Attributes:
        gamma: Diagonal of Γ, shape (m,).
        kept: What is kept of the recorded pairs from step to step, changed in place.
        kt: k_t.
        kh: k_h, 0 for the gradient law.
        hears: Whether the law uses Xᵀe2.
    """

    gamma: np.ndarray
    kept: KeptHistory
    kt: float
    kh: float
    hears: bool


@jit
def implicitly_stepped(law: ImplicitArrays, theta: np.ndarray, dt: float,
                       evidence: Evidence) -> np.ndarray:
    """Return θ̂ after one implicit step of (37), stable for every gain."""
    law = borrowed(law)
    result = theta.copy()
    advance(law.kept, result, dt, law.gamma, law.kt if evidence.settled else 0.0, law.kh,
            evidence.regressor, evidence.torque, evidence.gram, evidence.moment,
            evidence.adaptation_term if law.hears else np.zeros_like(theta))
    return result


stepped.register(ImplicitArrays, implicitly_stepped)


class AblfConcurrent:
    """Equation (37): the present pair, the recorded ones, and Xᵀe2, which Theorem 2 needs."""

    hears = True

    def __init__(self, settings: Gains) -> None:
        """Take the gains; ``gamma`` of full length."""
        self._gamma = settings.gamma.copy()  # writable, as the step is compiled for it
        self._kt, self._kh = settings.kt, settings.kh
        self._arrays: ImplicitArrays | None = None

    def arrays(self, n: int) -> ImplicitArrays:
        """Return the law as compiled functions take it, the same each time, for n joints."""
        if self._arrays is None:
            self._arrays = ImplicitArrays(self._gamma, kept_history(n, self._gamma.size),
                                          self._kt, self._kh, self.hears)
        return self._arrays

    def step(self, theta: np.ndarray, dt: float, evidence: Evidence) -> np.ndarray:
        """See `UpdateLaw`; one implicit step, stable for every gain."""
        result: np.ndarray = implicitly_stepped(self.arrays(evidence.torque.size), theta, dt,
                                                evidence)
        return result


class Concurrent(AblfConcurrent):
    """Equation (22): the present pair and the recorded ones."""

    hears = False


class Gradient(Concurrent):
    """Equation (20): the present pair alone. Its Γ is our k_t Γ."""

    def __init__(self, settings: Gains) -> None:
        """Take the gains; ``kh`` is not used."""
        super().__init__(settings)
        self._kh = 0.0


_OURS: dict[str, Any] = {'gradient': Gradient, 'concurrent': Concurrent,
                         'ablf_concurrent': AblfConcurrent}
UPDATE_LAWS = tuple(_OURS)
"""The names of our laws."""


def make_update_law(settings: Gains) -> UpdateLaw:
    """Make the law that ``settings.update_law`` names: one of ours, or ``module:name``.

    Args:
        settings: With arrays of full length, see `Settings.resolved`.

    Raises:
        ParameterError: a plug-in cannot be imported or has no ``step``.
    """
    if not is_plugin(settings.update_law):
        law: UpdateLaw = _OURS[settings.update_law](settings)
        return law
    return plugin_update_law('identifier.update_law', settings.update_law, load_plugin(
        'identifier.update_law', settings.update_law), settings)


def check_answers(law: UpdateLaw, unused: int, *samples: Any) -> None:
    """Raise ParameterError where samples were of no use because a law answered none of them.

    Args:
        law: The law.
        unused: How many samples were left out because a value was not finite.
        samples: What was measured, as it was given.
    """
    if unused and all(np.isfinite(np.asarray(each, dtype=float)).all() for each in samples):
        raise ParameterError(f'{type(law).__name__}.step', np.nan, 'finite parameters: it '
                             f'returned NaN or infinity for {unused} samples')


def plugin_update_law(name: str, value: object, given: Any, settings: Gains) -> UpdateLaw:
    """Return an update law that is not one of ours.

    Args:
        name: The parameter or argument that gives it, for messages.
        value: Its value, likewise.
        given: An update law, or what is called with the settings and returns one.
        settings: With arrays of full length.

    Raises:
        ParameterError: it cannot be made, has no ``step``, or its ``step`` takes other arguments.
    """
    law: UpdateLaw = made(name, value, given, ('step',), settings)
    require_call(name, value, law, 'step', 'theta', 'dt', 'evidence')
    return law
