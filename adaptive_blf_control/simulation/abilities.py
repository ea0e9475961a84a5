# SPDX-License-Identifier: Apache-2.0
"""What a foreign simulator can tell besides what a `Plant` has to: it says so by having it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from adaptive_blf_control.simulation.truth_fit import TruthFit

__all__ = ['HasContacts', 'HasFit', 'HasInverseDynamics', 'contacts_of', 'unexpressed_by']

_EXACT = 1e-6  # part of a torque under which a fit of theta* counts as exact


@runtime_checkable
class HasInverseDynamics(Protocol):
    """A plant that tells the torque of a motion, whatever its parameters are."""

    def inverse_dynamics(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray,
                         t: float | None = None) -> np.ndarray:
        """Return τ of a motion (q, q̇, q̈) at time ``t`` [s], now where None, shape (n,) [N·m]."""
        ...


@runtime_checkable
class HasFit(Protocol):
    """A plant whose θ* is a fit to its inverse dynamics."""

    def fits(self, parameters: Sequence[str]) -> Sequence[TruthFit]:
        """Return the fit of each epoch of its θ*."""
        ...


@runtime_checkable
class HasContacts(Protocol):
    """A plant that can touch something."""

    @property
    def touched(self) -> Sequence[tuple[float, float]]:
        """Intervals of contact up to now, (begin, end) [s]."""
        ...


def unexpressed_by(plant: object, parameters: Sequence[str]) -> np.ndarray | None:
    """Return the part of each joint's torque that no θ expresses, at worst over time.

    Args:
        plant: A plant.
        parameters: Names of θ.

    Returns:
        Shape (n,); None where θ* is exact or not a fit.
    """
    if not isinstance(plant, HasFit):
        return None
    worst = np.max([fit.unexpressed for fit in plant.fits(parameters)], axis=0)
    return worst if np.any(worst > _EXACT) else None


def contacts_of(plant: object) -> list[list[float]]:
    """Return the intervals of contact, [begin, end] [s]; none where a plant does not tell."""
    return [[begin, end] for begin, end in plant.touched] if isinstance(plant, HasContacts) else []
