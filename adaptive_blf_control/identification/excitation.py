# SPDX-License-Identifier: Apache-2.0
"""Persistence of excitation (21): the smallest eigenvalue of ∫ Y_fᵀY_f dt over a sliding window.

The gradient law (20) converges only while this index stays above a positive number; concurrent
learning needs the rank of the recorded pairs instead. Side by side the two show why one converges
on a trajectory and the other does not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.squares import add_lower_square

__all__ = ['PARTS', 'Excitation', 'ExcitationArrays', 'accumulate', 'add_sample']

PARTS = 20
"""Parts of the window: it slides in steps of one part."""


@jit
def add_sample(gram: np.ndarray, regressor: np.ndarray, dt: float) -> None:
    """Add Y_fᵀY_f dt of a regressor of shape (n, m) to the lower triangle of ``gram``, (m, m)."""
    add_lower_square(gram, regressor, regressor.shape[0], dt)


class ExcitationArrays(NamedTuple):
    """The integral as compiled functions take it; arrays are changed in place.

    Attributes:
        parts: Integrals over the parts of the window, shape (PARTS, m, m); (0, m, m) for none.
            Of these and the present one there is the lower triangle.
        present: Integral over the part that is not complete, shape (m, m).
        elapsed: Time since that part began, shape (1,) [s].
        completed: Number of parts completed so far, shape (1,).
        length: Length of a part [s].
    """

    parts: np.ndarray
    present: np.ndarray
    elapsed: np.ndarray
    completed: np.ndarray
    length: float


@jit
def accumulate(arrays: ExcitationArrays, dt: float, regressor: np.ndarray) -> None:
    """Add the filtered regressor Y_f, shape (n, m), held over ``dt`` [s]."""
    arrays = borrowed(arrays)
    count = arrays.parts.shape[0]
    if count == 0:
        return
    add_sample(arrays.present, regressor, dt)
    arrays.elapsed[0] += dt
    # Half a sample early rather than one late: sums of dt are never round.
    if arrays.elapsed[0] + 0.5 * dt >= arrays.length:
        arrays.parts[arrays.completed[0] % count] = arrays.present
        arrays.present[:, :] = 0.0
        arrays.elapsed[0] = 0.0
        arrays.completed[0] += 1


class Excitation:
    """The integral of (21) over the last ``window`` seconds of samples.

    A sample costs one small matrix product; the eigenvalues are computed when :attr:`index` is
    asked for, at most once per part of the window.

    Attributes:
        arrays: The integral.
        window: T [s].
    """

    def __init__(self, m: int, window: float) -> None:
        """Set up for ``m`` parameters; a window T [s] of 0 switches it off."""
        if not (math.isfinite(window) and window >= 0.0):
            raise ParameterError('identifier.excitation.window', window, 'a finite time >= 0 s')
        self.window = window
        self.arrays = ExcitationArrays(
            np.zeros((PARTS if window > 0.0 else 0, m, m)), np.zeros((m, m)), np.zeros(1),
            np.zeros(1, dtype=np.int64), window / PARTS)
        self._known = 0, 0.0

    def update(self, dt: float, regressor: np.ndarray) -> None:
        """Add the filtered regressor Y_f, shape (n, m), held over ``dt`` [s]."""
        accumulate(self.arrays, dt, regressor)

    @property
    def index(self) -> float | None:
        """γ of (21) over the parts completed last, ≥ 0; None where switched off.

        Until a first window is over it covers what there is, a bound from below.
        """
        if self.window == 0.0:
            return None
        completed = int(self.arrays.completed[0])
        if self._known[0] != completed:
            smallest = float(np.linalg.eigvalsh(self.arrays.parts.sum(axis=0), UPLO='L')[0])
            self._known = completed, max(smallest, 0.0)
        return self._known[1]
