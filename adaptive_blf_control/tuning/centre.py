# SPDX-License-Identifier: Apache-2.0
"""The posture around which a reference moves, where nobody states one.

That is the middle of the limits, unless the arm is nearly singular there: stretched straight up,
two of its axes in one line, a joint sees so little inertia that no gain the delay allows can hold
what acts on it. What a joint can be held with is κ_i = least_i/coupling (`SeenInertia`), of the
links alone. The middle will do where every κ_i is a twentieth of its median over the postures
near it. Otherwise the motion goes around that posture, of those in which every joint has its
median at least, in which a weight at the tip turns no joint fast, max_i |g_i|/κ_i, and where
along the reference the arm stays clear of itself and above its base.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.clearance import Clearance
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.errors import ArmError
from adaptive_blf_control.tuning.inertia import mass_matrices, seen_inertia

__all__ = ['Centre', 'centre_between']

LEAST = 0.05  # κ over its median, below which the middle of the limits is not taken
COUNT = 512  # postures that are looked at
APART = 0.05  # m between bodies that belong to links further apart than neighbours


class Centre(NamedTuple):
    """Where a reference moves.

    Attributes:
        posture: Shape (n,) [rad].
        reason: Why it is not the middle of the limits; empty: it is.
    """

    posture: np.ndarray
    reason: str


def centre_between(arm: UrdfArm, lower: np.ndarray, upper: np.ndarray, range_: np.ndarray,
                   along: Callable[[np.ndarray], np.ndarray]) -> Centre:
    """Return the posture around which a reference moves.

    Args:
        arm: The arm.
        lower: Ends between which the posture is, the middle between them that of the limits,
            shape (n,) [rad].
        upper: Likewise.
        range_: Positions that the joints may take, shape (2, n) [rad].
        along: Gives postures along the reference around one, shape (N, n) [rad].
    """
    middle = 0.5 * (lower + upper)
    postures = np.random.default_rng(0).uniform(lower, upper, (COUNT, arm.n))
    first = arm.chain.chain.place[0]  # at the base: M does not depend on how far it is turned
    postures[:, first] = middle[first]
    masses = _link_masses(arm, np.vstack([middle, postures]))
    if np.linalg.eigvalsh(masses)[:, 0].min() <= 0.0:  # held by its rotors alone, or by nothing
        return Centre(middle, '')
    held = np.array([seen.least / seen.coupling
                     for seen in (seen_inertia(mass[None]) for mass in masses)])
    usual = np.median(held[1:], axis=0)
    parts = held / usual
    if parts[0].min() >= LEAST:
        return Centre(middle, '')
    good = np.flatnonzero(parts[1:].min(axis=1) >= 1.0)
    if not good.size:
        good = np.argsort(parts[1:].min(axis=1))[-1:]
    order = good[np.argsort(_thrown(arm, postures[good], held[1:][good]))]
    bodies, unseen = _bodies(arm, range_)
    clear = (k for k in order if bodies is None or bodies.kept(along(postures[k])))
    found = next(clear, None)
    joint = arm.joints[int(parts[0].argmin())]
    seen = (f'in the middle of the limits {joint} sees {parts[0].min():.2g} of the inertia that '
            'it usually does')
    if found is None:
        return Centre(middle, f'{seen}, and no better posture is clear of the arm itself and '
                              'above its base: --centre states one')
    text = ', '.join(f'{value:.4g}' for value in postures[found])
    return Centre(postures[found], f'{seen}: the reference moves around {text} instead'
                  f'{unseen} (--centre states another posture)')


def _link_masses(arm: UrdfArm, postures: np.ndarray) -> np.ndarray:
    """Return M of the links without rotors in postures (K, n), shape (K, n, n) [kg·m²]."""
    links = arm.nominal.copy()
    links[:arm.base_count] -= arm.base_from_rotor @ arm.rotor
    return mass_matrices(arm, links, postures)


def _thrown(arm: UrdfArm, postures: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return how fast a kilogram at the tip turns a joint over what holds it, (K,) [1/s²]."""
    weight, rest = arm.payload_direction, np.zeros(arm.n)
    if weight is None:
        return -held.min(axis=1)
    torques = np.array([arm.X(q, rest, rest, rest) @ weight for q in postures])
    return np.asarray((np.abs(torques) / held).max(axis=1))


def _bodies(arm: UrdfArm, range_: np.ndarray) -> tuple[Clearance | None, str]:
    """Return the collision bodies above the base; where there are none, what to say of it."""
    try:
        bodies = Clearance(arm, (range_[0], range_[1]), APART, floor=0.0)
    except ArmError:
        return None, ', of which nothing says whether the arm touches itself'
    return (bodies, '') if bodies.pairs else (
        None, ', of which nothing says whether the arm touches itself')
