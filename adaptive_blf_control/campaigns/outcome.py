# SPDX-License-Identifier: Apache-2.0
"""What one run of a campaign achieved, as one row of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import asdict, dataclass
import math
import threading
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.configuration.build_arm import ArmStore
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_changes
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runs.summary import (
    CONVERGED,
    convergence_time,
    margins_of_run,
    run_of_trace,
    violated_along,
)
from adaptive_blf_control.runs.torque_error import torque_error_of_trace
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace

__all__ = ['Chunk', 'Outcome', 'run_chunk', 'run_one']

_OWN = threading.local()  # arms belong to one thread


class Chunk(NamedTuple):
    """Some runs of a campaign, as a worker gets them.

    Attributes:
        campaign: Same for all chunks of a campaign, and for no others.
        data: The scenario's parameter file.
        duration: Length of each run [s].
        changes: Number of the run, and the parameters that differ from the scenario, by name.
    """

    campaign: str
    data: Mapping[str, Any]
    duration: float
    changes: Sequence[tuple[int, Mapping[str, Any]]]


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run; NaN where a figure has no meaning.

    Attributes:
        run: Its number in the campaign.
        kept: Whether every constraint was strictly kept at every sample.
        violations: Samples in which one was not.
        first_violation_s: Time of the first of them [s].
        least_margin: Smallest margin of the constraints in rad [rad].
        largest_error: Largest |e1| of all joints [rad].
        rms_error_end: RMS of e1 over the last quarter, largest of all joints [rad].
        convergence_time_s: After which ‖θ̃‖ stays under 1 % of ‖θ*‖, in the last epoch of θ* [s].
        parameter_error: ‖θ̃‖ / ‖θ*‖ at the end.
        torque_error: Predicted torque error at the end, largest of all joints.
        rank: Rank of the history at the end.
        problem: Why there was no run, '' where there was one.
    """

    run: int
    kept: bool = False
    violations: int = 0
    first_violation_s: float = math.nan
    least_margin: float = math.nan
    largest_error: float = math.nan
    rms_error_end: float = math.nan
    convergence_time_s: float = math.nan
    parameter_error: float = math.nan
    torque_error: float = math.nan
    rank: int = 0
    problem: str = ''

    def row(self) -> dict[str, Any]:
        """Return it as a row of a table."""
        return asdict(self)


def run_chunk(chunk: Chunk, ended: threading.Event | None = None) -> list[Outcome]:
    """Run some runs of a campaign, one after the other.

    Args:
        chunk: The runs.
        ended: Set where the outcomes are no longer wanted.

    Raises:
        CancelledError: ``ended`` was set before the last run.
    """
    arms, found = _arms(chunk.campaign), []
    for number, change in chunk.changes:
        if ended is not None and ended.is_set():
            raise CancelledError
        found.append(run_one(chunk.data, chunk.duration, number, change, arms))
    return found


def _arms(campaign: str) -> ArmStore:
    """Return the arms that this thread has built for a campaign."""
    if getattr(_OWN, 'campaign', None) != campaign:
        _OWN.campaign, _OWN.arms = campaign, ArmStore()
    return _OWN.arms  # type: ignore[no-any-return]


def run_one(data: Mapping[str, Any], duration: float, number: int,
            change: Mapping[str, Any], arms: ArmStore | None = None) -> Outcome:
    """Run one run; a scenario that is refused, e.g. a start outside a set, is an outcome, too."""
    try:
        loop = build_closed_loop(apply_changes(data, change), arms=arms)
        trace = loop.run(duration)
    except BlfError as error:
        return Outcome(number, problem=str(error))
    return _outcome(number, loop, trace)


def _outcome(number: int, loop: ClosedLoop, trace: Trace) -> Outcome:
    run = run_of_trace(loop, trace)
    margins = margins_of_run(run)
    violated = np.flatnonzero(violated_along(run, margins))
    last = run.t >= run.t[0] + 0.75 * (run.t[-1] - run.t[0])
    figures: dict[str, Any] = {}
    if run.truth:
        start, true = [epoch for epoch in run.truth if epoch[0] <= run.t_theta[-1] + 1e-9][-1]
        since = run.t_theta >= start - 1e-9
        error = np.linalg.norm(run.theta_hat[since] - true, axis=1)
        norm = float(np.linalg.norm(true))
        converged = convergence_time(run.t_theta[since] - start, error, CONVERGED * norm)
        torque = [value for value in torque_error_of_trace(loop, trace) if value is not None]
        figures = {
            'convergence_time_s': math.nan if converged is None else converged,
            'parameter_error': float(error[-1]) / norm if norm else math.nan,
            'torque_error': max(torque, default=math.nan)}
    return Outcome(
        number, kept=not violated.size, violations=int(violated.size),
        first_violation_s=float(run.t[violated[0]]) if violated.size else math.nan,
        least_margin=min((float(np.nanmin(each.values)) for each in margins if each.unit == 'rad'),
                         default=math.nan),
        largest_error=float(np.abs(run.e1).max()),
        rms_error_end=float(np.sqrt(np.mean(run.e1[last] ** 2, axis=0)).max()),
        rank=run.rank, **figures)
