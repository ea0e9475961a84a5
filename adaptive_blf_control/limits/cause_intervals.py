# SPDX-License-Identifier: Apache-2.0
"""Between which values each cause of a prior is, for every θ* that prior and recorded pairs allow.

With θ* = θ0 + D z each row of the recorded pairs says a z = b + e, with a = y D, b = τ − y θ0 and
|e| ≤ δ, δ being what the model cannot explain of that joint's filtered torque. For any weights λ
of the rows, r being what A λ leaves of the axis u_j of one cause,

    z_j = λ (b + e) + r z,   r = u_j − Aᵀ λ,   so that   |z_j − λ b − r c| ≤ |λ| δ + |r| h

where z is known to be in c ± h. That is the dual of the linear program which looks for the largest
and the smallest z_j (Milanese and Vicino, Automatica 27, 1991). It holds for every λ, the best one
or not, so that no solver has to be trusted. What was found once stays: pairs that are recorded no
more were right, too.

A good λ is found by least squares, weighted again with |r|/h and, because an end of the interval
lies at ±λ (b − A c) + |λ| δ + |r| h from c, with |λ| over δ ± (b − A c).

The set is a box in z, which is the prior's own zonotope made narrower, so that what relies on the
prior can rely on it as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.limits.prior import Prior

__all__ = ['CauseBounds', 'CauseIntervals']

PASSES = 4  # of weighted least squares for one end of an interval
AT_ONCE = 1  # causes that are looked at closely with one update, in turn
LEAST_PART = 1e-6  # of the largest weight, so that none is lost for good
NARROW = 1e-9  # half widths below this are taken for it
LEAST_COST = 0.05  # of a row, in units of δ: one that excludes the centre costs nothing
ROUNDING = 1e-9  # by which an interval may be empty without a contradiction


class CauseBounds(NamedTuple):
    """What is known of each cause of a prior, in its own unit.

    Attributes:
        names: Of the causes, see `Cause`.
        least: Smallest values, shape (ν,).
        most: Largest values, shape (ν,).
    """

    names: tuple[str, ...]
    least: np.ndarray
    most: np.ndarray


class CauseIntervals:
    """The box of z that holds z*, for a constant θ*.

    Attributes:
        prior: What was known before.
        least: Smallest z, shape (ν,).
        most: Largest z, shape (ν,).
    """

    def __init__(self, prior: Prior, unexplained: np.ndarray) -> None:
        """Start with the prior.

        Args:
            prior: With its causes.
            unexplained: δ, bound of what the model cannot explain of each joint's filtered
                torque, shape (n,) [N·m], > 0.
        """
        self.prior = prior
        self._delta = np.array(unexplained, dtype=float)
        self._turn = 0
        self.reset()

    def reset(self) -> None:
        """Forget the pairs: θ* may have changed."""
        count = self.prior.generators.shape[1]
        self.least, self.most = -np.ones(count), np.ones(count)

    def update(self, regressors: np.ndarray, torques: np.ndarray) -> bool:
        """Take the recorded pairs.

        Args:
            regressors: Y_f of each pair, shape (P, n, m).
            torques: τ_f, shape (P, n) [N·m].

        Returns:
            False where they contradict what was known; the box is then that of the prior.
        """
        if not len(torques):
            return True
        prior = self.prior
        rows = regressors.reshape(-1, prior.centre.size) @ prior.generators
        values = (torques - regressors @ prior.centre).reshape(-1)
        delta = np.tile(self._delta, len(torques))
        self._narrow_all(rows, values, delta)
        for _ in range(min(AT_ONCE, self.least.size)):
            self._narrow_one(self._turn, rows, values, delta)
            self._turn = (self._turn + 1) % self.least.size
        if (self.least <= self.most + ROUNDING).all():
            np.minimum(self.least, self.most, out=self.least)
            return True
        self.reset()
        return False

    def bounds(self) -> CauseBounds:
        """Return the box in the units of the causes."""
        causes = self.prior.causes
        middle = np.array([cause.middle for cause in causes])
        half = np.array([cause.half for cause in causes])
        return CauseBounds(tuple(cause.name for cause in causes), middle + half * self.least,
                           middle + half * self.most)

    def _box(self) -> tuple[np.ndarray, np.ndarray]:
        """Return c and h of the box, (ν,) each."""
        return (0.5 * (self.least + self.most),
                np.maximum(0.5 * (self.most - self.least), NARROW))

    def _narrow_all(self, rows: np.ndarray, values: np.ndarray, delta: np.ndarray) -> None:
        """Narrow every interval by one pass of least squares, weighted with 1/δ² and 1/h²."""
        centre, half = self._box()
        weighted = rows.T / delta ** 2
        weights = np.linalg.solve(weighted @ rows + np.diag(1.0 / half ** 2), weighted)
        rest = np.eye(half.size) - weights @ rows
        middle = weights @ values + rest @ centre
        reach = np.abs(weights) @ delta + np.abs(rest) @ half
        self.least = np.maximum(self.least, middle - reach)
        self.most = np.minimum(self.most, middle + reach)

    def _narrow_one(self, j: int, rows: np.ndarray, values: np.ndarray,
                    delta: np.ndarray) -> None:
        """Narrow each end of the interval of cause ``j`` with the best λ that some passes find."""
        for side in (1.0, -1.0):
            centre, half = self._box()
            beyond = side * (values - rows @ centre)
            costs = np.maximum(delta + beyond, LEAST_COST * delta), np.maximum(
                delta - beyond, LEAST_COST * delta)
            axis = np.zeros(half.size)
            axis[j] = 1.0
            of_rows, of_rest = 1.0 / delta ** 2, 1.0 / half ** 2
            for _ in range(PASSES):
                weights = of_rows * (rows @ np.linalg.solve(
                    (rows.T * of_rows) @ rows + np.diag(of_rest), axis))
                rest = axis - weights @ rows
                middle = float(weights @ values + rest @ centre)
                reach = float(np.abs(weights) @ delta + np.abs(rest) @ half)
                self.least[j] = max(self.least[j], middle - reach)
                self.most[j] = min(self.most[j], middle + reach)
                size = np.abs(weights)
                of_rows = (np.maximum(size, LEAST_PART * size.max())
                           / np.where(weights > 0.0, *costs))
                of_rest = np.maximum(np.abs(rest), LEAST_PART) / half
