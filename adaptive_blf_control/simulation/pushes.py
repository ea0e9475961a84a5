# SPDX-License-Identifier: Apache-2.0
"""Forces and moments on the links of a simulated arm, from their times on."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.chain import add_wrench_torque, Chain, no_chain
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.compiled import borrowed, jit, jitable
from adaptive_blf_control.simulation.targets import row_of_wrench, TimedChange

__all__ = ['Links', 'PushArrays', 'add_push_torque', 'let_push', 'next_push']


class PushArrays(NamedTuple):
    """P changes of what acts on L links, and what acts now.

    Attributes:
        chain: Kinematics of the arm.
        bodies: Body row of each link, shape (L,).
        points: Its origin in the frame of that body, shape (L, 3) [m].
        times: Of the changes, ascending, shape (P,) [s].
        places: Row and column of ``wrenches`` that each changes, shape (P, 2).
        values: What it is from then on, shape (P,) [N or N·m].
        done: How many of the changes have been made, shape (1,).
        wrenches: (f, m) on each link in axes of the base, shape (L, 6) [N, N·m].
    """

    chain: Chain
    bodies: np.ndarray
    points: np.ndarray
    times: np.ndarray
    places: np.ndarray
    values: np.ndarray
    done: np.ndarray
    wrenches: np.ndarray


class Links:
    """The links of an arm that can be pushed: those that move, where it is from a URDF.

    Attributes:
        names: Their names.
    """

    def __init__(self, arm: Arm) -> None:
        """Look up the links of an arm."""
        self.names: tuple[str, ...] = ()
        self._chain, self._bodies, self._points = no_chain(), np.zeros(0), np.zeros((0, 3))
        if isinstance(arm, UrdfArm):
            links = arm.links()
            self.names, self._chain = tuple(links), arm.chain.chain
            self._bodies = np.array([link.body for link in links.values()])
            self._points = np.array([link.origin for link in links.values()])

    def pushed(self, changes: Sequence[TimedChange]) -> PushArrays:
        """Return the arrays of changes of forces and moments on links among ``names``."""
        pushed = list(dict.fromkeys(change.target.name for change in changes))
        rows = np.array([self.names.index(name) for name in pushed], dtype=np.intp)
        places = [(pushed.index(change.target.name), row_of_wrench(change.target))
                  for change in changes]
        return PushArrays(
            self._chain, self._bodies[rows].astype(np.intp), self._points[rows],
            np.array([change.t for change in changes], dtype=float),
            np.array(places, dtype=np.intp).reshape(-1, 2),
            np.array([change.value for change in changes], dtype=float),
            np.zeros(1, dtype=np.intp), np.zeros((len(pushed), 6)))


@jitable
def next_push(pushes: PushArrays) -> float:
    """Return the time of the next change [s]; infinity where there is none."""
    pushes = borrowed(pushes)
    done = pushes.done[0]
    return pushes.times[done] if done < pushes.times.size else math.inf


@jitable
def let_push(pushes: PushArrays, t: float) -> None:
    """Make the changes that are due at ``t`` [s]."""
    pushes = borrowed(pushes)
    done, times = pushes.done, pushes.times
    while done[0] < times.size and times[done[0]] <= t:
        place = pushes.places[done[0]]
        pushes.wrenches[place[0], place[1]] = pushes.values[done[0]]
        done[0] += 1


@jit
def add_push_torque(pushes: PushArrays, q: np.ndarray, torque: np.ndarray) -> None:
    """Add what acts now on the links to the torque of the joints, shape (n,) [N·m].

    Args:
        pushes: What acts.
        q: Joint positions, shape (n,) [rad].
        torque: Is added to.
    """
    pushes = borrowed(pushes)
    for k in range(pushes.bodies.size):
        wrench = pushes.wrenches[k]
        if wrench.any():
            add_wrench_torque(torque, pushes.chain, q, pushes.bodies[k], pushes.points[k], wrench)
