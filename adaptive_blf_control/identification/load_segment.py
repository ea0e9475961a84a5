# SPDX-License-Identifier: Apache-2.0
"""A stretch of time in which the load is the same, as sums over blocks of time.

Whether it is the same is a generalised likelihood ratio test (Basseville and Nikiforov, Detection
of Abrupt Changes, 1993, 2.4.3): two loads, one before and one after some block, explain the
torques better than one. The block with the largest ratio is where the load has changed.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.base_parameters import PER_BODY

__all__ = ['LoadSegment']

_MOST = 160  # blocks that are kept apart; then the older half is merged in pairs
_RECENT = 16  # blocks within which a change is looked for
_LEAST = 2  # blocks from which another load can be told


class LoadSegment:
    """Sums of blocks, each with its length in time.

    Attributes:
        begin: When it began [s].
        total: Sums over all of it, shape (n, 11, 11).
        seconds: Length of the data in it [s].
    """

    def __init__(self, n: int, begin: float) -> None:
        """Begin, for an arm of n joints, at ``begin`` [s]."""
        self.begin = begin
        self.total = np.zeros((n, PER_BODY + 1, PER_BODY + 1))
        self.seconds = 0.0
        self._blocks: list[np.ndarray] = []
        self._times: list[tuple[float, float]] = []

    def __len__(self) -> int:
        """Return how many blocks there are."""
        return len(self._blocks)

    @property
    def blocks(self) -> np.ndarray:
        """Sums of each block, shape (K, n, 11, 11)."""
        return np.array(self._blocks)

    def add(self, sums: np.ndarray, begin: float, seconds: float) -> None:
        """Add a block that began at ``begin`` [s] with ``seconds`` [s] of data."""
        self._blocks.append(sums)
        self._times.append((begin, seconds))
        self.total += sums
        self.seconds += seconds
        if len(self._blocks) > _MOST:
            self._merge(_MOST // 2)

    def _merge(self, count: int) -> None:
        pairs = range(0, count, 2)
        self._blocks[:count] = [self._blocks[k] + self._blocks[k + 1] for k in pairs]
        self._times[:count] = [(self._times[k][0], self._times[k][1] + self._times[k + 1][1])
                               for k in pairs]

    def begin_of(self, block: int) -> float:
        """Return when a block began [s]."""
        return self._times[block][0]

    def after(self, block: int) -> LoadSegment:
        """Return the segment that begins with a block."""
        result = LoadSegment(len(self.total), self._times[block][0])
        for sums, (begin, seconds) in zip(self._blocks[block:], self._times[block:], strict=True):
            result.add(sums, begin, seconds)
        return result

    def without_first(self) -> LoadSegment:
        """Return the segment without its first block, though it began with it."""
        result = LoadSegment(len(self.total), self.begin)
        for sums, (begin, seconds) in zip(self._blocks[1:], self._times[1:], strict=True):
            result.add(sums, begin, seconds)
        return result

    def attachment(self, weights: np.ndarray, ridge: np.ndarray) -> tuple[int, float]:
        """Return the block with which a load most likely began that was not there before.

        Args:
            weights: 1 / (2 T_j s_j²) per joint, shape (n,) [1/(N²·m²·s)].
            ridge: Inverse covariance of what a load may be, shape (10, 10).

        Returns:
            The block, and twice the logarithm of its likelihood ratio to the first one.
        """
        each = np.einsum('j,kjab->kab', weights, self.blocks)
        behind = np.cumsum(each[::-1], axis=0)[::-1]
        without = np.cumsum(each[:, -1, -1]) - each[:, -1, -1]
        cost = (without + _least(behind, ridge))[:max(len(each) - _LEAST, 1)]
        best = int(np.argmin(cost))
        return best, float(cost[0] - cost[best])

    def change(self, weights: np.ndarray, ridge: np.ndarray) -> tuple[int, float, float]:
        """Return the block with which another load most likely began, and how likely that is.

        Args:
            weights: 1 / (2 T_j s_j²) per joint, shape (n,) [1/(N²·m²·s)].
            ridge: Inverse covariance of what a load may be, shape (10, 10).

        Returns:
            The block, twice the logarithm of the likelihood ratio, and the part of the squared
            residual behind that block that another load removes. The block is 0 where there are
            too few to tell.
        """
        count = len(self._blocks)
        first = max(count - _RECENT, _LEAST)
        if first > count - _LEAST:
            return 0, 0.0, 0.0
        recent = np.einsum('j,kjab->kab', weights, np.array(self._blocks[first:]))
        behind = np.cumsum(recent[::-1], axis=0)[::-1][:len(recent) - _LEAST + 1]
        whole = np.tensordot(weights, self.total, axes=1)
        one, before, after = (_least(each, ridge) for each in (
            whole[None], whole - behind, behind))
        ratio = one - before - after
        best = int(np.argmax(ratio))
        single = np.append(_solve(whole[None], ridge)[0], -1.0)
        error = float(single @ behind[best] @ single)
        return first + best, float(ratio[best]), float(1.0 - after[best] / max(error, 1e-300))


def _solve(sums: np.ndarray, ridge: np.ndarray) -> np.ndarray:
    """Return the ridge estimate of each of K sums, (K, 11, 11) → (K, 10)."""
    return np.linalg.solve(sums[:, :-1, :-1] + ridge, sums[:, :-1, -1:])[..., 0]


def _least(sums: np.ndarray, ridge: np.ndarray) -> np.ndarray:
    """Return the least of squared residual and ridge of each of K sums, (K, 11, 11) → (K,)."""
    best = _solve(sums, ridge)
    return np.asarray(sums[:, -1, -1] - np.sum(best * sums[:, :-1, -1], axis=1))
