# SPDX-License-Identifier: Apache-2.0
"""An ellipsoid that surely contains θ*, from a prior and the recorded pairs.

The prior, θ* = θ0 + D z with |z|_∞ ≤ 1 and ν columns in D, gives

    (θ* − θ0)ᵀ A0 (θ* − θ0) ≤ 1,   A0 = (ν D Dᵀ + ε² I)⁻¹,

because |z|² ≤ ν: the zonotope of the prior is inside that ellipsoid. What the model cannot explain
of joint i's filtered torque is bounded by δ_i, so that each of the N rows y θ = τ of the recorded
pairs has ((y θ* − τ)/δ)² ≤ 1, and so has their mean. Any convex combination, 1 − λ of the first
and λ of the second, is an ellipsoid around θ*:

    (θ* − θc)ᵀ A (θ* − θc) ≤ c,    A = (1 − λ) A0 + (λ/N) Σ yᵀy/δ²,
    θc = A⁻¹ [(1 − λ) A0 θ0 + (λ/N) Σ yᵀτ/δ²],
    c = 1 − [(1 − λ) θ0ᵀA0θ0 + (λ/N) Σ τ²/δ² − θcᵀAθc]

(Schweppe, IEEE Transactions on Automatic Control 13, 1968). Nothing here asks how the pairs were
chosen, what the gains are or whether a torque was saturated. A θ* that changes breaks the
assumption; c ≤ 0 proves that some assumption is broken.
"""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.prior import Prior

__all__ = ['ParameterSet', 'support']

WEIGHTS = (0.5, 0.9, 0.99)
"""Values of λ, each of which gives a set that contains θ*; the smallest of the sets is kept."""
ROUNDING = 1e-4
"""ε, part of the largest nominal parameter: keeps A0 regular where D has not full rank."""


@jit
def support(rows: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return the largest |a (θ − θc)| over the ellipsoid for each row a, shape (k,).

    Args:
        rows: Shape (k, m).
        root: √c L⁻ᵀ of A = L Lᵀ, shape (m, m).
    """
    k, m = rows.shape
    result = np.empty(k)
    for i in range(k):
        square = 0.0
        for j in range(m):
            value = 0.0
            for p in range(m):
                value += rows[i, p] * root[p, j]
            square += value * value
        result[i] = math.sqrt(square)
    return result


class ParameterSet:
    """The set of θ that prior and data allow.

    Attributes:
        prior: What was known before.
        centre: θc, shape (m,).
        root: √c L⁻ᵀ, shape (m, m): what `support` takes.
    """

    def __init__(self, prior: Prior, unexplained: np.ndarray) -> None:
        """Start with the prior.

        Args:
            prior: Centre and generators.
            unexplained: δ, bound of what the model cannot explain of each joint's filtered
                torque, shape (n,) [N·m].

        Raises:
            ParameterError: a bound is not > 0.
        """
        delta = np.array(unexplained, dtype=float)
        if not (np.isfinite(delta).all() and (delta > 0.0).all()):
            raise ParameterError('unexplained', delta.tolist(), 'finite torques > 0 N*m')
        self.prior = prior
        self._delta = delta
        spread, columns = prior.generators, prior.generators.shape[1]
        rounding = ROUNDING * max(float(np.abs(prior.centre).max()), 1e-12)
        self._information = np.linalg.inv(columns * spread @ spread.T
                                          + rounding ** 2 * np.eye(spread.shape[0]))
        self.reset()

    def reset(self) -> None:
        """Forget the data: θ* may have changed."""
        self._take(self._information, 1.0, self.prior.centre)

    def _take(self, matrix: np.ndarray, level: float, centre: np.ndarray) -> None:
        self.centre = centre
        lower = np.linalg.cholesky(matrix)
        self.root = math.sqrt(level) * np.linalg.inv(lower).T.copy()

    @property
    def size(self) -> float:
        """Geometric mean of the semi-axes, in units of θ."""
        _, logarithm = np.linalg.slogdet(self.root)
        return math.exp(logarithm / self.root.shape[0])

    def half_widths(self) -> np.ndarray:
        """Return how far the set reaches from its centre in each parameter, shape (m,)."""
        widths: np.ndarray = np.linalg.norm(self.root, axis=1)
        return widths

    def update(self, regressors: np.ndarray, torques: np.ndarray) -> bool:
        """Take all recorded pairs in place of those of before.

        Args:
            regressors: Y_f of each pair, shape (P, n, m).
            torques: τ_f, shape (P, n) [N·m].

        Returns:
            False where the data contradict prior or δ; the set is then the prior.
        """
        if not len(torques):
            self.reset()
            return True
        m = self.prior.centre.size
        rows = (regressors / self._delta[None, :, None]).reshape(-1, m)
        values = (torques / self._delta).reshape(-1)
        gram, moment, square = rows.T @ rows, values @ rows, values @ values
        candidates = [self._combined(weight, gram, moment, square, values.size)
                      for weight in WEIGHTS]
        if any(level <= 0.0 for _, level, _ in candidates):
            self.reset()
            return False
        matrix, level, centre = min(candidates, key=_logarithmic_volume)
        self._take(matrix, level, centre)
        return True

    def _combined(self, weight: float, gram: np.ndarray, moment: np.ndarray, square: float,
                  count: int) -> tuple[np.ndarray, float, np.ndarray]:
        """Return A, c and θc of one convex combination; torques are taken relative to θ0."""
        start = self.prior.centre
        matrix = (1.0 - weight) * self._information + weight / count * gram
        shift = np.linalg.solve(matrix, weight / count * (moment - gram @ start))
        rest = square - 2.0 * moment @ start + start @ gram @ start
        level = 1.0 - (weight / count * rest - shift @ matrix @ shift)
        return matrix, float(level), start + shift

    def support(self, rows: np.ndarray) -> np.ndarray:
        """Return a bound of |a (θ* − centre)| for each row a of shape (k, m), shape (k,)."""
        if self.centre is self.prior.centre:  # no data: the ellipsoid is around the zonotope
            return self.prior.support(rows)
        from_prior = self.prior.support(rows) + np.abs(rows @ (self.centre - self.prior.centre))
        return np.minimum(support(np.ascontiguousarray(rows), self.root), from_prior)

    def contains(self, theta: np.ndarray) -> bool:
        """Whether θ, shape (m,), is in the ellipsoid."""
        return bool(np.linalg.norm(np.linalg.solve(self.root, theta - self.centre)) <= 1.0 + 1e-9)


def _logarithmic_volume(candidate: tuple[np.ndarray, float, np.ndarray]) -> float:
    matrix, level, _ = candidate
    _, logarithm = np.linalg.slogdet(matrix)
    return matrix.shape[0] * math.log(level) - float(logarithm)
