# SPDX-License-Identifier: Apache-2.0
"""Obstacles that somebody else sees: where they are, how fast they move, and when that was.

An obstacle is known by a key until it is taken away. Its velocity is the slope of the line through
the places where it was seen within `WINDOW` (least squares), and none where that is slower than
what stands may seem to be; it does not turn. Where nothing was heard for a timeout the obstacles
stay where they were seen last, at rest, and the reference is to wait.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.control.limit_settings import ObstacleSettings
from adaptive_blf_control.limits.obstacles import joined, Obstacles

__all__ = ['MovingObstacles']

WINDOW = 0.2
"""How long a place where an obstacle was seen counts for its velocity [s]."""
SHORTEST, LONGEST = 1e-3, 1.0
"""Times between two sights from which a velocity is taken [s]."""


class _Sight(NamedTuple):
    """An obstacle as it was seen at ``t`` [s], with the places before, each (t, x, y, z)."""

    obstacle: Obstacles
    t: float
    places: tuple[tuple[float, ...], ...]


class MovingObstacles:
    """What is known of obstacles that move.

    Attributes:
        heard: When the last message came [s]; None before the first.
    """

    def __init__(self, settings: ObstacleSettings) -> None:
        """Take the largest and the least velocity of an obstacle and the timeout."""
        self._settings = settings
        self._seen: dict[Hashable, _Sight] = {}
        self.heard: float | None = None

    def retuned(self, settings: ObstacleSettings) -> MovingObstacles:
        """Return what knows the same, with other settings."""
        other = MovingObstacles(settings)
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
        self._seen = {**kept, **{key: self._sight(before.get(key), obstacle, t)
                                 for key, obstacle in seen.items()}}
        self.heard = t

    def _sight(self, before: _Sight | None, obstacle: Obstacles, t: float) -> _Sight:
        """Return the obstacle with the velocity since it was seen before."""
        place = (t, *obstacle.centre[0].tolist())
        if before is None or not SHORTEST <= t - before.t <= LONGEST:
            return _Sight(obstacle, t, (place,))
        last = before.places[-1:]
        places = (*(each for each in before.places[:-1] if t - each[0] <= WINDOW), *last, place)
        velocity = _slope(np.array(places))
        size = float(np.linalg.norm(velocity))
        part = min(1.0, self._settings.speed / max(size, 1e-12))
        if size < self._settings.least_speed:
            part = 0.0
        return _Sight(obstacle._replace(velocity=part * velocity[None]), t, places)

    def silent(self, t: float) -> bool:
        """Whether something is known but nothing was heard for too long at ``t`` [s].

        A clock that was set back says nothing of how long that is: it counts as too long.
        """
        return bool(self._seen) and self.heard is not None and (
            abs(t - self.heard) > self._settings.timeout)

    def at(self, t: float) -> Obstacles:
        """Return where they are at ``t`` [s], carried on from where they were seen."""
        if self.silent(t):
            return joined([sight.obstacle._replace(velocity=np.zeros((1, 3)))
                           for sight in self._seen.values()])
        return joined([sight.obstacle._replace(
            centre=sight.obstacle.centre + (t - sight.t) * sight.obstacle.velocity)
            for sight in self._seen.values()])


def _slope(places: np.ndarray) -> np.ndarray:
    """Return the slope of the line through places, (N, 4) with t first → (3,) [m/s]."""
    off = places - places.mean(axis=0)
    return np.asarray(off[:, 0] @ off[:, 1:] / (off[:, 0] @ off[:, 0]))
