# SPDX-License-Identifier: Apache-2.0
"""A scenario run offline in one call, and what it achieved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import functools
import json
from pathlib import Path
from typing import Any

from adaptive_blf_control.configuration.build import build_closed_loop
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.configuration.parameter_file import (
    apply_settings,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.runs.run_guarantee import guarantee_of_trace, RunGuarantee
from adaptive_blf_control.runs.summary import run_of_trace, summarise, table
from adaptive_blf_control.runs.torque_error import torque_error_of_trace, torque_line
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Sample, Trace

__all__ = ['Simulation', 'duration_of', 'simulate']

USUAL_DURATION = 20.0  # s, where neither the caller nor the scenario says


@dataclass(frozen=True, repr=False)
class Simulation:
    """A run of the closed loop.

    Attributes:
        loop: The objects that ran; ``loop.identifier`` holds what was learned.
        trace: The run as arrays over N samples: t, q, qd, e1, torque, theta_hat, rank, sigma_min.
    """

    loop: ClosedLoop
    trace: Trace

    @functools.cached_property
    def _summary(self) -> dict[str, Any]:
        return summarise(run_of_trace(self.loop, self.trace))

    @functools.cached_property
    def _run_guarantee(self) -> RunGuarantee | None:
        return guarantee_of_trace(self.loop, self.trace)

    @property
    def kept(self) -> bool:
        """Whether every joint stayed strictly inside both of its sets at every sample."""
        return bool(self._summary['set_violations'] == 0)

    def figures(self) -> dict[str, Any]:
        """Return what the run achieved, as plain values for JSON; see `summarise`."""
        figures, guarantee = dict(self._summary), self._run_guarantee
        figures['guarantee'] = None if guarantee is None else guarantee.figures()
        figures['predicted_torque_error'] = torque_error_of_trace(self.loop, self.trace)
        figures['wall_s'] = self.trace.wall_s
        figures['real_time_factor'] = float(self.trace.t[-1] / self.trace.wall_s)
        return figures

    def __repr__(self) -> str:
        """Say what the run achieved, as a table."""
        figures, guarantee = self.figures(), self._run_guarantee
        return '\n'.join([
            table(figures, run_of_trace(self.loop, self.trace)),
            torque_line(figures['predicted_torque_error']),
            'Theorem 2            theta* of the plant is not known' if guarantee is None
            else guarantee.line(),
            f'speed                {figures["real_time_factor"]:.1f} x real time'])


def duration_of(data: Mapping[str, Any], duration: float | None) -> float:
    """Return how long a run lasts [s]: as given, else as the scenario says, else 20 s."""
    if duration is None:
        return node_settings(data, DriverSettings).duration or USUAL_DURATION
    if not (isinstance(duration, (int, float)) and 0.0 < duration < float('inf')):
        raise ParameterError('duration', duration, 'a time > 0 s')
    return float(duration)


def simulate(scenario: str | Path | Mapping[str, Any] | ClosedLoop,
             duration: float | None = None, changes: Mapping[str, Any] | None = None,
             observer: Callable[[Sample], None] | None = None) -> Simulation:
    """Run a scenario in lockstep without ROS: the same objects that run in the nodes.

    Args:
        scenario: A parameter file, e.g. ``config/two_link.yaml``, its data, or a `ClosedLoop`
            joined by hand, e.g. around a plant of one's own.
        duration: Length of the run [s]; the scenario's, else 20 s, where None.
        changes: Parameters by ``node.name``, e.g. ``{'controller.k2': [30.0, 5.0]}``; without a
            node's name for every node that knows them.
        observer: Called with every sample.

    Raises:
        ParameterError: a parameter is not known or cannot be used.
        SetViolation: the start is outside a set, or one set pokes out of another (9).
        ArmError: the arm cannot be built.
    """
    if isinstance(scenario, ClosedLoop):
        if changes:
            raise ParameterError('changes', dict(changes), 'none beside a loop joined by hand')
        loop, length = scenario, duration_of({}, duration)
    else:
        data = scenario if isinstance(scenario, Mapping) else load_yaml(scenario)
        data = apply_settings(data, [f'{name}={json.dumps(value)}'
                                     for name, value in (changes or {}).items()])
        loop, length = build_closed_loop(data), duration_of(data, duration)
    loop.warm_up()
    return Simulation(loop, loop.run(length, observer))
