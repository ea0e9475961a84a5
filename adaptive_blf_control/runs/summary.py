# SPDX-License-Identifier: Apache-2.0
"""What a run achieved, as numbers and as a table: the same for simulate, the demo and a bag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from adaptive_blf_control.control.constraints import Constraints, MotionState
from adaptive_blf_control.control.sets import Bounds, JointInterval
from adaptive_blf_control.runs.margins import (
    closest_by_unit,
    least_per_joint,
    margin_figures,
    Margins,
    margins_along,
    violated_at,
)
from adaptive_blf_control.runs.torque_use import (
    name_width,
    oscillation_text,
    oscillations,
    torque_figures,
    torque_table,
    TorqueUse,
)
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace
from adaptive_blf_control.simulation.failure import Failure
from adaptive_blf_control.simulation.plant import truth_of
from adaptive_blf_control.simulation.true_arm import Truth

__all__ = ['CONVERGED', 'Run', 'listed', 'margins_of_run', 'run_of_trace', 'convergence_time',
           'state_along', 'summarise', 'table', 'violated_along']

MISSING = 0.5  # of the length that was asked for, which the start of a motion may take [s]
CONVERGED = 0.01  # part of ‖θ*‖ under which ‖θ̃‖ counts as converged


@dataclass(frozen=True)
class Run:
    """A run as arrays.

    Attributes:
        joints: Joint names, length n.
        parameters: Parameter names, length m.
        t: Sample times of q and e1, shape (N,) [s].
        q: Positions, shape (N, n) [rad].
        qd: Velocities, shape (N, n) [rad/s].
        e1: Tracking errors, shape (N, n) [rad].
        t_theta: Times of the estimates, shape (K,) [s].
        theta_hat: Estimates, shape (K, m).
        rank: Rank of the history stack at the end.
        sigma_min: σ_min of the history stack at the end.
        safety: Safety set (7).
        performance: Performance set (8), as wide as it gets.
        constraints: What counts as inside.
        truth: (t, θ*) from t [s] on, in ascending order from 0, where θ* is known.
        unanswered: States the controller gave no answer to, with e1 unknown (NaN); they count
            where a constraint needs no e1.
        published: Margins of constraints that are not known here, as the controller sent them.
        torques: Commanded torques, where they are known.
        failure: The first state or torque that is not finite; what follows counts as outside.
    """

    joints: tuple[str, ...]
    parameters: tuple[str, ...]
    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    e1: np.ndarray
    t_theta: np.ndarray
    theta_hat: np.ndarray
    rank: int
    sigma_min: float
    safety: JointInterval
    performance: JointInterval
    constraints: Constraints
    truth: Truth | None = None
    unanswered: MotionState | None = None
    published: tuple[Margins, ...] = ()
    torques: TorqueUse | None = None
    failure: Failure | None = None

    def theta_true(self, t: np.ndarray) -> np.ndarray:
        """Return θ* at the times ``t`` (K,) [s], shape (K, m); NaN where it is not known."""
        if not self.truth:
            return np.full((t.size, len(self.parameters)), np.nan)
        epoch = np.searchsorted([start for start, _ in self.truth], t + 1e-9, side='right') - 1
        return np.array([theta for _, theta in self.truth])[np.maximum(epoch, 0)]


def run_of_trace(loop: ClosedLoop, trace: Trace) -> Run:
    """Return a trace of the closed loop as a run to summarise."""
    return Run(loop.arm.joints, loop.arm.parameters, trace.t, trace.q, trace.qd, trace.e1,
               trace.t, trace.theta_hat, int(trace.rank[-1]), float(trace.sigma_min[-1]),
               loop.controller.safety, loop.controller.performance,
               loop.controller.constraints, truth_of(loop.plant, loop.arm.parameters),
               torques=TorqueUse(trace.torque, loop.controller.settings.resolved(
                   joints=loop.arm.n).torque_limit), failure=trace.failure)


def state_along(t: np.ndarray, q: np.ndarray, qd: np.ndarray, e1: np.ndarray,
                performance: JointInterval) -> MotionState:
    """Return a run as the constraints see it, the performance set as wide as it gets."""
    rest = np.zeros_like(performance.lower)
    return MotionState(t, q, qd, e1, Bounds(performance.lower, performance.upper, rest, rest))


def margins_of_run(run: Run) -> tuple[Margins, ...]:
    """Return the margins of all constraints along a run."""
    states = state_along(run.t, run.q, run.qd, run.e1, run.performance)
    return margins_along(run.constraints, states) + run.published


def violated_along(run: Run, margins: tuple[Margins, ...]) -> np.ndarray:
    """Return which samples are not inside, or come after a failure, shape (N,), bool."""
    violated = violated_at(run.t, margins)
    return violated if run.failure is None else violated | (run.t >= run.failure.t)


def _violations(run: Run, margins: tuple[Margins, ...]) -> int:
    """Number of samples that are not inside, those without an answer included."""
    count = int(np.count_nonzero(violated_along(run, margins)))
    if run.unanswered is not None and run.unanswered.q.size:
        beyond = (run.constraints.margins_along(run.unanswered) <= 0.0).any(axis=1)
        count += int(np.count_nonzero(beyond | ~np.isfinite(run.unanswered.q).all(axis=1)))
    return count


def convergence_time(t: np.ndarray, error: np.ndarray, threshold: float) -> float | None:
    """Return the first time [s] after which ``error`` stays under ``threshold``, or None."""
    above = np.flatnonzero(~(error < threshold))
    if above.size == 0:
        return float(t[0])
    return float(t[above[-1] + 1]) if above[-1] + 1 < t.size else None


def _convergence_times(run: Run, truth: Truth, error: np.ndarray) -> list[float | None]:
    """Convergence time in each epoch of θ*, from its start [s]."""
    times: list[float | None] = []
    for (start, theta), end in zip(truth, [*(t for t, _ in truth[1:]), np.inf]):
        inside = (run.t_theta >= start - 1e-9) & (run.t_theta < end - 1e-9)
        if inside.any():
            times.append(convergence_time(run.t_theta[inside] - start, error[inside],
                                       CONVERGED * float(np.linalg.norm(theta))))
    return times


def summarise(run: Run) -> dict[str, Any]:
    """Return the figures of a run; per-joint values are lists in the order of the joints.

    ``set_violations`` counts samples in which some constraint is not strictly kept, ``margins``
    has the closest approach of each, ``min_margin`` is the smallest distance to a bound of either
    set per joint [rad]; None after a failure, of which ``failure`` says what it was.
    """
    margins = margins_of_run(run)
    last = run.t >= run.t[0] + 0.75 * (run.t[-1] - run.t[0])
    figures: dict[str, Any] = {
        'joints': list(run.joints),
        'duration_s': float(run.t[-1] - run.t[0]),
        'samples': int(run.t.size),
        'set_violations': _violations(run, margins),
        'max_abs_error': np.abs(run.e1).max(axis=0).tolist(),
        'rms_error': np.sqrt(np.mean(run.e1 ** 2, axis=0)).tolist(),
        'rms_error_last_quarter': np.sqrt(np.mean(run.e1[last] ** 2, axis=0)).tolist(),
        'failure': None if run.failure is None else str(run.failure),
        'min_margin': (least_per_joint(run.joints, margins) if run.failure is None
                       else [None] * len(run.joints)),
        'margins': margin_figures(margins),
        'theta_hat': dict(zip(run.parameters, run.theta_hat[-1].tolist())),
        'theta_error_norm': None,
        'theta_true_norm': None,
        'theta_settling_time_s': None,
        'theta_settling_times_s': [],
        'history_rank': run.rank,
        'history_sigma_min': run.sigma_min,
        'oscillation': oscillations(run.t, run.e1, run.performance.lower, run.performance.upper),
        **torque_figures(run.torques),
    }
    if run.truth:
        true = run.theta_true(run.t_theta)
        error = np.linalg.norm(run.theta_hat - true, axis=1)
        figures['theta_error_norm'] = float(error[-1])
        figures['theta_true_norm'] = float(np.linalg.norm(true[-1]))
        times = figures['theta_settling_times_s'] = _convergence_times(run, run.truth, error)
        figures['theta_settling_time_s'] = times[0]
    return figures


def listed(words: list[str]) -> str:
    """Return words as a sentence lists them: a, b and c."""
    return ' and '.join(filter(None, [', '.join(words[:-1]), words[-1]])) if words else 'no'


def table(figures: dict[str, Any], run: Run, asked: float | None = None) -> str:
    """Return the figures as a short table a person reads.

    Args:
        figures: See `summarise`.
        run: The run.
        asked: How long it should have been [s]; where it ended before, that comes first.
    """
    kept, wide = figures['set_violations'] == 0, name_width(figures['joints'])
    lines = [
        *([] if run.failure is None else
          [f'FAILED: {run.failure}; what follows counts as outside']),
        *([] if asked is None or figures['duration_s'] > asked - MISSING else
          [f'ENDED after {figures["duration_s"]:.1f} of {asked:g} s, which the figures are of']),
        f'{listed([each["constraint"] for each in figures["margins"]])} sets: '
        + ('KEPT' if kept else 'LEFT')
        + ('' if kept else f' in {figures["set_violations"]} of {figures["samples"]} samples')
        + f'  ({figures["duration_s"]:.1f} s, {figures["samples"]} samples)',
        *(f'attention: {text}' for text in filter(None, [oscillation_text(figures)])),
        '',
        f'{"joint":<{wide}}{"largest |e1|":>14}{"RMS e1":>12}{"RMS last 1/4":>14}'
        f'{"error bound":>20}{"least margin":>14}   [rad]',
    ]
    for i, joint in enumerate(figures['joints']):
        bound = f'{run.performance.lower[i]:+.3g} .. {run.performance.upper[i]:+.3g}'
        lines.append(
            f'{joint:<{wide}}{figures["max_abs_error"][i]:>14.5f}{figures["rms_error"][i]:>12.2e}'
            f'{figures["rms_error_last_quarter"][i]:>14.2e}{bound:>20}'
            + ('unknown' if figures['min_margin'][i] is None
               else f'{figures["min_margin"][i]:.4f}').rjust(14))
    lines += [f'{each["constraint"]:<21}least margin {each["margin"]:.4g} {each["unit"]}, '
              f'{each["body"]} at {each["t"]:.2f} s'
              for each in closest_by_unit(figures['margins']) if each['unit'] != 'rad']
    lines += [*torque_table(figures), '']
    if run.truth:
        settled = figures['theta_settling_times_s']
        lines.append(
            f'parameter error      {figures["theta_error_norm"]:.3g} of '
            f'{figures["theta_true_norm"]:.3g} in norm; '
            + ', '.join(('' if not i else f'from {run.truth[i][0]:g} s on ')
                        + (f'not within {CONVERGED:.0%} yet' if t is None
                           else f'within {CONVERGED:.0%} after {t:.2f} s')
                        for i, t in enumerate(settled)))
    lines.append(f'history stack        rank {figures["history_rank"]} of {len(run.parameters)}, '
                 f'σ_min {figures["history_sigma_min"]:.3g}')
    return '\n'.join(lines)
