# SPDX-License-Identifier: Apache-2.0
"""The result of an identification from a log, as numbers and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.runs.batch_fit import least_squares
from adaptive_blf_control.runs.log_pass import LogPass, Section
from adaptive_blf_control.runs.model_report import model_lines, OF_MEDIAN

__all__ = ['figures_of', 'table']


def figures_of(sections: Sequence[Section], identifier: Identifier,
               result: LogPass) -> dict[str, Any]:
    """Return the figures; lists are in the order of the joints, RMSE in N·m, None without a test.

    Spans are those of the first log, ``period_us`` too; ``spans`` has those of all of them.
    ``batch_test_rmse`` is that of least squares over all pairs of the training span,
    ``test_torque_rms`` the RMS of the filtered torque itself, ``us_per_sample`` the median time
    of an update [µs], where each time is a mean over `TIMED` samples.
    """
    first = sections[0]
    arm, stack, theta = identifier.arm, identifier.stack, identifier.theta
    microseconds = 1e6 * result.seconds
    train, test = result.train, result.test

    def tested(model: np.ndarray) -> list[float | None]:
        return test.rmse(model).tolist() if test.count else [None] * arm.n

    return {
        'joints': list(arm.joints),
        'columns': arm.m,
        'samples': sum(int(section.log.t.size) for section in sections),
        'dropped': (sum(section.log.dropped for section in sections)
                    + sum(identifier.dropped.values())),
        'restarts': identifier.restarts - 1,  # the first start is not counted
        'train_span': list(first.train),
        'test_span': list(first.test),
        'spans': [{'train': list(section.train), 'test': list(section.test)}
                  for section in sections],
        'train_samples': train.count,
        'test_samples': test.count,
        'train_rmse': train.rmse(theta).tolist(),
        'test_rmse': tested(theta),
        'test_torque_rms': tested(np.zeros(arm.m)),
        'batch_test_rmse': tested(least_squares(train)),
        'history_rank': stack.rank,
        'history_sigma_min': stack.sigma_min,
        'history_size': stack.size,
        'history_count': stack.count,
        'insertions': stack.insertions,
        'us_per_sample': float(np.median(microseconds)),
        'us_per_sample_mean': float(np.mean(microseconds)),
        'us_per_sample_p99': float(np.percentile(microseconds, 99.0)),
        'period_us': float(1e6 * np.median(np.diff(first.log.t[:OF_MEDIAN]))),
        'undetermined': list(identifier.undetermined),
        'theta_hat': identifier.estimate,
    }


def table(figures: dict[str, Any], source: str) -> str:
    """Return the figures as a short table."""
    columns = [np.array(figures[name], dtype=float) for name in (
        'test_torque_rms', 'train_rmse', 'test_rmse', 'batch_test_rmse')]
    width = max([len(joint) for joint in figures['joints']] + [5])
    lines = [
        f'{source}: {len(figures["joints"])} joints, {figures["columns"]} parameters, '
        f'{figures["samples"]} samples, {1e6 / figures["period_us"]:.0f} Hz',
        *_spans(figures),
        '',
        f'{"RMSE of the filtered torque [N·m]":<{width}}',
        f'{"joint":<{width}}{"learned":>10}{"tested":>10}{"of torque":>12}'
        f'{"batch least squares":>22}',
    ]
    names = [*figures['joints'], 'mean']
    rows = [*np.transpose(columns), np.mean(columns, axis=1)]
    for name, (torque, train, test, batch) in zip(names, rows):
        part = f'{test / torque:.1%}' if torque > 0.0 else '-'
        lines.append(f'{name:<{width}}{train:>10.4f}{_or_none(test):>10}{part:>12}'
                     f'{_or_none(batch):>22}')
    period, median = figures['period_us'], figures['us_per_sample']
    full = figures['history_rank'] == figures['columns']
    lines += [
        '',
        f'history stack   rank {figures["history_rank"]} of {figures["columns"]}'
        + ('' if full else ' (the motion does not determine every parameter)')
        + f', σ_min {figures["history_sigma_min"]:.3g}{_condition(figures)}, '
        f'{figures["insertions"]} pairs taken, '
        f'{figures["history_count"]} of {figures["history_size"]} slots filled',
        f'speed           {median:.0f} us per sample (median; mean '
        f'{figures["us_per_sample_mean"]:.0f}, p99 {figures["us_per_sample_p99"]:.0f}): '
        f'{period / median:.1f} x the rate of the robot ({period:.0f} us)',
        f'left out        {figures["dropped"]} samples; filter restarted '
        f'{figures["restarts"]} times',
    ]
    lines += _verdicts(figures.get('verdicts', {}))
    if figures.get('undetermined'):
        lines.append(f'not determined  {", ".join(figures["undetermined"])}')
    lines += model_lines(figures)
    lines += [f'{label:<16}{figures[name]}' for name, label in (
        ('output', 'theta_hat'), ('model_output', 'consistent'), ('urdf_output', 'URDF'))
        if name in figures]
    return '\n'.join(lines)


def _condition(figures: dict[str, Any]) -> str:
    """Return the condition of the recorded regressors, '' where none were judged."""
    condition = figures.get('condition')
    return '' if condition is None else f', condition {condition:.3g}'


def _verdicts(verdicts: dict[str, str]) -> list[str]:
    """Return what the checks of the log say of the joints."""
    odd = [f'{joint}: {text}' for joint, text in verdicts.items() if text != 'sound']
    sound = len(verdicts) - len(odd)
    if not verdicts:
        return []
    first = f'log checks      {sound} of {len(verdicts)} joints sound'
    return [first, *(f'{"":<16}{text}' for text in odd)]


def _spans(figures: dict[str, Any]) -> list[str]:
    """Return what was learned from and tested on, a line for each of several logs."""
    one = len(figures['spans']) == 1
    lines = []
    for number, span in enumerate(figures['spans'], 1):
        learned, tested = (span[kind][0] < span[kind][1] for kind in ('train', 'test'))
        lines.append(('' if one else f'log {number}: ') + ', '.join([
            f'learned from {_seconds(span["train"])} in one pass' if learned else 'not learned',
            f'tested on {_seconds(span["test"])}' if tested else 'not tested']))
    return lines


def _seconds(span: list[float]) -> str:
    return f'{span[0]:.2f} .. {span[1]:.2f} s'


def _or_none(value: float) -> str:
    return '-' if np.isnan(value) else f'{value:.4f}'
