# SPDX-License-Identifier: Apache-2.0
"""Random scenes of ``bench limits``: obstacles in the way of an arm, and one that comes to it.

The arm rests at the start, and every obstacle is `CLEAR` of it: it can brake there.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import (
    apply_changes,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.control.limit_settings import LimitSettings
from adaptive_blf_control.control.reference import Reference
from adaptive_blf_control.limits.filter_look import Scene
from adaptive_blf_control.limits.link_spheres import sphere_centres
from adaptive_blf_control.limits.scene import scene_of

__all__ = ['CLEAR', 'crossing', 'moving_sphere', 'MovingSphere', 'random_scene']

CLEAR = 0.06  # of the start, more than which is asked of a random scene [m]


class MovingSphere(NamedTuple):
    """A sphere on a straight line.

    Attributes:
        begin: Where its centre is at the begin, shape (3,) [m].
        velocity: Shape (3,) [m/s].
        radius: Of the sphere [m].
    """

    begin: np.ndarray
    velocity: np.ndarray
    radius: float

    def at(self, t: float) -> np.ndarray:
        """Return its centre at ``t`` [s], shape (3,) [m]."""
        return self.begin + t * self.velocity


def random_scene(config: Path, seed: int) -> Mapping[str, Any]:
    """Return a table and up to three spheres in the way of the Panda, clear of its start."""
    arm, reference, spheres = _passing(config)
    random = np.random.default_rng(1000 + seed)
    return crossing(arm, reference, random.uniform(-0.1, 0.2), spheres, random,
                     count=int(random.integers(1, 4)))


def moving_sphere(config: Path, seed: int, slowest: float, fastest: float) -> MovingSphere:
    """Return a sphere that crosses the way of the Panda when that is there, 3 to 8 s on.

    It comes horizontally from any side, at ``slowest`` to ``fastest`` [m/s], and is clear of the
    arm's start when that starts.
    """
    arm, reference, spheres = _passing(config)
    random = np.random.default_rng(2000 + seed)
    given = _scene_with(arm, spheres)
    start = sphere_centres(given.chain, given.spheres, reference.at(0.0).position)
    while True:
        when, angle = random.uniform(3.0, 8.0), random.uniform(-np.pi, np.pi)
        there = sphere_centres(given.chain, given.spheres, reference.at(when).position)
        centre = there[random.integers(there.shape[0] // 2, there.shape[0])]
        velocity = random.uniform(slowest, fastest) * np.array([np.cos(angle), np.sin(angle), 0.0])
        moving = MovingSphere(centre - when * velocity, velocity, random.uniform(0.04, 0.1))
        apart = np.linalg.norm(start - moving.begin, axis=1) - given.spheres.radius
        if apart.min() - moving.radius > CLEAR:
            return moving


def _passing(config: Path) -> tuple[Any, Reference, list[float]]:
    """Return arm, reference and link spheres of the Panda beside obstacles."""
    data = load_yaml(config / 'panda_obstacles.yaml')
    loop = build_closed_loop(apply_changes(data, {'controller.safety_filter': 'none'}))
    settings = node_settings(data, ControllerNodeSettings).limits
    return loop.arm, loop.controller.reference, settings.link_spheres.tolist()


def crossing(arm: Any, reference: Reference, table: float, spheres: Any,
              random: np.random.Generator, count: int = 1) -> dict[str, Any]:
    """Return obstacles near what the links of an arm pass, and clear of where they start."""
    given = _scene_with(arm, spheres)
    chain, links = given.chain, given.spheres
    start = sphere_centres(chain, links, reference.at(0.0).position)
    rows: list[float] = []
    while len(rows) < 4 * count:
        centres = sphere_centres(chain, links, reference.at(random.uniform(1.5, 8.0)).position)
        centre = centres[random.integers(centres.shape[0] // 2, centres.shape[0])]
        centre = centre + random.normal(0.0, 0.05, 3)
        radius = random.uniform(0.04, 0.12)
        apart = np.linalg.norm(start - centre, axis=1) - links.radius - radius
        if apart.min() > CLEAR and centre[2] > table:
            rows += [*centre.tolist(), radius]
    low = (start[:, 2] - links.radius).min() - CLEAR
    return {'controller.limits.obstacles.spheres': rows,
            'controller.limits.obstacles.half_spaces': [0.0, 0.0, min(table, low), 0.0, 0.0, 1.0]}


def _scene_with(arm: Any, spheres: Any) -> Scene:
    """Return the link spheres of an arm, without obstacles."""
    limits = {'link_spheres': spheres} if spheres else {}
    return scene_of(arm, LimitSettings(**limits).resolved(joints=arm.n))
