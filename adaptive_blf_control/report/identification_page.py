# SPDX-License-Identifier: Apache-2.0
"""The page of an identification: how well the model predicts, how sure it is, and the log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from html import escape
import math
from typing import Any

import numpy as np

from adaptive_blf_control.report.identification_panels import identification_sections
from adaptive_blf_control.report.shell import document, Plots, section_html
from adaptive_blf_control.runs.identification import Identification
from adaptive_blf_control.runs.model_report import KINDS, parameter_note

__all__ = ['identification_page']

GOOD, FAIR = 0.1, 0.3  # of the torque of the worst joint: what its residual may be
HARDLY = 0.01  # of the largest torque: a joint with less says nothing of the model


def identification_page(result: Identification) -> str:
    """Return the page as one HTML text.

    Raises:
        MissingExtra: plotly is not installed.
    """
    t = result.prediction.t
    span = (float(t[0]), float(t[-1])) if t.size else (0.0, 1.0)
    body = ['<h1>Identification of a robot from its log</h1>', *_verdict(result)]
    plots = Plots(span, one=True)
    for section in identification_sections(result):
        if section.key == 'history' and result.growth is not None and result.growth.t.size:
            plots.span = float(result.growth.t[0]), float(result.growth.t[-1])
        body.append(section_html(section, plots))
    body += [*_parameters(result), *_checks(result)]
    return document(f'{result.source} – identification', 'Drag in a plot to zoom, double-click '
                    'to reset; the camera saves a plot as SVG.', body, plots,
                    figures=_plain(result.figures))


def _plain(value: Any) -> Any:
    """Return figures as JSON takes them: None for what is not finite."""
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def _row(cells: Iterable[str], tag: str = 'td') -> str:
    first, *rest = cells
    return (f'<tr><{tag}>{escape(first)}</{tag}>'
            + ''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in rest) + '</tr>')


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    return (f'<div class="scroll"><table>{_row(head, "th")}'
            f'{"".join(map(_row, rows))}</table></div>')


def _number(value: float | None, form: str = '.4g') -> str:
    return '–' if value is None or not math.isfinite(value) else format(value, form)


def _verdict(result: Identification) -> Iterator[str]:
    figures = result.figures
    tested, torque = (np.array(figures[name], dtype=float)
                      for name in ('test_rmse', 'test_torque_rms'))
    shares = np.where(torque > HARDLY * np.max(torque), tested / np.maximum(torque, 1e-12), 0.0)
    share = float(np.max(shares)) if figures['test_samples'] else math.nan
    kind, head = (('', 'Not tested') if math.isnan(share) else ('good', 'Good') if share < GOOD
                  else ('', 'Fair') if share < FAIR else ('bad', 'Poor'))
    words = list(figures.get('confidence', {}).values())
    sentences = [
        f'{figures["samples"]} samples of {len(figures["joints"])} joints, '
        f'{figures["columns"]} parameters, rank {figures["history_rank"]}'
        + (f', condition {figures["condition"]:.3g}.' if figures.get('condition') else '.')]
    if not math.isnan(share):
        sentences.append(f'In the worst joint, {figures["joints"][int(np.argmax(shares))]}, θ̂ '
                         f'leaves {share:.1%} of the torque unexplained.')
        idle = [joint for joint, part in zip(figures['joints'], shares, strict=True) if not part]
        if idle:
            sentences.append(f'Hardly any torque, too little to judge by: {", ".join(idle)}.')
    if words:
        sentences.append(f'{words.count("determined")} parameters are determined, '
                         f'{words.count("weakly")} weakly, {words.count("not")} not.')
    yield (f'<section class="card verdict {kind}" id="verdict"><h2><span class="badge">{head}'
           f'</span>{escape(result.source)}</h2><p>{escape(" ".join(sentences))}</p>'
           f'{_joints(result)}{_warnings(result)}</section>')


def _joints(result: Identification) -> str:
    figures = result.figures
    model = figures.get('consistent', {}).get('test_rmse', [None] * result.arm.n)
    covered = figures.get('test_coverage', [None] * result.arm.n)
    rows = [(joint, *(_number(each, '.4f') for each in (torque, learned, tested)),
             _number(tested / torque if torque else None, '.1%'), _number(possible, '.4f'),
             _number(batch, '.4f'), _number(inside, '.1%')) for
            joint, torque, learned, tested, possible, batch, inside in zip(
                figures['joints'], figures['test_torque_rms'], figures['train_rmse'],
                figures['test_rmse'], model, figures['batch_test_rmse'], covered)]
    return ('<p class="note">RMS of the filtered torque in the test, and of what is left of it '
            '[N·m]: by θ̂ in the span it was learned from and in the test, then in the test by the '
            'consistent model and by least squares over all samples.</p>'
            + _table(('joint', 'torque', 'θ̂, learned', 'θ̂, tested', 'of torque',
                      'consistent model', 'batch least squares', 'inside 95 % interval'), rows))


def _warnings(result: Identification) -> str:
    items = [*filter(None, (result.problem, *result.notes)),
             *(f'{finding.level}: {finding}' for finding in result.findings)]
    if not items:
        return ''
    return ('<div class="warning"><ul>'
            + ''.join(f'<li>{escape(item)}</li>' for item in items) + '</ul></div>')


def _parameters(result: Identification) -> Iterator[str]:
    figures = result.figures
    if 'confidence' not in figures:
        return
    model = figures.get('consistent', {}).get('theta', {})
    rows = [(name, _number(value), _number(figures['theta_std'][name], '.2g'),
             _number(model.get(name)), figures['confidence'][name])
            for name, value in figures['theta_hat'].items()]
    helpful = ''.join(
        f'<li>{escape(motion["joint"])} {escape(KINDS[motion["kind"]])}, for '
        f'{escape(", ".join(motion["parameters"]))}</li>'
        for motion in figures.get('helpful_motions', []))
    yield '<h2 id="parameters">Parameters</h2>'
    note = parameter_note(figures['theta_hat'])
    yield ('<p class="note">With standard deviations; what the log does not show has none. The '
           'consistent model is the nearest to θ̂ that a robot can be. Also determined is what is '
           'so small that all of its interval makes less torque than the residual.'
           + (f' Names: {escape(note)}.' if note else '')
           + '</p><div class="card">'
           + (f'<p>Motions that would tell more:</p><ul>{helpful}</ul>' if helpful else '')
           + _table(('parameter', 'θ̂', '± std', 'consistent model', 'determined?'), rows)
           + '</div>')


def _checks(result: Identification) -> Iterator[str]:
    yield '<h2 id="checks">Checks of the log</h2>'
    verdicts = result.figures.get('verdicts', {})
    yield ('<div class="card">' + _table(('joint', 'verdict'), verdicts.items()) + '</div>')
