# SPDX-License-Identifier: Apache-2.0
"""An open kinematic chain or tree as plain arrays, and where its joints are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.spatial import cross, dot6
from adaptive_blf_control.compiled import borrowed, cos_sin, jit

__all__ = ['Chain', 'Link', 'add_wrench_torque', 'chain_of_model', 'no_chain',
           'placements', 'subtree_ends', 'write_placements']


class Chain(NamedTuple):
    """Kinematics of n one-axis joints in the tree's order: a joint comes after its parent.

    Joint i is row i of every array here and row i + 1 of every array over bodies, whose row 0 is
    the base. The joints of a subtree follow each other.

    Attributes:
        placement: [R p] of each joint's frame in its parent's at joint position zero, shape
            (n, 3, 4) [m].
        axis: Unit vector in the joint's frame, shape (n, 3).
        slides: Whether the joint is prismatic, shape (n,).
        parent: Body row of the parent, shape (n,).
        place: Index in the user's arrays, shape (n,).
        gravity: In the base's frame, shape (3,) [m/s²].
    """

    placement: np.ndarray
    axis: np.ndarray
    slides: np.ndarray
    parent: np.ndarray
    place: np.ndarray
    gravity: np.ndarray


class Link(NamedTuple):
    """A link: the row of the body it is part of, and its origin in that body's frame, (3,) [m]."""

    body: int
    origin: np.ndarray


def chain_of_model(model: Any, names: Sequence[str]) -> Chain:
    """Read the kinematics of a Pinocchio model.

    Args:
        model: Model whose joints are revolute, continuous or prismatic.
        names: The model's joints in the user's order.
    """
    rest = np.zeros(model.nq)
    placed, axes = [], []
    for joint, placement in zip(list(model.joints)[1:], list(model.jointPlacements)[1:],
                                strict=True):
        data = joint.createData()
        joint.calc(data, rest)  # the axis does not depend on the position
        axes.append(np.reshape(data.S, 6))
        placed.append(np.column_stack([placement.rotation, placement.translation]))
    linear, angular = np.hsplit(np.array(axes), 2)
    slides = np.array([not vector.any() for vector in angular])
    return Chain(
        placement=np.array(placed), axis=np.where(slides[:, None], linear, angular),
        slides=slides, parent=np.array(list(model.parents)[1:], dtype=np.intp),
        place=np.array([list(names).index(name) for name in list(model.names)[1:]],
                       dtype=np.intp),
        gravity=np.array(model.gravity.linear, dtype=float))


def no_chain() -> Chain:
    """Return a chain without joints, for arms whose kinematics nobody knows."""
    none = np.zeros(0, dtype=np.intp)
    return Chain(np.zeros((0, 3, 4)), np.zeros((0, 3)), np.zeros(0, dtype=np.bool_), none, none,
                 np.zeros(3))


def subtree_ends(parent: np.ndarray) -> np.ndarray:
    """Return the joint behind the last one that each joint carries, (n,) → (n,)."""
    ends = np.arange(1, parent.size + 1)
    for joint in reversed(range(parent.size)):
        if parent[joint] > 0:
            ends[parent[joint] - 1] = max(ends[parent[joint] - 1], ends[joint])
    return ends


@jit
def placements(chain: Chain, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the bodies and the joint axes are.

    Args:
        chain: The chain.
        q: Joint positions in the user's order, shape (n,) [rad or m].

    Returns:
        [R p] of each body's frame in the world, shape (n + 1, 3, 4), and the axis of each joint
        as the twist (v, ω) of unit speed about the world's origin, shape (n, 6).
    """
    n = chain.parent.size
    frames, axes = np.zeros((n + 1, 3, 4)), np.zeros((n, 6))
    write_placements(chain, q, frames, axes)
    return frames, axes


@jit
def write_placements(chain: Chain, q: np.ndarray, frames: np.ndarray,
                     axes: np.ndarray) -> None:
    """Write `placements` of joint positions q into zeros of the same shapes."""
    chain = borrowed(chain)
    frames[0, 0, 0] = frames[0, 1, 1] = frames[0, 2, 2] = 1.0
    for i in range(chain.parent.size):
        frame, before, step = frames[i + 1], frames[chain.parent[i]], chain.placement[i]
        for r in range(3):
            for c in range(4):
                frame[r, c] = (before[r, 0] * step[0, c] + before[r, 1] * step[1, c]
                               + before[r, 2] * step[2, c])
            frame[r, 3] += before[r, 3]
        _move(frame, axes[i], chain.axis[i], chain.slides[i], q[chain.place[i]])


@jit
def _move(frame: np.ndarray, axis: np.ndarray, local: np.ndarray, slides: bool,
          position: float) -> None:
    """Move a joint's frame from zero to its position, and write its axis as a twist."""
    z = (frame[0, 0] * local[0] + frame[0, 1] * local[1] + frame[0, 2] * local[2],
         frame[1, 0] * local[0] + frame[1, 1] * local[1] + frame[1, 2] * local[2],
         frame[2, 0] * local[0] + frame[2, 1] * local[1] + frame[2, 2] * local[2])
    if slides:
        for r in range(3):
            axis[r] = z[r]
            frame[r, 3] += z[r] * position
        return
    moment = cross((frame[0, 3], frame[1, 3], frame[2, 3]), z)
    for r in range(3):
        axis[r] = moment[r]
        axis[3 + r] = z[r]
    cosine, sine = cos_sin(position)
    for c in range(3):  # Rodrigues: x cos + (z × x) sin + z (z · x)(1 − cos)
        x = (frame[0, c], frame[1, c], frame[2, c])
        turned = cross(z, x)
        along = (z[0] * x[0] + z[1] * x[1] + z[2] * x[2]) * (1.0 - cosine)
        for r in range(3):
            frame[r, c] = x[r] * cosine + turned[r] * sine + z[r] * along


@jit
def add_wrench_torque(torque: np.ndarray, chain: Chain, q: np.ndarray, body: int,
                      point: np.ndarray, wrench: np.ndarray) -> None:
    """Add what a force and a moment on a body do to the joints, Jᵀ (f, m).

    Args:
        torque: Is added to, in the user's order, shape (n,) [N·m or N].
        chain: The chain.
        q: Joint positions in the user's order, shape (n,) [rad or m].
        body: Body row; 0, the base, moves no joint.
        point: Where the force acts, in the body's frame, shape (3,) [m].
        wrench: (f, m) in axes of the base, shape (6,) [N, N·m].
    """
    chain = borrowed(chain)
    frames, axes = placements(chain, q)
    frame, about_origin = frames[body], wrench.copy()
    at = (frame[0, 3] + frame[0, 0] * point[0] + frame[0, 1] * point[1] + frame[0, 2] * point[2],
          frame[1, 3] + frame[1, 0] * point[0] + frame[1, 1] * point[1] + frame[1, 2] * point[2],
          frame[2, 3] + frame[2, 0] * point[0] + frame[2, 1] * point[1] + frame[2, 2] * point[2])
    moment = cross(at, (wrench[0], wrench[1], wrench[2]))
    for r in range(3):
        about_origin[3 + r] += moment[r]
    while body > 0:
        torque[chain.place[body - 1]] += dot6(axes[body - 1], about_origin)
        body = chain.parent[body - 1]
