# SPDX-License-Identifier: Apache-2.0
"""The load of a robot over a log, beside the model of the robot without it."""

from __future__ import annotations

from collections.abc import Iterator
import itertools
import math
from typing import Any

import numpy as np

from adaptive_blf_control.arms.load_frame import load_map
from adaptive_blf_control.bags.logs import Log
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.configuration.payload import build_payload
from adaptive_blf_control.identification.payload import PayloadEstimate, PayloadEstimator
from adaptive_blf_control.runs.batch_fit import BatchFit
from adaptive_blf_control.runs.log_options import LogOptions, name_of
from adaptive_blf_control.runs.log_pairs import LogPairs

__all__ = ['load_figures', 'load_table']

_ROWS = 12  # of the table over time
_LEFT = 0.15  # of the torque that a model with its load leaves; models learned from logs: 0.04
_WITHIN = 1.96  # standard deviations: the 95 % interval


def load_figures(log: Log, settings: IdentifierNodeSettings,
                 options: LogOptions) -> dict[str, Any]:
    """Return the load over a log and at its end.

    Masses in kg, lengths in m, inertias in kg·m² about the centre of mass in axes of the frame,
    Ixx, Ixy, Iyy, Ixz, Iyz, Izz; each with its standard deviation, None where it has none.
    ``rmse_without`` and ``rmse_with`` are those of the filtered torque since the load was noticed
    [N·m], under the model without the load and with the last one. ``mass_most`` is the upper end
    of the 95 % interval of the mass, reported or not; ``undecided`` says that no load was found,
    but one that the arm may well carry need not have shown yet. ``earlier`` has the loads that
    were there before the one at the end, each as last judged, and ``until`` when [s].

    Args:
        log: The log.
        settings: Those of the identifier; ``payload.frame`` and ``payload.baseline`` say which
            load, beside which model.
        options: How the log is read.

    Raises:
        LogError: the log cannot be read, cannot be right, or has no pair.
        ParameterError: there is no such frame, or the model is of another robot.
        ArmError: no arm can be made of the URDF and the joints.
    """
    source = LogPairs(settings, options)
    found = build_payload(settings, source.arm, source.identifier.memory)
    if found is None:
        load_map(source.arm, '')
        raise AssertionError('no link has an empty name')
    over, fit = _follow(found, source, log)
    last, n = found.estimate, source.arm.n
    without, along = (fit.rmse(theta) for theta in (found.baseline, found.theta))
    return {
        'log': name_of(log), 'joints': list(source.arm.joints), 'frame': settings.payload.frame,
        'baseline': settings.payload.baseline, 'changes': found.changes,
        'over_time': [{'t': t, **_numbers(each)} for t, each in over],
        'earlier': _earlier([each for _, each in over]),
        'load': None if last is None else _numbers(last),
        'rmse_without': without.tolist() if fit.count else [None] * n,
        'rmse_with': along.tolist() if fit.count else [None] * n,
        'notes': [*source.reader.notes, *_notes(last, along, fit.rmse(0.0 * found.baseline),
                                                settings.payload.baseline)],
        'findings': [f'{finding.level}: {finding}' for finding in source.reader.findings],
    }


def _follow(found: PayloadEstimator, source: LogPairs,
            log: Log) -> tuple[list[tuple[float, PayloadEstimate]], BatchFit]:
    """Return every judgement with its time, and the pairs since the last change."""
    over: list[tuple[float, PayloadEstimate]] = []
    fit, changes = BatchFit(source.arm.n, source.arm.m), 0
    for times, rows in source.of(log):
        for t, row in zip(times.tolist(), rows, strict=True):
            if found.take(t, row[:, :-1], row[:, -1]) and found.estimate is not None:
                over.append((t, found.estimate))
        if found.changes != changes:
            fit, changes = BatchFit(source.arm.n, source.arm.m), found.changes
        fit.add(rows)
    return over, fit


def _earlier(over: list[PayloadEstimate]) -> list[dict[str, Any]]:
    """Return the loads that came off or were exchanged; ``over`` are all judgements in order."""
    return [{'until': after.since, **_numbers(each)} for each, after in itertools.pairwise(over)
            if each.attached and (not after.attached or after.since > each.since)]


def _notes(last: PayloadEstimate | None, left: np.ndarray, torque: np.ndarray,
           baseline: str) -> Iterator[str]:
    """Yield what is needed to know the load; ``left`` and ``torque`` are RMS, (n,) [N·m]."""
    if last is None:
        return
    if last.undecided:
        yield (f'it is not known whether there is a load: one of up to {last.most:.2g} kg need '
               'not have shown. Needed is a longer motion in which gravity pulls at it in '
               'different postures, e.g. of the joints whose axes are not vertical, through '
               'their ranges')
    part = float(np.linalg.norm(left)) / max(float(np.linalg.norm(torque)), 1e-300)
    if last.attached and part > _LEFT:
        yield (f'{100.0 * part:.0f} % of the torque is explained neither by {baseline} nor by the '
               'load, so the load may be further off than its standard deviations say. Needed is '
               'a better model without the load: learn one from a log, or a span of one '
               '(--train), without it')


def _numbers(estimate: PayloadEstimate) -> dict[str, Any]:
    load, std = estimate.load, estimate.std
    known = estimate.attached
    return {'attached': known, 'since': estimate.since,
            'mass': load.mass, 'mass_std': std.mass, 'mass_most': estimate.most,
            'undecided': estimate.undecided,
            'com': load.com.tolist() if known else None,
            'com_std': std.com.tolist() if known else None,
            'inertia': load.inertia.tolist() if known else None,
            'inertia_std': std.inertia.tolist() if known else None}


def load_table(figures: dict[str, Any]) -> str:
    """Return the figures as a short table."""
    lines = [f'{figures["log"]}: load at {figures["frame"]}, beside {figures["baseline"]}', '',
             f'{"t [s]":>8}{"mass [kg]":>11}{"std":>7}   centre of mass [mm]{"std [mm]":>19}']
    over = figures['over_time']
    chosen = np.unique(np.linspace(0, len(over) - 1, min(_ROWS, len(over))).astype(int))
    lines += [_row(over[k]) for k in chosen]
    if figures['earlier']:
        lines += ['', 'before:', *(
            f'{each["since"]:>8.2f} .. {each["until"]:.2f} s   '
            f'{_with(each["mass"], each["mass_std"])} kg' for each in figures['earlier'])]
    load = figures['load']
    if load is None or not load['attached']:
        return '\n'.join([*lines, '', f'at the end: {_none(load)}' if load else
                          'no load could be judged: the log is shorter than payload.period'])
    low, high = max(0.0, load['mass'] - _WITHIN * load['mass_std']), load['mass_most']
    begin = f'{load["since"]:.2f} s'
    if load['since'] == over[0]['since']:
        begin = f'the beginning (filters settled at {begin})'
    lines += ['', f'since {begin}, with standard deviations:',
              f'mass            {_with(load["mass"], load["mass_std"])} kg, '
              f'95 % interval {low:.3f} .. {high:.3f} kg',
              'centre of mass  ' + ', '.join(
                  _with(1e3 * value, 1e3 * std)
                  for value, std in zip(load['com'], load['com_std'])) + ' mm',
              'inertia         ' + ', '.join(
                  f'{name} {_with(value, std)}' for name, value, std in zip(
                      ('Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz'), load['inertia'],
                      load['inertia_std'])) + ' kg·m²', '',
              'RMSE of the filtered torque [N·m]', f'{"joint":<24}{"without":>10}{"with":>10}']
    lines += [f'{joint:<24}{without:>10.4f}{along:>10.4f}' for joint, without, along in zip(
        figures['joints'], figures['rmse_without'], figures['rmse_with'], strict=True)]
    return '\n'.join(lines)


def _row(each: dict[str, Any]) -> str:
    head = f'{each["t"]:>8.2f}{each["mass"]:>11.3f}{each["mass_std"]:>7.3f}'
    if not each['attached']:
        return f'{head}   {_none(each)}'
    return head + '   ' + ' '.join(f'{1e3 * value:>6.0f}' for value in each['com']) + (
        ' ' * 4 + ' '.join(f'{1e3 * value:>5.0f}' for value in each['com_std']))


def _none(each: dict[str, Any]) -> str:
    """Return what is known where no load was found."""
    most = f'{each["mass_most"]:.2g} kg'
    return f'not known yet, up to {most}' if each['undecided'] else f'no load above {most}'


def _with(value: float, std: float) -> str:
    """Return a value to the second digit of its standard deviation."""
    if not 0.0 < std < math.inf:
        return f'{value:.4g} ± {std:.2g}'
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f'{value:.{digits}f} ± {std:.{digits}f}'
