# SPDX-License-Identifier: Apache-2.0
"""What a motion is to be good for: parameters that are told apart, and told well.

Of G = Σ YᵀY / σ² over the samples of a motion, with columns scaled to length one,
R = D^-½ G D^-½,

    J = ½ log tr R⁻² − w log det G / (2m),    w = ½.

The first part follows the largest variance of what cannot be told apart, 1/λ_min(R), and so the
condition of the regressors, √(λ_max/λ_min), as λ_max ≤ m; but smoothly. It does not see how large
the columns are, so that slow motions would do. The second is the mean of the logarithm of the
standard deviations, the D-optimal criterion, which the choice of parameters does not change.
"""

from __future__ import annotations

import numpy as np

__all__ = ['condition', 'criterion']

_WEIGHT = 0.5  # w: with 1 standard deviations are a fifth smaller, conditions a fifth larger
_FLOOR = 1e-10  # of eigenvalues of R: rounding


def _normalised(gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size = np.maximum(np.diag(gram), 1e-300)
    return gram / np.sqrt(np.outer(size, size)), size


def condition(gram: np.ndarray) -> float:
    """Return the condition of the stacked regressors with columns of length one.

    Args:
        gram: G, shape (m, m).

    Returns:
        Ratio of their largest to their smallest singular value, as `identify` prints it; infinity
        where a direction is not shown at all.
    """
    values = np.linalg.eigvalsh(_normalised(gram)[0])
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 0.0 else float('inf')


def criterion(gram: np.ndarray) -> tuple[float, np.ndarray]:
    """Return J and its gradient dJ/dG, shape (m, m).

    Args:
        gram: G, shape (m, m).
    """
    scaled, size = _normalised(gram)
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, _FLOOR)
    trace = float(np.sum(values ** -2.0))
    share = _WEIGHT / (2.0 * size.size)
    log_det = float(np.sum(np.log(values)) + np.sum(np.log(size)))
    slope = -(vectors * (values ** -3.0 / trace)) @ vectors.T
    part = np.sqrt(np.outer(size, size))
    gradient = slope / part - np.diag(np.sum(slope * scaled, axis=1) / size)
    gradient -= share * (vectors / values) @ vectors.T / part
    return 0.5 * float(np.log(trace)) - share * log_det, gradient
