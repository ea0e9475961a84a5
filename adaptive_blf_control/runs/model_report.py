# SPDX-License-Identifier: Apache-2.0
"""What a log has taught about the model itself: is it a possible robot, and how sure is it."""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import Any

import numpy as np

from adaptive_blf_control.bags.row_store import row_blocks
from adaptive_blf_control.identification.confidence import (
    confidence,
    DETERMINED,
    helpful_motion,
    NOT,
    WEAKLY,
)
from adaptive_blf_control.identification.consistent_model import ConsistentModel
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.runs.log_pass import LogPass, Prediction
from adaptive_blf_control.runs.model_check import positive_postures, POSTURES

__all__ = ['KINDS', 'OF_MEDIAN', 'model_figures', 'model_lines', 'parameter_note',
           'parameter_table']

_CONDITION = 1e4  # a direction is shown ten thousand times less than another: rank in name only
OF_MEDIAN = 200_000  # rows of a long log that a median is taken of
KINDS = {'range': 'slowly through its range', 'speeds': 'at several speeds',
          'reversals': 'with quick reversals'}
_MEANINGS = (
    ('.', 'mx, my, mz [kg·m] and Ixx .. Izz [kg·m²] are sums over a link and others on which the '
     'torque depends, not values of that link alone'),
    ('Ia_', 'Ia rotor inertia [kg·m²]'), ('fv_', 'fv viscous friction [N·m·s/rad]'),
    ('fc_', 'fc Coulomb friction [N·m]'), ('f0_', 'f0 constant torque [N·m]'),
    ('fs_', 'fs friction that grows with √|q̇| [N·m·√(s/rad)]'))


def model_figures(identifier: Identifier, result: LogPass, consistent: ConsistentModel | None,
                  seconds: float) -> dict[str, Any]:
    """Return the figures; lists are in the order of the joints, None where there is no value.

    ``positive_mass`` counts postures of a thousand with M(q) > 0; ``test_coverage`` is the part
    of the test's torques inside their 95 % intervals, ``test_half_width`` the median half width
    of these [N·m]; ``condition`` that of the recorded regressors with columns of length one.

    Args:
        identifier: After the pass.
        result: Of the pass.
        consistent: The consistent model, None where there is none.
        seconds: Time it took to find.
    """
    arm, stack = identifier.arm, identifier.stack
    judged, test = result.uncertainty, result.test
    figures: dict[str, Any] = {'positive_mass': {
        'postures': POSTURES, 'theta_hat': positive_postures(arm, identifier.theta)}}
    if consistent is not None:
        figures['positive_mass']['consistent'] = positive_postures(arm, consistent.theta)
        figures['consistent'] = {
            'test_rmse': test.rmse(consistent.theta).tolist() if test.count else [None] * arm.n,
            'kept': list(consistent.kept), 'steps': consistent.steps, 'ms': 1e3 * seconds,
            'masses': consistent.inertial[:, 0].tolist(), 'rotors': consistent.rotor.tolist(),
            'theta': consistent.estimate}
    if judged is None:
        return figures
    inside, half_width = (_intervals(result.prediction) if test.count else
                          ([None] * arm.n, [None] * arm.n))
    told = confidence(identifier.arm, identifier.theta, judged, stack.regressors[:stack.count])
    unsure = [name for name, word in zip(arm.parameters, told, strict=True) if word != DETERMINED]
    figures |= {
        'theta_std': {name: value if math.isfinite(value) else None
                      for name, value in zip(arm.parameters, judged.std.tolist(), strict=True)},
        'confidence': dict(zip(arm.parameters, told, strict=True)),
        'helpful_motions': [{'joint': motion.joint, 'kind': motion.kind, 'parameters': names}
                            for motion, names in helpful_motion(arm, judged, unsure).items()],
        'condition': judged.condition if math.isfinite(judged.condition) else None,
        'residual': judged.residual.tolist(),
        'unexplained': judged.unexplained.tolist(),
        'test_coverage': inside, 'test_half_width': half_width}
    return figures


def _intervals(prediction: Prediction) -> tuple[list[float | None], list[float | None]]:
    """Return the part of the torques inside their intervals and the median half width, by joint.

    Block by block: all of them may not fit the memory. The median is that of at most
    `OF_MEDIAN` rows, evenly spaced.
    """
    measured, predicted, half = prediction.measured, prediction.predicted, prediction.half_width
    step = math.ceil(len(half) / OF_MEDIAN)
    inside, widths = np.zeros(half.shape[1]), []
    for some in row_blocks(half, measured, predicted):
        inside += np.sum(np.abs(measured[some] - predicted[some]) <= half[some], axis=0)
        widths.append(half[some][-some.start % step::step].copy())
    return (inside / len(half)).tolist(), np.median(np.concatenate(widths), axis=0).tolist()


def model_lines(figures: dict[str, Any]) -> list[str]:
    """Return the figures as lines of the table."""
    positive = figures['positive_mass']
    postures = positive['postures']
    lines = [f'possible robot  θ̂: M(q) > 0 at {positive["theta_hat"]} of {postures} postures']
    if 'consistent' in figures:
        model = figures['consistent']
        tested = [value for value in model['test_rmse'] if value is not None]
        lines[0] += (f'; consistent model: {positive["consistent"]}'
                     + (f', tested {np.mean(tested):.4f} N·m' if tested else '')
                     + f', found in {model["ms"]:.0f} ms')
        if model['kept']:
            lines.append(f'as described    {", ".join(model["kept"])}')
    if 'confidence' in figures:
        lines += _confidence_lines(figures)
    return lines


def _confidence_lines(figures: dict[str, Any]) -> list[str]:
    words = list(figures['confidence'].values())
    covered = [value for value in figures['test_coverage'] if value is not None]
    lines = [f'how sure        {words.count(DETERMINED)} parameters determined, '
             f'{words.count(WEAKLY)} weakly, {words.count(NOT)} not'
             + (f'; {np.mean(covered):.1%} of the tested torques inside their 95 % intervals '
                f'(worst joint {min(covered):.1%})' if covered else '')]
    weak = [name for name, word in figures['confidence'].items() if word == WEAKLY]
    if weak:
        lines.append(f'weakly          {", ".join(weak)}')
    lines += [f'would help      {motion["joint"]} {KINDS[motion["kind"]]}: '
              f'{", ".join(motion["parameters"])}' for motion in figures['helpful_motions']]
    condition = figures['condition']
    if condition is not None and condition > _CONDITION:
        lines.append(f'warning         the rank is full in name only: condition {condition:.2g}, '
                     'so θ̂ is unusable along the directions that the motion hardly shows')
    return lines


def parameter_note(names: Iterable[str]) -> str:
    """Return what the names of an arm's parameters stand for, with units of revolute joints."""
    found = list(names)
    return '; '.join(text for mark, text in _MEANINGS if any(
        mark in name if mark == '.' else name.startswith(mark) for name in found))


def parameter_table(figures: dict[str, Any]) -> str:
    """Return every parameter with its standard deviation and what the data say about it.

    Empty where no pair was recorded.
    """
    if 'confidence' not in figures:
        return ''
    width = max(map(len, figures['theta_hat']))
    model = figures.get('consistent', {}).get('theta', {})
    lines = [f'{"parameter":<{width}}{"θ̂":>12}{"± std":>12}{"consistent":>12}  determined']
    for name, value in figures['theta_hat'].items():
        std = figures['theta_std'][name]
        lines.append(f'{name:<{width}}{value:>12.4g}'
                     + (f'{std:>12.2g}' if std is not None else f'{"-":>12}')
                     + (f'{model[name]:>12.4g}' if model else f'{"-":>12}')
                     + f'  {figures["confidence"][name]}')
    note = parameter_note(figures['theta_hat'])
    return '\n'.join([*([note, ''] if note else []), *lines])
