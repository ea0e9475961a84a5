# SPDX-License-Identifier: Apache-2.0
"""The numbers of a report: one dict for ``--json``, the page and the pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np

from adaptive_blf_control.runs.lyapunov import GuaranteeOverTime, true_over_time
from adaptive_blf_control.runs.margins import (
    closest_by_unit,
    least_per_joint,
    margin_figures,
    violated_at,
)
from adaptive_blf_control.runs.recording import Recording
from adaptive_blf_control.runs.summary import listed, summarise
from adaptive_blf_control.runs.timing import timing
from adaptive_blf_control.runs.torque_use import oscillation_text

__all__ = ['figures', 'plain', 'report_figures', 'verdict']


def report_figures(recordings: Sequence[Recording], guarantees: Sequence[GuaranteeOverTime | None],
                   unreadable: Mapping[str, str]) -> dict[str, Any]:
    """Return all numbers of a report as plain JSON values.

    Args:
        recordings: What could be read.
        guarantees: Theorem 2 for each of them.
        unreadable: Why other bags could not be read, by path.
    """
    result: dict[str, Any] = plain({
        'bags': [figures(r, g) for r, g in zip(recordings, guarantees)],
        'unreadable': dict(unreadable)})
    return result


def figures(recording: Recording, guaranteed: GuaranteeOverTime | None) -> dict[str, Any]:
    """Return the numbers of one bag; what is not known is None."""
    numbers = {
        'name': recording.name,
        'path': recording.path,
        'complete': recording.problem is None,
        'problem': recording.problem,
        'missing': list(recording.missing),
        **_partial(recording),
        **(summarise(recording.run) if recording.run else {}),
    }
    violations = numbers['set_violations']
    numbers['sets_kept'] = None if violations is None else violations == 0
    numbers['closest'] = _closest(numbers['margins'])
    numbers['theta_true'], numbers['theta_change_times_s'] = None, []
    truth = true_over_time(recording)
    if truth is not None and recording.run is not None and recording.run.truth:
        numbers['theta_true'] = dict(zip(recording.theta_names, truth[-1].tolist()))
        numbers['theta_change_times_s'] = [float(t) for t, _ in recording.run.truth[1:]]
    numbers['guarantee'] = _guarantee(guaranteed)
    numbers['torque_rms'] = numbers['torque_max_abs'] = None
    if recording.torque is not None:
        tau = recording.torque.values
        numbers['torque_rms'] = np.sqrt(np.nanmean(tau ** 2, axis=0)).tolist()
        numbers['torque_max_abs'] = np.nanmax(np.abs(tau), axis=0).tolist()
    numbers['timing'] = timing(recording)
    return numbers


def _partial(recording: Recording) -> dict[str, Any]:
    """Return the keys of `summarise` as far as an incomplete bag gives them."""
    numbers: dict[str, Any] = dict.fromkeys((
        'duration_s', 'samples', 'set_violations', 'max_abs_error', 'rms_error',
        'rms_error_last_quarter', 'min_margin', 'failure', 'theta_hat', 'theta_error_norm',
        'theta_true_norm', 'theta_settling_time_s', 'history_rank', 'history_sigma_min',
        'oscillation', 'chatter', 'saturated', 'torque_reserve'))
    numbers['theta_settling_times_s'], numbers['margins'] = [], []
    numbers['joints'] = list(recording.joints)
    main = recording.e1 or recording.q
    if main is not None:
        numbers['duration_s'], numbers['samples'] = float(np.ptp(main.t)), int(main.t.size)
    if recording.e1 is not None:
        e1 = recording.e1.values
        last = recording.e1.t >= recording.e1.t[-1] - 0.25 * np.ptp(recording.e1.t)
        numbers['max_abs_error'] = np.nanmax(np.abs(e1), axis=0).tolist()
        numbers['rms_error'] = np.sqrt(np.nanmean(e1 ** 2, axis=0)).tolist()
        numbers['rms_error_last_quarter'] = np.sqrt(np.nanmean(e1[last] ** 2, axis=0)).tolist()
    if margins := recording.margins:
        numbers['set_violations'] = int(np.count_nonzero(violated_at(margins[0].t, margins)))
        numbers['min_margin'] = least_per_joint(recording.joints, margins)
        numbers['margins'] = margin_figures(margins)
    if recording.theta_hat is not None and recording.theta_hat.t.size:
        numbers['theta_hat'] = dict(zip(recording.theta_names,
                                        recording.theta_hat.values[-1].tolist()))
    if recording.rank is not None:
        numbers['history_rank'] = int(recording.rank.values[-1])
    if recording.sigma_min is not None:
        numbers['history_sigma_min'] = float(recording.sigma_min.values[-1])
    return numbers


def _closest(margins: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return where the run came closest to leaving a set: joint, set, margin [rad], time [s]."""
    for each in closest_by_unit(margins):
        if each['unit'] == 'rad':
            return {'joint': each['body'], 'set': each['constraint'], 'margin': each['margin'],
                    't': each['t']}
    return None


def _guarantee(guaranteed: GuaranteeOverTime | None) -> dict[str, Any] | None:
    """Theorem 2 at its start, and whether V stayed below its bound (rounding allowed for)."""
    if guaranteed is None:
        return None
    ratio = float(np.max(guaranteed.v / np.maximum(guaranteed.bound, 1e-300)))
    over = guaranteed.v > guaranteed.bound * (1.0 + 1e-6) + 1e-9
    return {'V0': float(guaranteed.v[0]), 'V_last': float(guaranteed.v[-1]),
            'V_largest_over_bound': ratio, 'V_left': bool(over.any()),
            'U_e1_lower': guaranteed.lower.tolist(), 'U_e1_upper': guaranteed.upper.tolist()}


def verdict(numbers: Mapping[str, Any]) -> tuple[str, str, list[str]]:
    """Return the verdict on one bag: its kind (good, bad, unknown), headline and sentences."""
    kept = numbers['sets_kept']
    sentences = []
    if kept is None:
        kind, head = 'unknown', 'Sets not known'
        sentences.append('The bag does not tell whether the sets were kept.')
    elif kept:
        kind, head = 'good', 'Sets kept'
        sets = listed([each['constraint'] for each in numbers['margins']])
        sentences.append(f'Every joint stayed inside its {sets} set in all '
                         f'{numbers["samples"]} samples of {numbers["duration_s"]:.1f} s.')
    else:
        kind, head = 'bad', 'Sets left'
        sentences.append(f'A joint was outside a set in {numbers["set_violations"]} of '
                         f'{numbers["samples"]} samples of {numbers["duration_s"]:.1f} s.')
    shaking = oscillation_text(numbers)
    if kept and shaking:
        kind, head = 'unknown', 'Sets kept, but a joint oscillates'
    if shaking:
        sentences.append(f'{shaking}: the gains do not fit the delay of the loop, or the estimate '
                         'is not good enough.')
    for closest in closest_by_unit(numbers['margins']):
        how = 'Closest approach' if closest['margin'] > 0.0 else 'Farthest outside'
        sentences.append(f'{how}: {abs(closest["margin"]):.4g} {closest["unit"]} from the '
                         f'{closest["constraint"]} bound, {closest["body"]} at '
                         f'{closest["t"]:.2f} s.')
    sentences += [*_torque_sentences(numbers), *_learning_sentences(numbers)]
    return kind, head, sentences


def _torque_sentences(numbers: Mapping[str, Any]) -> list[str]:
    if numbers['torque_reserve'] is None:
        return []
    least = int(np.argmin(numbers['torque_reserve']))
    sentences = [f'Least reserve of torque: {max(numbers["torque_reserve"][least], 0.0):.0%} of '
                 f'the limit, {numbers["joints"][least]}.']
    most = int(np.argmax(numbers['saturated']))
    if numbers['saturated'][most] > 0.0:
        sentences.append(f'{numbers["joints"][most]} was at its torque limit in '
                         f'{numbers["saturated"][most]:.2%} of the commands.')
    return sentences


def _learning_sentences(numbers: Mapping[str, Any]) -> list[str]:
    sentences = []
    error = numbers['theta_error_norm']
    if error is not None:
        starts = [0.0, *numbers['theta_change_times_s']]
        for start, settled in zip(starts, numbers['theta_settling_times_s']):
            when = f' after θ* changed at {start:g} s' if start else ''
            sentences.append(
                f'θ̂ converged to within 1 % of θ* in {settled:.2f} s{when}.' if settled is not None
                else f'θ̂ did not converge to within 1 % of θ*{when}.')
        sentences.append(f'At the end ‖θ̃‖ is {error:.3g}, ‖θ*‖ '
                         f'{numbers["theta_true_norm"]:.3g}.')
    elif numbers['theta_hat']:
        sentences.append('θ* is not known, so nothing is said about the parameter error.')
    if numbers['history_rank'] is not None and numbers['theta_hat']:
        size, rank = len(numbers['theta_hat']), numbers['history_rank']
        sigma = numbers['history_sigma_min']
        sentences.append(f'History stack: rank {rank} of {size}'
                         + ('' if sigma is None else f', σ_min {sigma:.3g}')
                         + ('.' if rank == size else ' – too low for θ̂ to converge.'))
    return sentences


def plain(value: Any) -> Any:
    """Return ``value`` as strict JSON takes it: lists, dicts, no NaN or infinity."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
