# SPDX-License-Identifier: Apache-2.0
"""What is compared between laws: tracking, margins, learning, effort and chatter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from adaptive_blf_control.bench.comparison import Compared
from adaptive_blf_control.runs.margins import violated_at
from adaptive_blf_control.runs.summary import (
    CONVERGED,
    convergence_time,
    margins_of_run,
    run_of_trace,
)
from adaptive_blf_control.runs.torque_error import PredictedTorque
from adaptive_blf_control.simulation.plant import known_truth

__all__ = ['COLUMNS', 'law_figures', 'markdown_row']

EVERY = 20
"""Samples between two estimates that are compared."""


def _rms(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.mean(values ** 2, axis=0)))


def law_figures(run: Compared) -> dict[str, Any]:
    """Return the figures of a run, per joint in the order of the joints, and overall.

    Overall is the RMS over all joints for RMS values, the worst joint otherwise. Convergence
    times, whose keys say ``settling``, are None if the law has no estimate or it does not
    converge: of θ̃ (1 % in norm) and of the torque predicted along the reference (1 %, every
    joint).
    """
    trace = run.trace
    margins = margins_of_run(run_of_trace(run.loop, trace))
    [performance] = [each.values for each in margins if each.constraint == 'performance']
    joints = {'rms_error': _rms(trace.e1), 'max_abs_error': np.abs(trace.e1).max(axis=0),
              'min_margin': performance.min(axis=0), 'rms_torque': _rms(trace.torque),
              'chatter': _rms(np.diff(trace.torque, axis=0))}
    figures: dict[str, Any] = {name: value.tolist() for name, value in joints.items()}
    figures['set_violations'] = int(np.count_nonzero(violated_at(trace.t, margins)))
    figures['overall'] = {
        name: float(value.min() if name == 'min_margin' else value.max()
                    if name == 'max_abs_error' else _rms(value))
        for name, value in joints.items()}
    figures.update(_learning(run))
    return figures


def _learning(run: Compared) -> dict[str, Any]:
    figures: dict[str, Any] = {'theta_error': None, 'theta_settling_time_s': None,
                               'predicted_torque_error': None, 'torque_settling_time_s': None}
    if run.theta is None:
        return figures
    loop, times = run.loop, run.trace.t
    t, theta = times[::EVERY], run.theta[::EVERY]
    true = known_truth(loop.plant, loop.arm.parameters)[-1][1]
    relative = np.linalg.norm(theta - true, axis=1) / np.linalg.norm(true)
    predicted = PredictedTorque(loop.arm, loop.controller.reference,
                                float(times[-1])).error(theta, true)
    figures['theta_error'] = float(relative[-1])
    figures['theta_settling_time_s'] = convergence_time(t, relative, CONVERGED)
    figures['predicted_torque_error'] = predicted[-1].tolist()
    figures['torque_settling_time_s'] = convergence_time(t, predicted.max(axis=1), CONVERGED)
    return figures


COLUMNS = ('law', 'RMS e1 [mrad]', 'largest e1 [mrad]', 'margin [mrad]', 'samples outside',
           'theta within 1 % [s]', 'torque within 1 % [s]', 'torque error at the end [%]',
           'RMS torque [N·m]', 'chatter [mN·m]')
"""Columns of the table; joints are separated by slashes."""


def _joints(values: list[float], factor: float, digits: int = 3) -> str:
    return ' / '.join(f'{factor * value:.{digits}g}' for value in values)


def _seconds(value: float | None, learns: bool) -> str:
    return '–' if not learns else 'no' if value is None else f'{value:.2f}'


def markdown_row(name: str, figures: dict[str, Any], learns: bool) -> str:
    """Return one row of the table; ``learns`` is False for laws with a fixed model or none."""
    error = figures['predicted_torque_error']
    cells = [
        name, _joints(figures['rms_error'], 1e3), _joints(figures['max_abs_error'], 1e3),
        _joints(figures['min_margin'], 1e3), str(figures['set_violations']),
        _seconds(figures['theta_settling_time_s'], learns),
        _seconds(figures['torque_settling_time_s'], learns),
        '–' if error is None or not all(map(math.isfinite, error)) else _joints(error, 1e2, 2),
        _joints(figures['rms_torque'], 1.0), _joints(figures['chatter'], 1e3)]
    return '| ' + ' | '.join(cells) + ' |'
