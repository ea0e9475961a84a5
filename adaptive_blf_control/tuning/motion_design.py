# SPDX-License-Identifier: Apache-2.0
"""Sets and a reference inside the limits of an arm."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arrays import checked_array
from adaptive_blf_control.control.reference import SumOfSinusoids
from adaptive_blf_control.control.settings import SinusoidSettings
from adaptive_blf_control.errors import SetViolation
from adaptive_blf_control.tuning.centre import Centre, centre_between
from adaptive_blf_control.tuning.inertia import reference_states
from adaptive_blf_control.tuning.robot import Limits, Robot

__all__ = ['Motion', 'motion_within']

MARGIN = 0.02  # part of the range of a joint between its limits and the safety set
BOUND = 0.05  # part of the range that a performance bound is at most
WIDEST = 0.15  # part of the range that a bound is at most where the start needs it
ROOM = 0.9  # part of the room beside the centre that the reference uses
SPEED = 0.35  # part of the speed limit that the reference reaches at most
# Frequencies that have no common period within a minute; each joint's are 6 % above those of the
# joint before it, so that no two move alike. Slow ones for gravity, fast ones for inertia.
FREQUENCY, SPREAD = np.array([0.9, 2.1, 3.7]), 0.06  # rad/s
SHARE = np.array([0.5, 0.3, 0.2])  # of the amplitude
CLEAR = 60  # postures of a reference that have to be clear of the arm itself


class Motion(NamedTuple):
    """Sets and reference; arrays of shape (n,) [rad].

    Attributes:
        safety_lower: Lower end of the safety set (7).
        safety_upper: Upper end.
        bound: Performance bound to both sides (8).
        centre: Posture in which the motion begins.
        sinusoids: Of each joint around it.
        moved: Why the centre is not the middle of the limits; empty: it is, or it was stated.
    """

    safety_lower: np.ndarray
    safety_upper: np.ndarray
    bound: np.ndarray
    centre: np.ndarray
    sinusoids: tuple[SinusoidSettings, ...]
    moved: str

    @property
    def reference(self) -> SumOfSinusoids:
        """y_d."""
        return _reference(self.sinusoids)


def motion_within(arm: UrdfArm, limits: Limits, robot: Robot,
                  least: np.ndarray | float = 0.0) -> Motion:
    """Return sets inside the position limits and a reference inside the sets and speed limits.

    Args:
        arm: The arm.
        limits: Of its joints.
        robot: What is stated.
        least: Performance bounds that the motion needs, as far as the range allows, shape (n,)
            [rad].

    Raises:
        SetViolation: the stated centre has no room for the performance bounds.
        ParameterError: it does not fit the arm.
    """
    span = limits.upper - limits.lower
    lower, upper = limits.lower + MARGIN * span, limits.upper - MARGIN * span
    bound = np.minimum(robot.width, BOUND * span)
    bound = _rounded(np.maximum(bound, np.minimum(least, WIDEST * span)))
    lowest, highest = lower + 2.0 * bound, upper - 2.0 * bound

    def around(posture: np.ndarray) -> tuple[SinusoidSettings, ...]:
        room = np.minimum(posture - lower, upper - posture) - bound
        reach = np.minimum(ROOM * room, robot.amplitude)
        return _sinusoids(_rounded(posture), reach, SPEED * limits.velocity)

    if robot.centre is not None:
        centre = Centre(checked_array('--centre', robot.centre, (arm.n,), arm.joints), '')
        _check_centre(arm, centre.posture, lowest, highest)
    else:
        outer = (MARGIN + 2.0 * WIDEST) * span  # whatever the bounds become
        centre = centre_between(
            arm, limits.lower + outer, limits.upper - outer, np.array([lower, upper]),
            lambda posture: reference_states(_reference(around(posture)), CLEAR).q)
    return Motion(_rounded(lower), _rounded(upper), bound, _rounded(centre.posture),
                  around(centre.posture), centre.reason)


def _check_centre(arm: UrdfArm, centre: np.ndarray, lowest: np.ndarray,
                  highest: np.ndarray) -> None:
    for joint, value, low, high in zip(arm.joints, centre, lowest, highest):
        if not low <= value <= high:
            raise SetViolation(joint, value, low if value < low else high,
                               '--centre leaves no room for the performance bounds')


def _sinusoids(centre: np.ndarray, reach: np.ndarray,
               speed: np.ndarray) -> tuple[SinusoidSettings, ...]:
    random, result = np.random.default_rng(0), []
    for i, offset in enumerate(centre.tolist()):
        frequency = FREQUENCY * (1.0 + SPREAD * i)
        amplitude = SHARE * reach[i]
        amplitude *= min(1.0, speed[i] / float(amplitude @ frequency))
        result.append(SinusoidSettings(
            offset=offset, amplitude=_rounded(amplitude), frequency=_rounded(frequency),
            phase=_rounded(random.uniform(0.0, 2.0 * np.pi, FREQUENCY.size))))
    return tuple(result)


def _reference(sinusoids: tuple[SinusoidSettings, ...]) -> SumOfSinusoids:
    offset, amplitude, frequency, phase = (
        np.array([getattr(each, name) for each in sinusoids])
        for name in ('offset', 'amplitude', 'frequency', 'phase'))
    return SumOfSinusoids(offset, amplitude, frequency, phase)


def _rounded(values: np.ndarray) -> np.ndarray:
    return np.round(values, 4)
