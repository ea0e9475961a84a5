# SPDX-License-Identifier: Apache-2.0
"""Base parameters: the combinations of inertial parameters that the torque depends on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = ['INERTIAL_NAMES', 'PER_BODY', 'BaseParameters', 'decompose', 'preferred_columns']

INERTIAL_NAMES = ('m', 'mx', 'my', 'mz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')
"""Ten parameters of a body: mass [kg], first moments [kg·m], second moments [kg·m²] about the
origin of the joint's frame (Pinocchio's order)."""

PER_BODY = len(INERTIAL_NAMES)

# Masses last: on a revolute chain they are then never chosen, so that a representative set of
# inertial parameters keeps the masses of the URDF whatever the base parameters are.
_TIERS = (('mx', 'my', 'Ixx', 'Ixy', 'Ixz', 'Iyz', 'Izz'), ('mz', 'Iyy'), ('m',))


class BaseParameters(NamedTuple):
    """Y π = Y[:, independent] θ with θ = from_standard π, for every state.

    Attributes:
        independent: Columns of the standard regressor that are kept, ascending, shape (b,).
        from_standard: Map π → θ, shape (b, p); the identity on the kept columns.
    """

    independent: np.ndarray
    from_standard: np.ndarray

    def nearest_standard(self, theta: np.ndarray, reference: np.ndarray) -> np.ndarray:
        """Return a π with from_standard π = θ that differs from a reference in kept columns only.

        Where ``theta`` belongs to ``reference``, the reference is returned bit for bit.

        Args:
            theta: Base parameters, shape (b,).
            reference: Standard parameters to start from, shape (p,).
        """
        standard = np.array(reference, dtype=float)
        standard[self.independent] += theta - self.from_standard @ standard
        return standard


def preferred_columns(bodies: int) -> np.ndarray:
    """Return the order in which columns are tried, last body first, shape (10 * bodies,)."""
    return np.array([PER_BODY * body + INERTIAL_NAMES.index(name)
                     for tier in _TIERS for body in reversed(range(bodies)) for name in tier])


def decompose(stack: np.ndarray, order: np.ndarray, tolerance: float = 1e-5) -> BaseParameters:
    """Find independent columns of a stacked regressor and express the others through them.

    A column is kept if its remainder, after Gram-Schmidt against the columns kept before it, is
    longer than ``tolerance`` times the longest column. The fixed order makes the choice the same
    on every machine. The tolerance is well above rounding: CAD exporters write an upright axis
    with a tilt of 1e-6 rad, and no measurement can determine parameters that depend on that tilt.

    Args:
        stack: Standard regressors of many random states on top of each other, shape (k, p).
        order: Columns in the order in which they are tried, shape (p,).
        tolerance: Relative length under which a remainder counts as zero.
    """
    # The triangular factor has the same columns up to a rotation and far fewer rows.
    columns: np.ndarray = np.linalg.qr(stack)[1]
    shortest = tolerance * np.linalg.norm(columns, axis=0).max(initial=0.0)
    basis = np.zeros((columns.shape[0], 0))
    kept: list[int] = []
    for index in order:
        rest = columns[:, index]
        for _ in range(2):  # the second pass removes the rounding errors of the first
            rest = rest - basis @ (basis.T @ rest)
        length = np.linalg.norm(rest)
        if length > shortest:
            basis = np.column_stack([basis, rest / length])
            kept.append(int(index))
    independent = np.array(sorted(kept), dtype=np.intp)
    return BaseParameters(independent, _express(columns, independent))


def _express(columns: np.ndarray, independent: np.ndarray) -> np.ndarray:
    if not independent.size:
        return np.zeros((0, columns.shape[1]))
    kept = columns[:, independent]
    scale = np.linalg.norm(kept, axis=0)
    weights: np.ndarray = np.linalg.lstsq(kept / scale, columns, rcond=None)[0] / scale[:, None]
    # A column below the tolerance is a short combination of others, or rounding to leave out.
    rest = np.linalg.norm(columns - kept @ weights, axis=0)
    weights[:, rest > 0.5 * np.linalg.norm(columns, axis=0)] = 0.0
    weights[np.abs(weights) < 1e-10] = 0.0
    weights[:, independent] = np.eye(independent.size)
    return weights
