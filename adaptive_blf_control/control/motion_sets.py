# SPDX-License-Identifier: Apache-2.0
"""The sets of a motion with the reference inside them, checked together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.control.reference import full_range, Reference, SmoothStart
from adaptive_blf_control.control.set_constraints import SafetyConstraint
from adaptive_blf_control.control.sets import (
    check_inside,
    check_no_further_out,
    check_performance_inside_safety,
    GrowingBounds,
    JointInterval,
)

__all__ = ['check_change', 'checked_sets', 'MotionSets']


class MotionSets(NamedTuple):
    """What of a controller keeps the arm where it belongs.

    Attributes:
        safety: Safety set (7).
        performance: Performance set (8), as wide as it gets.
        reference: y_d.
        bounds: Performance bounds in use at any time.
    """

    safety: JointInterval
    performance: JointInterval
    reference: Reference
    bounds: GrowingBounds


def checked_sets(t: float, safety: JointInterval, performance: JointInterval,
                 reference: Reference, begun: SmoothStart | None,
                 joints: tuple[str, ...]) -> MotionSets:
    """Return the sets and the reference for the motion from ``t`` on.

    Args:
        t: Time since the start of the motion [s].
        safety: Safety set (7).
        performance: Performance set (8).
        reference: y_d.
        begun: What the motion began with, where it is joined to its reference.
        joints: Names of the joints.

    Raises:
        SetViolation: (9) does not hold, or the motion began outside the safety set.
    """
    check_performance_inside_safety(safety, performance, full_range(reference), joints)
    if begun is None or t >= begun.duration:
        return MotionSets(safety, performance, reference, GrowingBounds(performance))
    check_inside(safety.lower, safety.upper, begun.start, joints,
                 'start position outside the safety set', SafetyConstraint.recovery)
    return MotionSets(safety, performance, reference,
                      GrowingBounds(performance, safety, begun.start, begun.duration))


def check_change(present: MotionSets, new: MotionSets, t: float, q: np.ndarray,
                 joints: tuple[str, ...], *, asked: bool) -> None:
    """Raise SetViolation where a change of the sets would put the present state outside.

    What is outside already may not get further out.

    Args:
        present: In use.
        new: What is to be used from ``t`` on.
        t: Time of the last sample since the start of the motion [s].
        q: Positions then, shape (n,) [rad].
        joints: Names of the joints.
        asked: Whether the performance set or the reference is to change.
    """
    if new.safety is not present.safety:
        check_no_further_out(new.safety.lower, new.safety.upper, q, present.safety.margin(q),
                             joints, 'present position outside the new safety set')
    bounds, before = new.bounds.at(t), present.bounds.at(t)
    # Those of a smooth start depend on the safety set, too.
    if asked or (bounds.lower > before.lower).any() or (bounds.upper < before.upper).any():
        error = q - present.reference.at(t).position
        check_no_further_out(
            bounds.lower, bounds.upper, q - new.reference.at(t).position,
            np.minimum(error - before.lower, before.upper - error), joints,
            'present error outside the new performance set')
