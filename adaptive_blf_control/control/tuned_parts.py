# SPDX-License-Identifier: Apache-2.0
"""What follows from the settings of a controller alone, made before any of it is taken."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.control.constraints import Constraint
from adaptive_blf_control.control.laws.choice import checked_law, make_law, retuned_law
from adaptive_blf_control.control.laws.protocol import Law
from adaptive_blf_control.control.safety_filter import made_filter, SafetyFilter
from adaptive_blf_control.control.set_constraints import made_constraint, OwnConstraint
from adaptive_blf_control.control.sets import JointInterval
from adaptive_blf_control.control.settings import ControllerSettings

__all__ = ['GivenParts', 'tuned_parts', 'TunedParts', 'with_safety']


class GivenParts(NamedTuple):
    """Parts that a caller gave as objects or classes, beside the settings.

    Attributes:
        law: In place of the one that the settings name; None for that one.
        constraints: Beside those that the settings name.
    """

    law: Law | type[Law] | None
    constraints: Sequence[OwnConstraint]


class TunedParts(NamedTuple):
    """What a change of the settings replaces.

    Attributes:
        settings: Of full length.
        law: Of them, or the given one.
        constraints: Beside the two sets and those of the safety filter.
        safety_filter: What the torque passes behind the law; None where there is none.
        barrier_weight: Shape (n,) [J].
        torque_limit: Shape (n,) [N·m].
        torque_rate_limit: Shape (n,) [N·m/s].
    """

    settings: ControllerSettings
    law: Law
    constraints: tuple[Constraint, ...]
    safety_filter: SafetyFilter | None
    barrier_weight: np.ndarray
    torque_limit: np.ndarray
    torque_rate_limit: np.ndarray


def tuned_parts(arm: Arm, settings: ControllerSettings, given: GivenParts,
                before: TunedParts | None = None) -> TunedParts:
    """Make what follows from settings.

    Args:
        arm: The arm.
        settings: Gains, limits and names of parts.
        given: Parts that do not follow from them.
        before: In use so far, where a motion goes on: what learns by itself keeps what it knows.

    Raises:
        ParameterError: a part cannot be made of them.
    """
    full = settings.resolved(joints=arm.n)
    law = None if before is None else retuned_law(before.law, full)
    if law is None:
        law = (make_law(arm, full) if given.law is None else
               checked_law('law', given.law, given.law, arm, full))
    names = (name for name in full.constraints if name)
    # Copies that may be written to: the compiled functions take those.
    return TunedParts(full, law, tuple(made_constraint(arm, full, each)
                                       for each in (*names, *given.constraints)),
                      made_filter(arm, full, None if before is None else before.safety_filter),
                      full.barrier_weight.copy(), full.torque_limit.copy(),
                      full.torque_rate_limit.copy())


def with_safety(settings: ControllerSettings, safety: JointInterval) -> ControllerSettings:
    """Return settings whose safety set is the one in use, where a safety filter is to keep it."""
    if settings.safety_filter == 'none':
        return settings
    return settings.replace(safety={'lower': safety.lower, 'upper': safety.upper})
