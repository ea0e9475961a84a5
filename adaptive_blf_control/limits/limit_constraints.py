# SPDX-License-Identifier: Apache-2.0
"""What the filter keeps, as constraints: their margins are published, reported and watched."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.control.constraints import Bounded, MotionState
from adaptive_blf_control.limits.filter_step import Scene
from adaptive_blf_control.limits.link_spheres import sphere_centres
from adaptive_blf_control.limits.obstacles import distance

__all__ = ['ClearanceConstraint', 'VelocityConstraint']


class VelocityConstraint:
    """q̇ within the largest velocities."""

    name, quantity, unit = 'speed', 'velocity', 'rad/s'
    whole_runs = True
    recovery = 'slow down, or raise controller.limits.velocity'

    def __init__(self, joints: tuple[str, ...], speed: np.ndarray) -> None:
        """Take the joints and their largest velocities, shape (n,) [rad/s]."""
        self.bodies = joints
        self._speed = speed

    def bounded(self, state: MotionState) -> Bounded:
        """Return the velocities with their bounds."""
        return Bounded(state.qd, -self._speed, self._speed)


class ClearanceConstraint:
    """The distance of the nearest sphere of a link from each obstacle."""

    name, quantity, unit = 'clearance', 'distance', 'm'
    recovery = 'move the arm away by hand, or change controller.limits.obstacles'

    def __init__(self, scene: Scene) -> None:
        """Take spheres and obstacles."""
        self.bodies = tuple(f'obstacle{k + 1}' for k in range(scene.obstacles.radius.size))
        self._scene = scene

    def bounded(self, state: MotionState) -> Bounded:
        """Return the distances, bounded from below by zero."""
        chain, spheres, obstacles = self._scene
        points = sphere_centres(chain, spheres, np.ascontiguousarray(state.q))
        normal = np.empty(3)
        least = np.array([min(distance(obstacles, k, point, normal) - radius
                              for point, radius in zip(points, spheres.radius))
                          for k in range(obstacles.radius.size)])
        return Bounded(least, np.zeros(least.size), np.full(least.size, np.inf))
