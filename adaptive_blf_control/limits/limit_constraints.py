# SPDX-License-Identifier: Apache-2.0
"""What the filter keeps, as constraints: their margins are published, reported and watched."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.control.constraints import Bounded, MotionState
from adaptive_blf_control.limits.filter_look import Scene
from adaptive_blf_control.limits.stop_clearance import least_clearance

__all__ = ['ClearanceConstraint', 'FARTHEST', 'VelocityConstraint']

FARTHEST = 10.0
"""Largest distance that is told [m], also where there is no obstacle."""


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
    """The distance of the links from the nearest obstacle, and from each other where asked for.

    It is there without obstacles, too: they may come while the arm moves.
    """

    name, quantity, unit = 'clearance', 'distance', 'm'
    recovery = 'move the arm away by hand, or change controller.limits.obstacles'
    bodies: tuple[str, ...] = ('arm',)

    def __init__(self, scene: Scene) -> None:
        """Take spheres and obstacles; a scene that moves is put in its place as ``scene``."""
        self.scene = scene

    def bounded(self, state: MotionState) -> Bounded:
        """Return the distance, at most `FARTHEST`, bounded from below by zero."""
        scene = self.scene
        pairs = np.concatenate([scene.pairs, scene.coming])
        least = min(FARTHEST, least_clearance(scene.chain, scene.spheres, scene.obstacles, pairs,
                                              np.ascontiguousarray(state.q)))
        return Bounded(np.array([least]), np.zeros(1), np.full(1, np.inf))
