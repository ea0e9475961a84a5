# SPDX-License-Identifier: Apache-2.0
"""What the owner of a robot states about the experiment, and the task that follows from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import os

import numpy as np

from adaptive_blf_control.arms.clearance import Clearance
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arrays import checked_array, checked_finite
from adaptive_blf_control.errors import ParameterError, SetViolation
from adaptive_blf_control.experiment.design import Task
from adaptive_blf_control.experiment.motion_limits import MotionLimits
from adaptive_blf_control.limits.prior import prior_of
from adaptive_blf_control.tuning.robot import known_limits, Limits, Robot

__all__ = ['Statement', 'task_of']

MARGIN = 0.08  # part of the range of a joint at either end: what the sets of `configure` need
FRICTION = 0.1  # part of a torque limit that is left for friction the URDF does not give
NOISE = 0.005  # part of a torque limit that a model usually leaves unexplained
START = 0.25  # s from rest to full speed, where no acceleration limit is stated
TOP = 0.8  # Hz, of the highest harmonic: inside of what the identifier's filters let through
FEWEST, MOST = 5, 24  # harmonics
FASTEST = 2.0  # Hz, of the highest harmonic
OVERSAMPLED = 10  # samples of a period of the highest harmonic, at least


@dataclass(frozen=True, kw_only=True)
class Statement:
    """What the owner states; of values per joint, one stands for all.

    Attributes:
        duration: Period of the motion [s].
        rate: Samples per second [Hz].
        centre: Posture around which it moves, one per joint [rad]; None: the optimiser's choice.
        amplitude: Largest distance from the centre [rad].
        speed: Part of the speed limits that is used, in (0, 1].
        acceleration: Largest accelerations [rad/s²]; None: full speed after `START`.
        torque_limit: Largest torques [N·m]; None: the URDF's.
        mass_error: How wrong the URDF's masses may be, as a part of them.
        payload: Largest mass at the tip [kg].
        noise: Standard deviation of the measured torques [N·m]; None: `NOISE` of the limits.
        collisions: Whether collision bodies are looked at.
        distance: How far apart they have to stay [m].
        floor: Height of a floor in the base frame [m], or None.
        srdf: Text of an SRDF, or None.
        package_dirs: Further folders of packages, for meshes.
    """

    duration: float = 20.0
    rate: float = 100.0
    centre: tuple[float, ...] | None = None
    amplitude: float = 3.0
    speed: float = 0.5
    acceleration: tuple[float, ...] | None = None
    torque_limit: tuple[float, ...] | None = None
    mass_error: float = 0.3
    payload: float = 0.0
    noise: tuple[float, ...] | None = None
    collisions: bool = True
    distance: float = 0.02
    floor: float | None = None
    srdf: str | None = None
    package_dirs: Sequence[str | os.PathLike[str]] = ()

    def __post_init__(self) -> None:
        """Refuse what cannot be; ParameterError names it as the command does."""
        checked_finite('--duration', self.duration, f'at least {FEWEST / FASTEST:g} s', above=0.0)
        checked_finite('--rate', self.rate, 'a rate > 0 Hz', above=0.0)
        checked_finite('--amplitude', self.amplitude, 'an angle > 0 rad', above=0.0)
        checked_finite('--distance', self.distance, 'a distance > 0 m', above=0.0)
        if not 0.0 < checked_finite('--speed', self.speed, 'a part in (0, 1]') <= 1.0:
            raise ParameterError('--speed', self.speed, 'a part in (0, 1] of the speed limits')
        if not 0.0 <= checked_finite('--mass-error', self.mass_error, 'a part in 0 .. 1') <= 1.0:
            raise ParameterError('--mass-error', self.mass_error, 'a part in 0 .. 1')
        if checked_finite('--payload', self.payload, 'a mass >= 0 kg') < 0.0:
            raise ParameterError('--payload', self.payload, 'a mass >= 0 kg')
        if self.floor is not None:
            checked_finite('--floor', self.floor, 'a height in m')
        if self.duration < FEWEST / FASTEST:
            raise ParameterError('--duration', self.duration,
                                 f'at least {FEWEST / FASTEST:g} s: a period of {FEWEST} '
                                 f'harmonics of at most {FASTEST:g} Hz')
        highest = self.harmonics / self.duration
        if self.rate < OVERSAMPLED * highest:
            raise ParameterError('--rate', self.rate, f'at least {OVERSAMPLED * highest:.3g} Hz: '
                                 f'the motion has parts of {highest:.3g} Hz')

    @property
    def harmonics(self) -> int:
        """Number of harmonics of a period."""
        return int(np.clip(round(TOP * self.duration), FEWEST, MOST))


def task_of(arm: UrdfArm, stated: Statement) -> tuple[Task, tuple[str, ...]]:
    """Return what the motion has to do, and a sentence for everything that was assumed.

    Raises:
        ArmError: a collision body cannot be read.
        ParameterError: a torque limit is missing, or what is stated does not fit the arm.
        SetViolation: the stated centre is not inside of the limits.
    """
    known = known_limits(arm, Robot(torque_limit=stated.torque_limit))
    _check_torque(arm, known)
    lower, upper = _range(arm, known, stated)
    velocity = stated.speed * known.velocity
    acceleration, assumed = velocity / START, list(known.assumed)
    if stated.acceleration is None:
        assumed.append('no acceleration limits stated: '
                       f'{", ".join(f"{each:.3g}" for each in acceleration)} rad/s² assumed, '
                       f'full speed after {START:g} s')
    else:
        acceleration = per_joint('--acceleration', stated.acceleration, arm)
    if not arm.nominal[arm.base_count:].any():
        assumed.append(f'no friction in the URDF: {FRICTION:.0%} of each torque limit is left '
                       'for it')
    noise = NOISE * known.torque
    if stated.noise is None:
        assumed.append('no torque noise stated: '
                       f'{", ".join(f"{each:.3g}" for each in noise)} N·m assumed, '
                       f'{NOISE:.1%} of the torque limits')
    else:
        noise = per_joint('--torque-noise', stated.noise, arm)
    prior = prior_of(arm, mass_error=stated.mass_error, payload=stated.payload)
    limits = MotionLimits(lower, upper, velocity, acceleration,
                          (1.0 - FRICTION) * known.torque, prior)
    bodies = _bodies(arm, limits, stated, assumed)
    return (Task(arm, limits, noise, stated.duration, stated.harmonics, bodies),
            tuple(assumed))


def per_joint(name: str, values: Sequence[float], arm: UrdfArm) -> np.ndarray:
    """Return one value for each joint; ParameterError where they are not positive numbers."""
    array = checked_array(name, tuple(values) * arm.n if len(values) == 1 else values, (arm.n,),
                          arm.joints)
    if not (np.isfinite(array) & (array > 0.0)).all():
        raise ParameterError(name, list(values), 'numbers > 0')
    return array


def _check_torque(arm: UrdfArm, known: Limits) -> None:
    free = [joint for joint, limit in zip(arm.joints, known.torque) if not np.isfinite(limit)]
    if free:
        raise ParameterError('--torque-limit', None, 'the largest torques of the drives [N·m]: '
                             f'the URDF gives no effort limit, or zero, to {", ".join(free)}')


def _range(arm: UrdfArm, known: Limits, stated: Statement) -> tuple[np.ndarray, np.ndarray]:
    span = known.upper - known.lower
    lower, upper = known.lower + MARGIN * span, known.upper - MARGIN * span
    centre = 0.5 * (lower + upper)
    if stated.centre is not None:
        centre = checked_array('--centre', stated.centre, (arm.n,), arm.joints)
        for joint, value, low, high in zip(arm.joints, centre, lower, upper):
            if not low < value < high:
                raise SetViolation(joint, value, low if value <= low else high,
                                   '--centre leaves no room to move')
    return (np.maximum(lower, centre - stated.amplitude),
            np.minimum(upper, centre + stated.amplitude))


def _bodies(arm: UrdfArm, limits: MotionLimits, stated: Statement,
            assumed: list[str]) -> Clearance | None:
    if not stated.collisions:
        assumed.append('collisions are not looked at (--no-collisions)')
        return None
    bodies = Clearance(arm, (limits.lower, limits.upper), stated.distance, floor=stated.floor,
                       srdf=stated.srdf, package_dirs=stated.package_dirs)
    if not bodies.bodies:
        assumed.append('no collision bodies in the URDF: collisions are not looked at')
    if bodies.ignored:
        assumed.append('taken for parts that touch all the time, and left out: '
                       + ', '.join(map(' and '.join, bodies.ignored)))
    return bodies
