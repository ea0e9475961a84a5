# SPDX-License-Identifier: Apache-2.0
"""Is the effort of a measured log late, or early, against the motion?

For every shift of the effort least squares leave an error; where it is least, the delay is. Dry
friction follows a reversal late, which looks the same. So two answers are averaged, whose errors
are nearly independent: friction is as late as everything else, or it is late by a time of its own.
The constants are from logs without a fault: docs/logs.md.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.identification.dynamic_checks import left_over, Pairs
from adaptive_blf_control.identification.finding import Finding, WARNING
from adaptive_blf_control.spelling import option

__all__ = ['delay_findings']

EARLY, LATE = -0.015, 0.004  # s, between which the efforts of sound logs fit best
LEAST_GAIN = 0.01  # of the error, which a delay of all joints explains
ALONE = 0.015  # s, by which one joint differs from all that counts
ALONE_GAIN = 0.13  # of its error, which that explains
DRIVEN = 0.75  # of its torque, which is not friction where a joint is judged alone
LEAST_MOTION = 0.05  # of the largest range of a joint: who moves less is carried, not driven
LEAST_FIT = 0.5  # of its torque, what the model of a joint may leave


class _Joint(NamedTuple):
    """What tells the delay of a joint.

    Attributes:
        joint: Which.
        errors: Logarithm of the RMS error with each shift, without and with a delay of the
            friction, shape (2, lags).
        share: Part of the torque that is not friction.
    """

    joint: int
    errors: np.ndarray
    share: float


def delay_findings(pairs: Pairs, arm: Arm, ranges: np.ndarray) -> Iterator[Finding]:
    """Efforts that are behind the motion or ahead of it, of all joints or of some.

    Args:
        pairs: Filtered pairs with torques at several lags.
        arm: The arm.
        ranges: Range of each joint's position in them, shape (n,) [rad].
    """
    told = [told for joint in np.flatnonzero(ranges >= LEAST_MOTION * ranges.max())
            if (told := _joint(pairs, arm, int(joint))) is not None]
    if not told or 2 * len(told) < len(arm.joints):
        return  # a joint or two are not enough of an arm
    usual = int(np.argmin(_together(told)[1]))
    for each in list(told):
        error = each.errors[1]
        delay, gain = _least(pairs, error), _gain(error, usual)
        if (delay is not None and each.share >= DRIVEN and gain > ALONE_GAIN
                and abs(delay - pairs.lags[usual] * pairs.period) >= ALONE):
            told.remove(each)
            yield _finding(arm.joints[each.joint], delay, gain)
    if not told:
        return
    errors = _together(told)
    delays = [delay for error in errors if (delay := _least(pairs, error)) is not None]
    if len(delays) == len(errors) and not EARLY < (mean := float(np.mean(delays))) < LATE:
        gain = max(_gain(error, pairs.zero) for error in errors)
        if gain >= LEAST_GAIN:
            yield _finding(None, mean, gain)


def _together(told: list[_Joint]) -> np.ndarray:
    """Return the logarithms of the error of all joints, (2, lags); friction tells less."""
    return np.average([each.errors for each in told], axis=0,
                      weights=[each.share ** 2 for each in told])


def _gain(error: np.ndarray, place: int) -> float:
    """Return which part of the error at a place is gone where it is least."""
    return -float(np.expm1(error.min() - error[place]))


def _joint(pairs: Pairs, arm: Arm, joint: int) -> _Joint | None:
    """Return what a joint tells; None for a poor model."""
    regressor, torques = pairs.regressors[:, joint], pairs.torques[:, :, joint]
    dry = [place for place, name in enumerate(arm.parameters) if name.startswith(('fc_', 'fs_'))]
    errors = np.array([left_over(columns, torques) for columns in (
        regressor, np.hstack([regressor, pairs.changes[:, joint][:, dry]]))])
    unshifted = torques[pairs.zero]
    size = float(unshifted.std())
    if not errors.min() < LEAST_FIT * size:
        return None
    friction = regressor[:, getattr(arm, 'base_count', arm.m):]
    return _Joint(joint, np.log(np.maximum(errors, 1e-12 * size)),
                  float(left_over(friction, unshifted[None])[0]) / size)


def _least(pairs: Pairs, error: np.ndarray) -> float | None:
    """Return the shift with the least error [s], by a parabola; None at the end of the range."""
    best = int(np.argmin(error))
    if not 0 < best < len(error) - 1:
        return None
    near = slice(best - 1, best + 2)
    curve = np.polyfit(pairs.lags[near] - pairs.lags[best], error[near], 2)
    vertex = -0.5 * curve[1] / curve[0] if curve[0] > 0.0 else 0.0
    return float((pairs.lags[best] + vertex) * pairs.period)


def _finding(joint: str | None, delay: float, gain: float) -> Finding:
    return Finding('delay', joint, WARNING, delay, 'the effort is '
                   f'{abs(1e3 * delay):.0f} ms {"behind" if delay > 0.0 else "ahead of"} the '
                   f'motion (the error is {gain:.0%} less without that)',
                   option('effort_delay', f'{delay:.3g}'))
