# SPDX-License-Identifier: Apache-2.0
"""Motions that are too fast for the state filter: what they would teach is the filter.

The cascade spreads its input over a variance of N T², and a torque f of the filtered position is
not the filtered f: by ½ f″ N T² q̇², of sines and cosines of joint angles the part ½ N T² q̇². For
the reference a filter is chosen for this is little; an arm that falls or is thrown moves ten times
as fast, and its pairs are off by a hundred times as much.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.compiled import borrowed, jit
from adaptive_blf_control.identification.settings import FilterSettings

__all__ = ['Distortion', 'distortion_of', 'follow_distortion', 'is_distorted']


class Distortion(NamedTuple):
    """Part of the torque that the state filter distorts.

    Attributes:
        latest: Of the present pair, changed in place, shape (1,).
        spread: ½ N T² [s²]; 0 where there is no filter, or not ours.
        memory: k of the torque filter, behind which a pair remembers others [s].
        most: From which on a pair does not teach; infinite: never.
    """

    latest: np.ndarray
    spread: float
    memory: float
    most: float


def distortion_of(settings: FilterSettings, latest: np.ndarray) -> Distortion:
    """Return what filters with these settings do; ``latest`` as in `Distortion`."""
    ours = settings.state_filter == 'low_pass'
    spread = 0.5 * settings.state_order * settings.state_time_constant ** 2 if ours else 0.0
    return Distortion(latest, spread, settings.time_constant, settings.distortion or math.inf)


@jit
def follow_distortion(distortion: Distortion, dt: float, qd: np.ndarray) -> None:
    """Take a filtered velocity, shape (n,) [rad/s].

    Args:
        distortion: ``latest`` is changed in place.
        dt: Time since the last sample [s]; 0 where the filters restart.
        qd: The velocity.
    """
    distortion = borrowed(distortion)
    now = 0.0
    for i in range(qd.size):
        now = max(now, distortion.spread * qd[i] * qd[i])
    before = distortion.latest[0] * math.exp(-dt / distortion.memory) if dt > 0.0 else 0.0
    distortion.latest[0] = max(now, before)


@jit
def is_distorted(distortion: Distortion) -> bool:
    """Return whether the present pair is of too fast a motion."""
    distortion = borrowed(distortion)
    return bool(distortion.latest[0] > distortion.most)
