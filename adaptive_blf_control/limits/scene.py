# SPDX-License-Identifier: Apache-2.0
"""The spheres on the links and the obstacles that settings describe."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.chain import Chain
from adaptive_blf_control.control.limit_settings import LimitSettings, ObstacleSettings, rows_of
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.limits.filter_look import Scene
from adaptive_blf_control.limits.link_spheres import LinkSpheres
from adaptive_blf_control.limits.obstacles import (
    box,
    capsule,
    half_space,
    joined,
    Obstacles,
    sphere,
)

__all__ = ['given_spheres', 'link_spheres_along', 'obstacles_of', 'own_pairs', 'scene_of',
           'scene_with']

APART = 3  # joints between two links that may touch; closer ones overlap by design
SPACING = 1.0  # distance of neighbouring spheres in units of their radius


def obstacles_of(settings: ObstacleSettings) -> Obstacles:
    """Return the obstacles that settings list; ParameterError where one cannot be."""
    return joined([
        *(sphere(row[:3], row[3]) for row in settings.rows('spheres')),
        *(capsule(row[:3], row[3:6], row[6]) for row in settings.rows('capsules')),
        *(box(row[:3], row[3:]) for row in settings.rows('boxes')),
        *(half_space(row[:3], row[3:]) for row in settings.rows('half_spaces'))])


def link_spheres_along(chain: Chain, radius: float) -> LinkSpheres:
    """Return spheres along the lines from each joint to those it carries; not at the base."""
    bodies, centres = [], []
    for joint in range(chain.parent.size):
        if chain.parent[joint] == 0:
            continue
        end = chain.placement[joint, :, 3]
        count = max(int(np.ceil(np.linalg.norm(end) / (SPACING * radius))), 1)
        for part in np.arange(1, count + 1) / count:
            bodies.append(chain.parent[joint])
            centres.append(part * end)
    bodies.append(chain.parent.size)
    centres.append(np.zeros(3))
    return LinkSpheres(np.array(bodies, dtype=np.int64), np.array(centres),
                       np.full(len(bodies), radius))


def scene_of(arm: Arm, settings: LimitSettings) -> Scene:
    """Return spheres and obstacles.

    Raises:
        ParameterError: obstacles are given for an arm without a chain, or a sphere belongs to no
            joint of it.
    """
    obstacles = obstacles_of(settings.obstacles)
    chain = getattr(getattr(arm, 'chain', None), 'chain', None)
    none = LinkSpheres(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0))
    if chain is None:
        if obstacles.radius.size:
            raise ParameterError('controller.limits.obstacles', settings.obstacles.values(),
                                 f'an arm from a URDF: {type(arm).__name__} has no geometry')
        no_pairs = np.zeros((0, 2), dtype=np.int64)
        return Scene(_no_chain(arm.n), none, obstacles, no_pairs, no_pairs)
    name, value = 'controller.limits.link_spheres', settings.link_spheres
    spheres = (given_spheres(name, value, chain, arm.n) if rows_of(name, value, 5)
               else link_spheres_along(chain, settings.link_radius))
    return _scene(chain, spheres, obstacles, settings)


def given_spheres(name: str, value: np.ndarray, chain: Chain, n: int) -> LinkSpheres:
    """Return the spheres of a list: joint from 1, x, y, z in the frame of its link, radius.

    Raises:
        ParameterError: a row lacks numbers, or a sphere belongs to none of the n joints.
    """
    rows = np.array(rows_of(name, value, 5))
    joints = rows[:, 0]
    if not np.isin(joints, np.arange(1, n + 1)).all() or not (rows[:, 4] > 0.0).all():
        raise ParameterError(name, rows.tolist(), f'joints from 1 to {n} and radii > 0 m')
    body = np.array([1 + int(np.flatnonzero(chain.place == joint - 1)[0]) for joint in joints])
    return LinkSpheres(body, rows[:, 1:4].copy(), rows[:, 4].copy())


def _scene(chain: Chain, spheres: LinkSpheres, obstacles: Obstacles,
           settings: LimitSettings) -> Scene:
    own = own_pairs(chain, spheres)
    return scene_with(chain, spheres, obstacles, own if settings.self_collision else own[:0])


def scene_with(chain: Chain, spheres: LinkSpheres, obstacles: Obstacles,
               own: np.ndarray) -> Scene:
    """Return spheres with obstacles, each pair of which may come close, and pairs of spheres."""
    count, most = spheres.body.size, obstacles.radius.size
    pairs = np.stack(np.meshgrid(np.arange(count), np.arange(most), indexing='ij'), axis=-1)
    flat = pairs.reshape(-1, 2).astype(np.int64)
    moves = np.isin(flat[:, 1], np.flatnonzero(obstacles.velocity.any(axis=1)))
    return Scene(chain, spheres, obstacles, np.concatenate([flat[~moves], own]), flat[moves])


def own_pairs(chain: Chain, spheres: LinkSpheres) -> np.ndarray:
    """Return the pairs of spheres with `APART` joints or more between them, see `Scene`."""
    def above(body: int) -> list[int]:
        return [] if body == 0 else [body, *above(int(chain.parent[body - 1]))]

    ways = [set(above(int(body))) for body in spheres.body]
    pairs = [(s, -1 - k) for s in range(len(ways)) for k in range(s)
             if len(ways[s] ^ ways[k]) >= APART]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _no_chain(n: int) -> Chain:
    return Chain(np.zeros((n, 3, 4)), np.zeros((n, 3)), np.zeros(n, dtype=bool),
                 np.zeros(n, dtype=np.intp), np.arange(n), np.zeros(3))
