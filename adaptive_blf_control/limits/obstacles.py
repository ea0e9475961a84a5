# SPDX-License-Identifier: Apache-2.0
"""Convex obstacles, and how far a point is from them.

One form serves all: the points closer than ``radius`` to a box with half-sides ``half`` in the
obstacle's frame. A sphere has half-sides (0, 0, 0), a capsule (0, 0, l/2), a box radius 0; a
half-space is a box that is large in all directions, with its face at the origin of its frame.

The distance of a point p from such a set is convex in p. With the unit vector u from the nearest
point of the obstacle to p, ḣ = uᵀ(v − v_o), and ḧ = uᵀ(a − a_o) + κ with κ ≥ 0 by convexity:
leaving κ out can only make the rows that follow stricter.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import jit
from adaptive_blf_control.errors import ParameterError

__all__ = ['box', 'capsule', 'distance', 'frame_along', 'half_space', 'joined', 'Obstacles',
           'sphere']

EXTENT = 100.0
"""Half-sides of a half-space [m]: beyond the reach of any arm."""


class Obstacles(NamedTuple):
    """k convex obstacles.

    Attributes:
        rotation: Axes of each obstacle's frame as columns, in the base's frame, shape (k, 3, 3).
        centre: Origin of its frame, shape (k, 3) [m].
        half: Half-sides of its core, shape (k, 3) [m].
        radius: Shape (k,) [m].
        velocity: Of its centre; it does not turn, shape (k, 3) [m/s].
    """

    rotation: np.ndarray
    centre: np.ndarray
    half: np.ndarray
    radius: np.ndarray
    velocity: np.ndarray


def _vector(name: str, value: Sequence[float]) -> np.ndarray:
    array = np.array(value, dtype=float)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise ParameterError(name, value, 'three finite numbers')
    return array


def _length(name: str, value: float, positive: bool = True) -> float:
    if not math.isfinite(value) or value < 0.0 or (positive and value == 0.0):
        raise ParameterError(name, value, 'a finite length > 0 m')
    return float(value)


def frame_along(normal: np.ndarray) -> np.ndarray:
    """Return a rotation whose third column is ``normal``, a unit vector, shape (3, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(helper, normal)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first), normal])


def _one(rotation: np.ndarray, centre: np.ndarray, half: np.ndarray, radius: float,
         velocity: Sequence[float]) -> Obstacles:
    return Obstacles(rotation[None], centre[None], half[None], np.array([radius]),
                     _vector('velocity', velocity)[None])


def sphere(centre: Sequence[float], radius: float,
           velocity: Sequence[float] = (0.0, 0.0, 0.0)) -> Obstacles:
    """Return a sphere [m]."""
    return _one(np.eye(3), _vector('sphere.centre', centre), np.zeros(3),
                _length('sphere.radius', radius), velocity)


def capsule(start: Sequence[float], end: Sequence[float], radius: float,
            velocity: Sequence[float] = (0.0, 0.0, 0.0)) -> Obstacles:
    """Return the points closer than ``radius`` to a line from ``start`` to ``end`` [m]."""
    first, last = _vector('capsule.start', start), _vector('capsule.end', end)
    length = float(np.linalg.norm(last - first))
    if length == 0.0:
        raise ParameterError('capsule.end', list(end), 'another point than its start')
    return _one(frame_along((last - first) / length), 0.5 * (first + last),
                np.array([0.0, 0.0, 0.5 * length]), _length('capsule.radius', radius), velocity)


def box(centre: Sequence[float], sides: Sequence[float], rotation: np.ndarray | None = None,
        velocity: Sequence[float] = (0.0, 0.0, 0.0)) -> Obstacles:
    """Return a box with the given sides along the columns of ``rotation``, shape (3, 3) [m]."""
    half = 0.5 * _vector('box.sides', sides)
    if not (half > 0.0).all():
        raise ParameterError('box.sides', list(sides), 'lengths > 0 m')
    axes = np.eye(3) if rotation is None else np.array(rotation, dtype=float)
    if axes.shape != (3, 3) or np.abs(axes.T @ axes - np.eye(3)).max() > 1e-6:
        raise ParameterError('box.rotation', axes.tolist(), 'a rotation matrix')
    return _one(axes, _vector('box.centre', centre), half, 0.0, velocity)


def half_space(point: Sequence[float], normal: Sequence[float],
               velocity: Sequence[float] = (0.0, 0.0, 0.0)) -> Obstacles:
    """Return all behind the plane through ``point`` whose ``normal`` points to the free side."""
    outward = _vector('half_space.normal', normal)
    if np.linalg.norm(outward) == 0.0:
        raise ParameterError('half_space.normal', list(normal), 'a vector other than zero')
    axes = frame_along(outward / np.linalg.norm(outward))
    centre = _vector('half_space.point', point) - EXTENT * axes[:, 2]
    return _one(axes, centre, np.full(3, EXTENT), 0.0, velocity)


def joined(obstacles: Sequence[Obstacles]) -> Obstacles:
    """Return several obstacles as one table; none is allowed."""
    if not obstacles:
        return Obstacles(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty((0, 3)), np.empty(0),
                         np.empty((0, 3)))
    return Obstacles(*(np.concatenate(columns) for columns in zip(*obstacles)))


@jit
def distance(obstacles: Obstacles, k: int, point: np.ndarray, normal: np.ndarray) -> float:
    """Return the distance of a point from obstacle k [m], negative inside.

    Args:
        obstacles: All obstacles.
        k: Which of them.
        point: Shape (3,) [m].
        normal: Shape (3,); the unit vector of steepest ascent of the distance is written into it.
    """
    local, beyond = np.empty(3), np.empty(3)
    outside, deepest = 0.0, -np.inf
    axis = 0
    for c in range(3):
        local[c] = 0.0
        for r in range(3):
            local[c] += obstacles.rotation[k, r, c] * (point[r] - obstacles.centre[k, r])
        over = abs(local[c]) - obstacles.half[k, c]
        beyond[c] = max(over, 0.0) * (1.0 if local[c] >= 0.0 else -1.0)
        outside += beyond[c] * beyond[c]
        if over > deepest:
            deepest, axis = over, c
    length = math.sqrt(outside)
    scale = 1.0 / length if length > 0.0 else 1.0
    if length == 0.0:  # inside the core: out through the nearest face
        beyond[axis] = 1.0 if local[axis] >= 0.0 else -1.0
    for r in range(3):
        normal[r] = 0.0
        for c in range(3):
            normal[r] += obstacles.rotation[k, r, c] * beyond[c] * scale
    return (length if length > 0.0 else deepest) - obstacles.radius[k]
