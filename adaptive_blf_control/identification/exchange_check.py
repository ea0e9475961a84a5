# SPDX-License-Identifier: Apache-2.0
"""Do positions of a measured log stand in each other's columns?

The torque that the masses of a URDF need at the positions as given is compared with the measured
one. Only where that is poor, each pair of joints is exchanged for a trial: their positions and
velocities alone, or their efforts with them.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.dynamic_checks import (
    filtered_pairs,
    LEAST_TORQUE,
    likeness,
    Pairs,
)
from adaptive_blf_control.identification.finding import Excerpt, Finding, WARNING
from adaptive_blf_control.identification.settings import IdentifierSettings

__all__ = ['exchange_finding']

ROWS = 3000  # of the excerpt that are looked at
MOST_JOINTS = 8  # of an arm whose pairs are all tried
POOR, GOOD = 0.7, 0.85  # mean correlation as given, below which pairs are tried; with one of them


def exchange_finding(part: Excerpt, arm: Arm, settings: IdentifierSettings,
                     nominal_of: Callable[[Pairs, Arm], np.ndarray]) -> Finding | None:
    """Return the exchange of two joints that explains a poor fit; None where none does.

    Args:
        part: Rows of the log.
        arm: The arm.
        settings: Those of the filters are used.
        nominal_of: Returns the torque of the URDF's masses at filtered pairs, (K, n) [N·m].
    """
    n = len(arm.joints)
    if n > MOST_JOINTS:
        return None
    few = Excerpt(part.t[:ROWS], part.q[:ROWS], part.qd[:ROWS], part.tau[:ROWS], part.period,
                  part.whole[:ROWS - 1])

    def fit(order: list[int]) -> tuple[float, float]:
        """Return the fit with positions in an order, and with the efforts in it as well."""
        trial = few._replace(q=few.q[:, order], qd=few.qd[:, order])
        pairs = filtered_pairs(trial, arm, settings, shifted=False)
        if pairs is None:
            return 0.0, 0.0
        nominal, measured = nominal_of(pairs, arm), pairs.measured
        return _mean_likeness(measured, nominal), _mean_likeness(measured[:, order], nominal)

    as_given, _ = fit(list(range(n)))
    if as_given > POOR:
        return None
    best, found = 0.0, (0, 0, False)
    for one, other in combinations(range(n), 2):
        order = list(range(n))
        order[one], order[other] = other, one
        for with_efforts, value in enumerate(fit(order)):
            if value > best:
                best, found = value, (one, other, bool(with_efforts))
    if best < GOOD:
        return None
    one, other, with_efforts = found
    what = 'positions, velocities and efforts' if with_efforts else 'positions and velocities'
    return Finding('order', arm.joints[one], WARNING, best,
                   f'with the {what} of it and of joint {arm.joints[other]!r} exchanged the '
                   f'efforts are those of the masses of the URDF (mean correlation {best:.2f}, as '
                   f'given {as_given:.2f})', f'columns {one + 1} and {other + 1} may be exchanged')


def _mean_likeness(measured: np.ndarray, nominal: np.ndarray) -> float:
    """Return the mean correlation of the joints that carry something."""
    loaded = nominal.std(axis=0) > LEAST_TORQUE
    return float(likeness(measured[:, loaded], nominal[:, loaded]).mean()) if loaded.any() else 0.0
