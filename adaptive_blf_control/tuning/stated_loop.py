# SPDX-License-Identifier: Apache-2.0
"""The delay of a loop as the settings of controller and driver state it."""

from __future__ import annotations

from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.control.loop_settings import LoopSettings
from adaptive_blf_control.tuning.loop_delay import loop_delay, LoopDelay

__all__ = ['simulated_delay', 'stated_delay']


def stated_delay(settings: LoopSettings) -> LoopDelay:
    """Return the delay that the controller is told."""
    return loop_delay(settings.rate, settings.delay, settings.velocity_lag)


def simulated_delay(settings: DriverSettings) -> LoopDelay:
    """Return the delay of the simulated drives and sensors."""
    period, sensors = 1.0 / settings.rate, settings.sensors
    lag = sensors.velocity_time_constant + 0.5 * period if sensors.model == 'encoder' else 0.0
    actuator = settings.actuator
    delay = settings.dead_time * period + actuator.delay + actuator.jitter
    return loop_delay(settings.rate, delay, lag)
