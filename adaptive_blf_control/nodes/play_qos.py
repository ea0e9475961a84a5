# SPDX-License-Identifier: Apache-2.0
"""The QoS that a player offers, from the profiles of the recorded publishers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

__all__ = ['qos_of']

# Deep enough that a burst at a high rate is not overwritten before a reliable reader has it.
QUEUE_DEPTH = 1000
QUEUE_DEPTH_LATCHED = 10
INFINITE = 9_000_000_000  # s, and longer


def qos_of(profiles: Sequence[Mapping[str, Any]]) -> QoSProfile:
    """Return the profile with which one publisher reaches every subscriber of the recorded ones.

    Where they differed, the strongest offer is made, which every subscriber accepts. DDS does not
    announce history and depth, so a bag does not have them.

    Args:
        profiles: As in the bag's metadata; may be empty.
    """
    latched = any(_word(p, 'durability') in ('transient_local', '1') for p in profiles)
    best_effort = bool(profiles) and all(
        _word(p, 'reliability') in ('best_effort', '2') for p in profiles)
    known = max((int(p.get('depth', 0)) for p in profiles), default=0)
    qos = QoSProfile(depth=known or (QUEUE_DEPTH_LATCHED if latched else QUEUE_DEPTH))
    qos.reliability = (ReliabilityPolicy.BEST_EFFORT if best_effort
                       else ReliabilityPolicy.RELIABLE)
    qos.durability = (DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE)
    if len(profiles) == 1:
        _copy_times(profiles[0], qos)
    return qos


def _word(profile: Mapping[str, Any], key: str) -> str:
    return str(profile.get(key, '')).lower()


def _copy_times(profile: Mapping[str, Any], qos: QoSProfile) -> None:
    for key in ('deadline', 'lifespan', 'liveliness_lease_duration'):
        value = profile.get(key) or {}
        sec, nsec = int(value.get('sec', 0)), int(value.get('nsec', 0))
        if 0 < sec * 10**9 + nsec < INFINITE * 10**9:
            setattr(qos, key, Duration(seconds=sec, nanoseconds=nsec))
    if _word(profile, 'liveliness') in ('manual_by_topic', '3'):
        qos.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
