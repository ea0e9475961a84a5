# SPDX-License-Identifier: Apache-2.0
"""Least squares over the filtered pairs of a span of a log, in bounded memory."""

from __future__ import annotations

import numpy as np

__all__ = ['BatchFit', 'least_squares']

# Number of pairs that are collected before each condensation.
CHUNK = 512


class BatchFit:
    """Errors of Y_f θ = τ_f over all pairs of a span, for any θ given afterwards.

    Per joint the rows [Y_f τ_f] are condensed to the triangular factor of their QR decomposition:
    ‖Y_f θ − τ_f‖ over the span equals ‖R (θ, −1)‖, without the cancellation of normal equations
    and the memory does not grow with the length of the log.

    Attributes:
        count: Number of pairs.
    """

    def __init__(self, n: int, m: int) -> None:
        """Start with no pairs of ``n`` joints and ``m`` parameters."""
        self.count = 0
        self._factor = np.zeros((n, 0, m + 1))
        self._rows: list[np.ndarray] = []
        self._waiting = 0

    def add(self, rows: np.ndarray) -> None:
        """Add K pairs: [Y_f τ_f], shape (K, n, m + 1), τ_f in N·m."""
        if len(rows):
            self.count += len(rows)
            self._rows.append(rows)
            self._waiting += len(rows)
            if self._waiting >= CHUNK:
                self._condense()

    def _condense(self) -> None:
        if self._rows:
            rows = np.concatenate(self._rows).transpose(1, 0, 2)
            self._rows.clear()
            self._waiting = 0
            stacked = np.concatenate([self._factor, rows], axis=1)
            self._factor = np.stack([np.linalg.qr(joint, mode='r') for joint in stacked])

    def factor(self) -> np.ndarray:
        """Return R per joint, shape (n, at most m + 1, m + 1)."""
        self._condense()
        return self._factor

    def rmse(self, theta: np.ndarray) -> np.ndarray:
        """Return the root mean square of Y_f θ − τ_f per joint, shape (n,) [N·m]."""
        residual = self.factor() @ np.append(theta, -1.0)
        return np.linalg.norm(residual, axis=1) / np.sqrt(max(self.count, 1))


def least_squares(fit: BatchFit) -> np.ndarray:
    """Return the θ, shape (m,), with the least Σ ‖Y_f θ − τ_f‖² over a whole span.

    Columns are scaled to length one; directions that no pair determines stay zero.
    """
    rows = np.concatenate(list(fit.factor()))
    columns, target = rows[:, :-1], rows[:, -1]
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0.0] = 1.0
    solution: np.ndarray = np.linalg.lstsq(columns / scale, target, rcond=1e-10)[0] / scale
    return solution
