# SPDX-License-Identifier: Apache-2.0
"""Filters of the identifier from sensors and speed of motion, and what the sensors cost.

A low-pass of order N with the time constant T on position and torque takes the noise, and with it
detail of the motion: a function f of the filtered position is not the filtered f. The low-pass
spreads its input over a variance of N T², so the difference is about ½ f″ N T² q̇², and with
f″ ~ f, as of sines and cosines of joint angles, the part ½ N T² q̇² of the torque. The noise that
passes, against it:

* a count r of an encoder, white with the variance r²/12, becomes a velocity noise of
  r/√12 √(dt I_N/T³), I_N = Γ(3/2) Γ(N − 3/2)/(2π Γ(N)) (Parseval), and through M and the torque
  filter k a torque of M/k times that;
* torque noise σ becomes σ √(dt/(2 (k + N T))).
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.tuning.robot import Robot

__all__ = ['ORDER', 'Filters', 'filters_for', 'measured_velocity_noise']

ORDER = 4  # of docs/noise.md
CANDIDATES = np.geomspace(0.002, 0.0212, 35)  # s; longer ones make a change hard to notice
TRIED = (0.006, 0.02)  # s, for which the distortion of dry friction is computed; a power between
EXACT = 0.02  # s, torque filter behind exact sensors
RATIO = 5.0 / 3.0  # k/T of docs/noise.md


class Filters(NamedTuple):
    """Filters of the identifier.

    Attributes:
        time_constant: k of the torque filter [s].
        state_order: N of the state filter; 0: none.
        state_time_constant: T of each stage [s].
        motion_error: Part of the torque that the filter distorts.
        noise: Standard deviation of what passes of the noise in one pair [N·m].
    """

    time_constant: float
    state_order: int
    state_time_constant: float
    motion_error: float
    noise: float


def filters_for(robot: Robot, speed: float, inertia: float, torque: float,
                distortion: Callable[[float], float] | None = None) -> Filters:
    """Return the filters with the least sum of distortion and noise.

    Args:
        robot: Its sensors and rate.
        speed: RMS velocity of the fastest joint along the reference [rad/s].
        inertia: Of the joint with the largest inertia [kg·m²].
        torque: RMS torque along the reference, over all joints [N·m].
        distortion: Part of the torque that the filter distorts for T [s], where it is more than
            that of a smooth motion: dry friction changes its sign at once, and a filtered sign is
            not the sign of a filtered velocity. None: there is no dry friction.
    """
    if robot.encoder_counts is None and robot.torque_noise == 0.0:
        return Filters(EXACT, 0, 0.03, 0.0, 0.0)
    error = 0.5 * ORDER * (CANDIDATES * speed) ** 2
    if distortion is not None:
        error = np.maximum(error, _power_through(distortion))
    noise = np.array([_noise(robot, float(each), inertia) for each in CANDIDATES])
    best = int(np.argmin(error * torque + noise))
    constant = float(f'{CANDIDATES[best]:.2g}')
    return Filters(float(f'{RATIO * constant:.2g}'), ORDER, constant, float(error[best]),
                   float(noise[best]))


def _power_through(distortion: Callable[[float], float]) -> np.ndarray:
    """Return the distortion of each candidate: a T^p through those that are computed."""
    short, long = (distortion(each) for each in TRIED)
    if min(short, long) <= 0.0:
        return np.zeros(CANDIDATES.size)
    power = math.log(long / short) / math.log(TRIED[1] / TRIED[0])
    return np.asarray(short * (CANDIDATES / TRIED[0]) ** power)


def _noise(robot: Robot, constant: float, inertia: float) -> float:
    period, k = 1.0 / robot.rate, RATIO * constant
    passed = (math.gamma(1.5) * math.gamma(ORDER - 1.5) / (2.0 * math.pi * math.gamma(ORDER)))
    velocity = robot.resolution / math.sqrt(12.0) * math.sqrt(period * passed / constant ** 3)
    torque = robot.torque_noise * math.sqrt(0.5 * period / (k + ORDER * constant))
    return math.hypot(inertia / k * velocity, torque)


def measured_velocity_noise(robot: Robot) -> float:
    """Return the standard deviation of the velocity that the controller gets [rad/s].

    Differences of positions with errors of variance r²/12, behind v ← a v + (1 − a) Δq/dt with
    a = exp(−dt/T_v): r/√12 (1 − a)/dt √(2/(1 + a)).
    """
    period, constant = 1.0 / robot.rate, robot.velocity_time_constant
    keep = math.exp(-period / constant) if constant > 0.0 else 0.0
    return (robot.resolution / math.sqrt(12.0) * (1.0 - keep) / period
            * math.sqrt(2.0 / (1.0 + keep)))
