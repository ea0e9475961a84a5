# SPDX-License-Identifier: Apache-2.0
"""Update laws as parts: what moves θ̂, given the present pair, the recorded ones and Xᵀe2."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple, Protocol

import numpy as np

from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.compiled import all_finite, by_type, jit
from adaptive_blf_control.identification.update_basis import (
    basis_is_known,
    basis_step,
    new_basis,
    SMALLEST,
    spectral_step,
    UpdateBasis,
)
from adaptive_blf_control.identification.update_law import implicit_step
from adaptive_blf_control.parameters.plugin import is_plugin, load_plugin, made

__all__ = ['AblfConcurrent', 'Concurrent', 'Evidence', 'Gains', 'Gradient', 'ImplicitArrays',
           'UPDATE_LAWS', 'UpdateLaw', 'make_update_law', 'plugin_update_law', 'stepped']


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
        """Return θ̂ after ``dt`` [s], shape (m,); ``theta`` is left as it is."""
        ...


@by_type
def stepped(law: UpdateLaw, theta: np.ndarray, dt: float, evidence: Evidence,
            revision: int) -> np.ndarray:
    """Return θ̂ after ``dt`` [s], shape (m,); NaN where LAPACK finds no solution.

    Args:
        law: The law.
        theta: θ̂, shape (m,).
        dt: Step [s].
        evidence: What there is to learn from.
        revision: Another number whenever ``evidence.gram`` is another.

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
        basis: Eigenvectors of the recorded information, changed in place.
        kt: k_t.
        kh: k_h, 0 for the gradient law.
        hears: Whether the law uses Xᵀe2.
    """

    gamma: np.ndarray
    basis: UpdateBasis
    kt: float
    kh: float
    hears: bool


LARGEST = 1e12  # beyond that 1 is lost in the rounding of a matrix of 1e-16 times as much


@jit
def implicitly_stepped(law: ImplicitArrays, theta: np.ndarray, dt: float, evidence: Evidence,
                       revision: int) -> np.ndarray:
    """Take the step (37) in the fastest way that is exact; NaN where a value overflows."""
    regressor, torque = evidence.regressor, evidence.torque
    kt = law.kt if evidence.settled else 0.0
    term = evidence.adaptation_term if law.hears else np.zeros_like(theta)
    slope = (kt * np.dot(torque - np.dot(regressor, theta), regressor)
             + law.kh * (evidence.moment - np.dot(evidence.gram, theta)) - term)
    root = np.sqrt(law.gamma)
    scaled = regressor * root
    size = dt * (kt * np.sum(scaled * scaled)
                 + law.kh * np.sum(law.gamma * np.diag(evidence.gram)))
    if not (all_finite(slope) and size < np.inf):
        return np.full_like(theta, np.nan)
    if size > LARGEST:
        information = kt * np.dot(regressor.T, regressor) + law.kh * evidence.gram
        return theta + spectral_step(slope, dt, root, information)
    if theta.size >= SMALLEST and basis_is_known(law.basis, evidence.gram, root, revision):
        return theta + basis_step(law.basis, slope, dt, root, kt, law.kh, regressor)
    return implicit_step(theta, dt, law.gamma, kt, law.kh, regressor, torque, evidence.gram,
                         evidence.moment, term)


stepped.register(ImplicitArrays, implicitly_stepped)


class AblfConcurrent:
    """Equation (37): the present pair, the recorded ones, and Xᵀe2, which Theorem 2 needs.

    Attributes:
        arrays: The law as compiled functions take it.
    """

    hears = True

    def __init__(self, settings: Gains) -> None:
        """Take the gains; ``gamma`` of full length."""
        self.arrays = ImplicitArrays(  # a copy, which is writable: what the step is compiled for
            settings.gamma.copy(), new_basis(settings.gamma.size), settings.kt, settings.kh,
            self.hears)

    def step(self, theta: np.ndarray, dt: float, evidence: Evidence) -> np.ndarray:
        """See `UpdateLaw`; one implicit step, stable for every gain."""
        arrays = self.arrays
        return implicit_step(
            theta, dt, arrays.gamma, arrays.kt if evidence.settled else 0.0, arrays.kh,
            evidence.regressor, evidence.torque, evidence.gram, evidence.moment,
            evidence.adaptation_term if arrays.hears else np.zeros_like(theta))


class Concurrent(AblfConcurrent):
    """Equation (22): the present pair and the recorded ones."""

    hears = False


class Gradient(Concurrent):
    """Equation (20): the present pair alone. Its Γ is our k_t Γ."""

    def __init__(self, settings: Gains) -> None:
        """Take the gains; ``kh`` is not used."""
        super().__init__(settings)
        self.arrays = self.arrays._replace(kh=0.0)


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


def plugin_update_law(name: str, value: object, given: Any, settings: Gains) -> UpdateLaw:
    """Return an update law that is not one of ours.

    Args:
        name: The parameter or argument that gives it, for messages.
        value: Its value, likewise.
        given: An update law, or what is called with the settings and returns one.
        settings: With arrays of full length.

    Raises:
        ParameterError: it cannot be made or has no ``step``.
    """
    law: UpdateLaw = made(name, value, given, ('step',), settings)
    return law
