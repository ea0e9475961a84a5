# SPDX-License-Identifier: Apache-2.0
"""Obstacles that somebody else sees: where they are, how fast they move, and when that was.

An obstacle is known by a key until it is taken away. Its velocity is that between the two last
times it was seen, no larger than ``speed``; it does not turn. Where nothing was heard for
``timeout`` the obstacles stay where they were seen last, at rest, and the reference is to wait.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.limits.obstacles import joined, Obstacles

__all__ = ['MovingObstacles']

SHORTEST, LONGEST = 1e-3, 1.0
"""Times between two sights from which a velocity is taken [s]."""


class _Sight(NamedTuple):
    """An obstacle as it was seen at ``t`` [s]."""

    obstacle: Obstacles
    t: float


class MovingObstacles:
    """What is known of obstacles that move.

    Attributes:
        heard: When the last message came [s]; None before the first.
    """

    def __init__(self, speed: float, timeout: float) -> None:
        """Take the largest velocity of an obstacle [m/s], and the timeout [s]."""
        self._speed, self._timeout = speed, timeout
        self._seen: dict[Hashable, _Sight] = {}
        self.heard: float | None = None

    def retuned(self, speed: float, timeout: float) -> MovingObstacles:
        """Return what knows the same, with another largest velocity and timeout."""
        other = MovingObstacles(speed, timeout)
        other._seen, other.heard = self._seen, self.heard
        return other

    def update(self, t: float, seen: Mapping[Hashable, Obstacles],
               gone: frozenset[Hashable] | None = frozenset()) -> None:
        """Take a message.

        Args:
            t: When it was heard [s].
            seen: Single obstacles by key.
            gone: Keys of those that are taken away; None for all that were there before.
        """
        before = self._seen
        kept = {} if gone is None else {
            key: sight for key, sight in before.items() if key not in gone}
        self._seen = {**kept, **{key: _Sight(self._moving(before.get(key), obstacle, t), t)
                                 for key, obstacle in seen.items()}}
        self.heard = t

    def _moving(self, before: _Sight | None, obstacle: Obstacles, t: float) -> Obstacles:
        """Return the obstacle with the velocity since it was seen before."""
        if before is None or not SHORTEST <= t - before.t <= LONGEST:
            return obstacle
        velocity = (obstacle.centre - before.obstacle.centre) / (t - before.t)
        size = float(np.linalg.norm(velocity))
        return obstacle._replace(velocity=velocity * min(1.0, self._speed / max(size, 1e-12)))

    def silent(self, t: float) -> bool:
        """Whether something is known but nothing was heard for too long at ``t`` [s].

        A clock that was set back says nothing of how long that is: it counts as too long.
        """
        return bool(self._seen) and self.heard is not None and (
            abs(t - self.heard) > self._timeout)

    def at(self, t: float) -> Obstacles:
        """Return where they are at ``t`` [s], carried on from where they were seen."""
        if self.silent(t):
            return joined([sight.obstacle._replace(velocity=np.zeros((1, 3)))
                           for sight in self._seen.values()])
        return joined([sight.obstacle._replace(
            centre=sight.obstacle.centre + (t - sight.t) * sight.obstacle.velocity)
            for sight in self._seen.values()])
