# SPDX-License-Identifier: Apache-2.0
"""``bench steps``: what one candidate and one update of θ̂ cost the identifier."""

from __future__ import annotations

from collections.abc import Mapping
import time
from typing import Any

import numpy as np

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.pair_selection import is_different
from adaptive_blf_control.identification.update_laws import AblfConcurrent, Evidence

__all__ = ['table', 'times_of']

REFUSED, TAKEN, UPDATE = 'candidate refused', 'candidate taken', 'update of θ̂'


class _TimedStack(HistoryStack):
    """Notes the processor time of every candidate that a full stack of full rank looks at."""

    times: dict[str, list[float]]

    def offer(self, regressor: np.ndarray, torque: np.ndarray) -> int:
        looked_at = (self.full and self.rank == self.moment.size
                     and is_different(regressor, self.pairs.last, self.epsilon))
        begin = time.thread_time_ns()
        slot = super().offer(regressor, torque)
        if looked_at:
            self.times[REFUSED if slot < 0 else TAKEN].append(time.thread_time_ns() - begin)
        return slot


class _TimedLaw(AblfConcurrent):
    """Notes the processor time of every update."""

    times: dict[str, list[float]]

    def step(self, theta: np.ndarray, dt: float, evidence: Evidence) -> np.ndarray:
        begin = time.thread_time_ns()
        result = super().step(theta, dt, evidence)
        self.times[UPDATE].append(time.thread_time_ns() - begin)
        return result


def times_of(data: Mapping[str, Any], duration: float) -> dict[str, np.ndarray]:
    """Return the processor times [µs] of the identifier's steps in a scenario, by step.

    Args:
        data: The scenario, as `load_yaml` returns it.
        duration: Of the run [s].
    """
    times: dict[str, list[float]] = {REFUSED: [], TAKEN: [], UPDATE: []}
    loop = build_closed_loop(data)
    settings, arm = loop.identifier.settings, loop.identifier.arm
    history = settings.history
    stack = _TimedStack(arm.n, arm.m, history.size, history.epsilon, history.minimum_growth)
    law = _TimedLaw(settings)
    stack.times = law.times = times
    loop.warm_up()
    loop.identifier = Identifier(arm, settings, law, history_stack=stack)
    loop.run(duration)
    return {step: 1e-3 * np.array(values) for step, values in times.items()}


def table(times: Mapping[str, np.ndarray]) -> str:
    """Return the rows of a Markdown table."""
    lines = ['| step | number | p50 [µs] | p99 [µs] |', '|---|---|---|---|']
    for step, values in times.items():
        p50, p99 = np.percentile(values, [50.0, 99.0]) if values.size else (np.nan, np.nan)
        lines.append(f'| {step} | {values.size} | {p50:.1f} | {p99:.1f} |')
    return '\n'.join(lines)
