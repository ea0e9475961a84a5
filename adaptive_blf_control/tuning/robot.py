# SPDX-License-Identifier: Apache-2.0
"""What is known of a robot: what its owner states, and the limits of its URDF."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arrays import checked_array, checked_finite
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.tuning.loop_delay import loop_delay, LoopDelay

__all__ = ['Limits', 'Robot', 'known_limits', 'per_joint']

FREE = math.pi  # rad to either side of zero, where a joint has no limits
SLOW = 1.0  # rad/s, where a joint has no speed limit


@dataclass(frozen=True, kw_only=True)
class Robot:
    """What the owner of a robot states about it.

    Attributes:
        rate: Joint states per second [Hz].
        delay: From the sample of a state until the command that answers it acts [s].
        encoder_counts: Counts per turn of the joint, from whose differences the velocities are;
            None: positions and velocities are as good as exact.
        velocity_time_constant: Of the filter on those differences [s].
        torque_noise: Standard deviation of the noise of the measured torques [N·m].
        payload: Largest mass at the tip [kg].
        torque_limit: Largest torques to command, one or one per joint [N·m]; None: the URDF's.
        centre: Posture around which the reference moves, one per joint [rad]; None: the middle of
            the limits.
        amplitude: Largest distance of the reference from its centre [rad].
        width: Largest performance bound [rad].
        from_zero: Whether learning begins from θ̂ = 0 rather than from the URDF's values.
    """

    rate: float = 1000.0
    delay: float = 0.0
    encoder_counts: int | None = None
    velocity_time_constant: float = 0.005
    torque_noise: float = 0.0
    payload: float = 0.0
    torque_limit: tuple[float, ...] | None = None
    centre: tuple[float, ...] | None = None
    amplitude: float = 0.5
    width: float = 0.15
    from_zero: bool = False

    def __post_init__(self) -> None:
        """Refuse what cannot be; ParameterError names it as the command does."""
        for name, value in (('amplitude', self.amplitude), ('width', self.width)):
            checked_finite(f'--{name}', value, 'an angle > 0 rad', above=0.0)
        for name, value, unit in (('torque-noise', self.torque_noise, 'N·m'),
                                  ('payload', self.payload, 'kg')):
            if checked_finite(f'--{name}', value, f'a number >= 0 {unit}') < 0.0:
                raise ParameterError(f'--{name}', value, f'a number >= 0 {unit}')
        if self.encoder_counts is not None and self.encoder_counts < 1:
            raise ParameterError('--encoder', self.encoder_counts, 'at least 1 count per turn')

    @property
    def loop(self) -> LoopDelay:
        """The delay of its loop."""
        return loop_delay(self.rate, self.delay, self.velocity_lag)

    @property
    def velocity_lag(self) -> float:
        """By which velocities from differences of positions are late [s]."""
        if self.encoder_counts is None:
            return 0.0
        return self.velocity_time_constant + 0.5 / self.rate

    @property
    def resolution(self) -> float:
        """One count [rad]; 0 where positions are exact."""
        return 0.0 if self.encoder_counts is None else 2.0 * math.pi / self.encoder_counts


class Limits(NamedTuple):
    """Limits of the joints; arrays of shape (n,).

    Attributes:
        lower: Positions [rad].
        upper: Positions [rad].
        velocity: Speeds [rad/s].
        torque: Torques [N·m]; infinite where neither URDF nor owner says.
        assumed: A sentence for every limit that had to be assumed.
    """

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray
    assumed: tuple[str, ...]


def known_limits(arm: UrdfArm, robot: Robot) -> Limits:
    """Return the limits of a URDF arm, with what is assumed where it has none.

    Raises:
        ParameterError: the stated torque limits do not fit the arm.
    """
    assumed = []
    free = ~(np.isfinite(arm.position_lower) & np.isfinite(arm.position_upper))
    if free.any():
        assumed.append(f'{_names(arm, free)}: no position limits: the sets are within -pi .. pi')
    slow = ~np.isfinite(arm.velocity_limit)
    if slow.any():
        assumed.append(f'{_names(arm, slow)}: no speed limit: {SLOW:g} rad/s assumed')
    massless = arm.inertial[:, 0] == 0.0
    if massless.any():
        assumed.append(f'{_names(arm, massless)}: the link behind it has no mass, and is taken '
                       'for massless')
    torque = arm.torque_limit
    if robot.torque_limit is not None:
        torque = per_joint('--torque-limit', robot.torque_limit, arm)
        if not (torque > 0.0).all():
            raise ParameterError('--torque-limit', list(robot.torque_limit), 'torques > 0 N·m')
    return Limits(np.where(free, -FREE, arm.position_lower),
                  np.where(free, FREE, arm.position_upper),
                  np.where(slow, SLOW, arm.velocity_limit), torque, tuple(assumed))


def _names(arm: UrdfArm, where: np.ndarray) -> str:
    return ', '.join(joint for joint, each in zip(arm.joints, where) if each)


def per_joint(name: str, values: tuple[float, ...], arm: UrdfArm) -> np.ndarray:
    """Return what was stated, one for all joints or one for each, with one for each, (n,).

    Raises:
        ParameterError: it has another length, or is not finite.
    """
    if len(values) == 1:
        values = values * arm.n
    array = checked_array(name, values, (arm.n,), arm.joints)
    if not np.isfinite(array).all():
        raise ParameterError(name, list(values), 'finite numbers')
    return array
