# SPDX-License-Identifier: Apache-2.0
"""Persistence of excitation (21): the smallest eigenvalue of ∫ Y_fᵀY_f dt over a sliding window.

The gradient law (20) converges only while this index stays above a positive number; concurrent
learning needs the rank of the recorded pairs instead. Side by side the two show why one converges
on a trajectory and the other does not.
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError

__all__ = ['PARTS', 'Excitation', 'with_sample']

PARTS = 20
"""Parts of the window: it slides in steps of one part."""


@jit
def with_sample(gram: np.ndarray, regressor: np.ndarray, dt: float) -> np.ndarray:
    """Return gram + Y_fᵀY_f dt for a regressor of shape (n, m), shape (m, m)."""
    return gram + dt * np.dot(regressor.T, regressor)


class Excitation:
    """The integral of (21) over the last ``window`` seconds of samples.

    A sample costs one small matrix product; the eigenvalues are computed when :attr:`index` is
    asked for, at most once per part of the window.
    """

    def __init__(self, m: int, window: float) -> None:
        """Set up for ``m`` parameters; a window T [s] of 0 switches it off."""
        if not (math.isfinite(window) and window >= 0.0):
            raise ParameterError('identifier.excitation.window', window, 'a finite time >= 0 s')
        self.window = window
        self._m = m
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._parts = np.zeros((PARTS if self.window > 0.0 else 0, self._m, self._m))
        self._present = np.zeros((self._m, self._m))
        self._elapsed = 0.0
        self._completed = 0
        self._known: tuple[int, float] | None = None

    def update(self, dt: float, regressor: np.ndarray) -> None:
        """Add the filtered regressor Y_f, shape (n, m), held over ``dt`` [s]."""
        if self.window == 0.0:
            return
        self._present = with_sample(self._present, regressor, dt)
        self._elapsed += dt
        # Half a sample early rather than one late: sums of dt are never round.
        if self._elapsed + 0.5 * dt >= self.window / PARTS:
            self._parts[self._completed % PARTS] = self._present
            self._present = np.zeros_like(self._present)
            self._elapsed = 0.0
            self._completed += 1

    @property
    def index(self) -> float | None:
        """γ of (21) over the parts completed last, ≥ 0; None where switched off.

        Until a first window is over it covers what there is, a bound from below.
        """
        if self.window == 0.0:
            return None
        if self._known is None or self._known[0] != self._completed:
            smallest = float(np.linalg.eigvalsh(self._parts.sum(axis=0))[0])
            self._known = (self._completed, max(smallest, 0.0))
        return self._known[1]
