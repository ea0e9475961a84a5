# SPDX-License-Identifier: Apache-2.0
"""Parameters of an encoder that are set although no encoder measures."""

from __future__ import annotations

from collections.abc import Iterable

from adaptive_blf_control.simulation.plant import Plant
from adaptive_blf_control.simulation.sensors import PerfectSensor

__all__ = ['encoder_warning', 'unused_of_encoder']

_OF_ENCODER = ('sensors.encoder_counts', 'sensors.gear_ratio', 'sensors.velocity_time_constant')


def unused_of_encoder(given: Iterable[str], plant: Plant) -> list[str]:
    """Return those of the given parameters that only an encoder has a use for.

    Args:
        given: Names of the driver's parameters that somebody has set.
        plant: What is driven.

    Returns:
        Names in the order given; none where the plant does not measure its true state.
    """
    sensor = getattr(plant, 'sensor', None)
    if not isinstance(getattr(sensor, 'sensor', sensor), PerfectSensor):
        return []
    return [name for name in given if name in _OF_ENCODER]


def encoder_warning(given: Iterable[str], plant: Plant) -> str:
    """Return a sentence about the first of `unused_of_encoder`, '' where there is none."""
    unused = unused_of_encoder(given, plant)
    return (f"arm_driver.{unused[0]} is without effect: only arm_driver.sensors.model 'encoder' "
            'looks at it') if unused else ''
