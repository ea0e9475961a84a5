# SPDX-License-Identifier: Apache-2.0
"""Timing of a recorded run: sample intervals, missed periods, delays, counts per topic."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.configuration.parameter_file import node_settings
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runs.recording import Recording

__all__ = ['command_delays_ms', 'intervals_ms', 'percentiles', 'period_ms', 'timing']


def intervals_ms(recording: Recording) -> np.ndarray:
    """Intervals between the stamps of successive joint states, shape (N − 1,) [ms]."""
    if recording.states is None:
        return np.zeros(0)
    return np.diff(recording.states.stamp_ns) * 1e-6


def command_delays_ms(recording: Recording) -> np.ndarray:
    """Delay from each state to the first command after it, as the recorder received them [ms].

    A command has no stamp, so a state whose command was lost counts up to the next command.
    States before the first answered one are left out. An offline run has zeros.
    """
    states, commands = recording.states, recording.commands_ns
    if states is None or commands is None or commands.size == 0:
        return np.zeros(0)
    heard = states.log_time_ns
    if recording.answered is not None and recording.q is not None:
        heard = heard[recording.q.t >= 0.0]
    commands = np.maximum.accumulate(commands)
    index = np.searchsorted(commands, heard)
    answered = index < commands.size
    return (commands[index[answered]] - heard[answered]) * 1e-6


def period_ms(recording: Recording) -> float | None:
    """Nominal period [ms]: of the driver's rate if it is in the bag, else the median interval."""
    data = recording.parameters
    if data and any(key.endswith('/arm_driver') for key in data):
        try:
            return 1e3 / node_settings(data, DriverSettings).rate
        except (BlfError, KeyError):
            pass
    intervals = intervals_ms(recording)
    return float(np.median(intervals)) if intervals.size else None


def percentiles(values: np.ndarray) -> dict[str, float] | None:
    """Return min, median, 99th percentile and max; None for no values."""
    if values.size == 0:
        return None
    low, p50, p99, high = np.percentile(values, [0.0, 50.0, 99.0, 100.0])
    return {'min': float(low), 'p50': float(p50), 'p99': float(p99), 'max': float(high)}


def timing(recording: Recording) -> dict[str, Any]:
    """Return the timing figures of a run.

    ``missed_periods`` counts grid points without a sample, ``gaps`` intervals longer than 1.5
    periods, ``out_of_order`` stamps that are not after the previous one, ``unanswered`` states
    after the first answered one without a tracking error.
    """
    intervals, period = intervals_ms(recording), period_ms(recording)
    missed = gaps = unanswered = None
    if intervals.size and period:
        missed = int(np.maximum(np.rint(intervals / period) - 1.0, 0.0).sum())
        gaps = int(np.count_nonzero(intervals > 1.5 * period))
    if recording.answered is not None and recording.q is not None:
        unanswered = int(np.count_nonzero(recording.q.t >= 0.0)) - recording.answered.t.size
    return {
        'period_ms': period,
        'interval_ms': percentiles(intervals),
        'missed_periods': missed,
        'gaps': gaps,
        'out_of_order': int(np.count_nonzero(intervals <= 0.0)) if intervals.size else None,
        'unanswered': unanswered,
        'skipped': recording.states.skipped if recording.states else None,
        'command_delay_ms': percentiles(command_delays_ms(recording)),
        'drops': recording.drops,
        'topics': _topics(recording),
    }


def _topics(recording: Recording) -> list[dict[str, Any]]:
    span = None
    if recording.states is not None and recording.states.stamp_ns.size > 1:
        span = float(np.ptp(recording.states.stamp_ns)) * 1e-9
    return [{'name': info.name, 'type': info.type_name, 'count': info.count,
             'rate_hz': (info.count - 1) / span if span and info.count > 1 else None}
            for info in sorted(recording.topics.values(), key=lambda item: item.name)]
