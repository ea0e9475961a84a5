# SPDX-License-Identifier: Apache-2.0
"""The page: verdict, animation, plots, parameters and timing in one self-contained file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
import json
from typing import Any

from adaptive_blf_control.configuration.node_settings import TABLES
from adaptive_blf_control.parameters.table import per_joint
from adaptive_blf_control.report.animation import animate
from adaptive_blf_control.report.curves import BAG_COLOURS, Section
from adaptive_blf_control.report.panels import sections, time_span
from adaptive_blf_control.report.plotly_figures import animation_figure, animation_frames
from adaptive_blf_control.report.shell import card, document, Plots, section_html
from adaptive_blf_control.runs.lyapunov import GuaranteeOverTime
from adaptive_blf_control.runs.numbers import verdict
from adaptive_blf_control.runs.recording import Recording

__all__ = ['number_text', 'page']


def page(recordings: Sequence[Recording], guarantees: Sequence[GuaranteeOverTime | None],
         numbers: Mapping[str, Any]) -> str:
    """Return the report as one HTML text.

    Args:
        recordings: The bags, in the order of their colours.
        guarantees: Theorem 2 for each of them.
        numbers: What `report_figures` returned for them.

    Raises:
        MissingExtra: plotly is not installed.
    """
    names = [recording.name for recording in recordings]
    plots = Plots(time_span(recordings), one=len(recordings) == 1)
    body = ['<h1>Adaptive barrier Lyapunov control: report</h1>', *_verdicts(numbers),
            _chips(names)]
    shown = sections(recordings, guarantees)
    film, frames = _animation(recordings, names, plots)
    aside = ''.join(card(panel, section, plots) for section in shown
                    for panel in section.panels if section.key == 'margins')
    body.append(f'<div class="grid columns{2 if film and aside else 1} top">{film}{aside}</div>')
    body += [section_html(section, plots) for section in shown
             if section.key not in ('margins', 'timing')]
    body.append(_timing(numbers, [s for s in shown if s.key == 'timing'], plots))
    body += ['<h2>Parameters</h2>', *(_parameters(r) for r in recordings)]
    return document(
        f'{" · ".join(names)} – report',
        'Drag in a plot to zoom the time axis of all plots, double-click to reset, click to move '
        'the arm to that time; the camera saves a plot as SVG.', body, plots, figures=numbers,
        frames=frames)


def number_text(value: Any, form: str) -> str:
    """Return a number as the page shows it; a dash for None."""
    return '–' if value is None else format(value, form)


def _cell(numbers: Mapping[str, Any], path: Sequence[str | int], form: str,
          tag: str = 'td') -> str:
    """A cell with the number at ``path``; its attributes name path and format, for tests."""
    value: Any = numbers
    for key in path:
        value = None if value is None else value[key]
    where = escape(json.dumps(list(path)), quote=True)
    return (f'<{tag} data-figure="{where}" data-format="{form}">'
            f'{number_text(value, form)}</{tag}>')


def _verdicts(numbers: Mapping[str, Any]) -> Iterator[str]:
    for path, reason in numbers['unreadable'].items():
        yield (f'<div class="card verdict bad"><h2><span class="badge">Not readable</span>'
               f'{escape(path)}</h2><p>{escape(reason)}</p></div>')
    for b, bag in enumerate(numbers['bags']):
        kind, head, sentences = verdict(bag)
        parts = [f'<section class="card verdict {kind}" id="verdict{b}">',
                 f'<h2><span class="badge">{head}</span>{escape(bag["name"])}</h2>',
                 f'<p>{" ".join(map(escape, sentences))}</p>', _joint_table(numbers, b),
                 _theta_table(numbers, b)]
        problems = [f'Incomplete bag: {bag["problem"]}'] if bag['problem'] else []
        problems += [f'Missing – {sentence}' for sentence in bag['missing']]
        if problems:
            items = ''.join(f'<li>{escape(problem)}</li>' for problem in problems)
            parts.append(f'<div class="warning"><ul>{items}</ul></div>')
        yield '\n'.join([*parts, '</section>'])


def _joint_table(numbers: Mapping[str, Any], b: int) -> str:
    bag = numbers['bags'][b]
    columns = [('least margin [rad]', ('min_margin',), '.4f'),
               ('largest |e1| [rad]', ('max_abs_error',), '.5f'),
               ('guaranteed e1 ≤ [rad]', ('guarantee', 'U_e1_upper'), '.4f'),
               ('RMS e1 [rad]', ('rms_error',), '.3e'),
               ('RMS e1, last quarter', ('rms_error_last_quarter',), '.3e'),
               ('RMS τ [N·m]', ('torque_rms',), '.4g'),
               ('largest |τ| [N·m]', ('torque_max_abs',), '.4g'),
               ('chatter, RMS Δτ [N·m]', ('chatter',), '.2e'),
               ('commands saturated', ('saturated',), '.2%'),
               ('reserve of torque', ('torque_reserve',), '.0%')]
    columns = [c for c in columns if _at(bag, c[1]) is not None]
    if not columns or not bag['joints']:
        return ''
    head = ''.join(f'<th>{title}</th>' for title, _, _ in columns)
    rows = ''.join(
        f'<tr><td>{escape(joint)}</td>'
        + ''.join(_cell(numbers, ('bags', b, *key, i), form) for _, key, form in columns)
        + '</tr>' for i, joint in enumerate(bag['joints']))
    return f'<div class="scroll"><table><tr><th>joint</th>{head}</tr>{rows}</table></div>'


def _at(value: Any, path: Sequence[str]) -> Any:
    for key in path:
        value = None if value is None else value[key]
    return value


def _theta_table(numbers: Mapping[str, Any], b: int) -> str:
    bag = numbers['bags'][b]
    if not bag['theta_hat']:
        return ''
    truth = bag['theta_true'] is not None
    rows = ''.join(
        f'<tr><td>{escape(name)}</td>' + _cell(numbers, ('bags', b, 'theta_hat', name), '.6g')
        + (_cell(numbers, ('bags', b, 'theta_true', name), '.6g') if truth else '') + '</tr>'
        for name in bag['theta_hat'])
    head = '<th>parameter</th><th>θ̂ at the end</th>' + ('<th>θ*</th>' if truth else '')
    lines = [f'<details><summary>{len(bag["theta_hat"])} estimates at the end</summary>',
             f'<div class="scroll"><table><tr>{head}</tr>{rows}</table></div></details>']
    if bag['guarantee']:
        first, last, ratio = (_cell(numbers, ('bags', b, 'guarantee', key), '.4g', 'span')
                              for key in ('V0', 'V_last', 'V_largest_over_bound'))
        lines.insert(0, f'<p>Theorem 2: V(0) = {first}, V at the end = {last}, largest V / bound '
                        f'= {ratio} (at most 1 is guaranteed).</p>')
    return '\n'.join(lines)


def _colour(bag: int) -> str:
    return BAG_COLOURS[bag % len(BAG_COLOURS)]


def _chips(names: Sequence[str]) -> str:
    """The legend by bag; a click hides or shows a bag in all plots."""
    if len(names) < 2:
        return ''
    chips = ''.join(
        f'<button type="button" data-bag="{b}" title="hide or show this bag">'
        f'<i style="background:{_colour(b)}"></i>{escape(name)}</button>'
        for b, name in enumerate(names))
    return f'<nav class="bags">{chips}</nav>'


def _animation(recordings: Sequence[Recording], names: Sequence[str],
               plots: Plots) -> tuple[str, dict[str, Any] | None]:
    film = animate(recordings)
    if film is None:
        return '', None
    figure = animation_figure(film, names, [_colour(b) for b in range(len(names))])
    plots.made.append({'id': 'arm', 'time': False, **figure})
    notes = ''.join(f'<p class="note">{escape(note)}</p>' for note in film.notes)
    last = len(film.t) - 1
    return ('<div class="card"><div id="arm"></div>'
            f'{notes}<div class="player">'
            '<button type="button" id="play">▶ play</button>'
            f'<input type="range" id="time" min="0" max="{last}" value="0" step="1" '
            f'aria-label="time"><output id="clock">{film.t[0]:.2f} s</output></div></div>',
            animation_frames(film))


def _timing(numbers: Mapping[str, Any], found: Sequence[Section], plots: Plots,
            ) -> str:
    columns = [('nominal period [ms]', ('period_ms',), '.4g'),
               *((f'interval {name} [ms]', ('interval_ms', key), '.4g')
                 for name, key in (('median', 'p50'), ('99 %', 'p99'), ('max', 'max'))),
               ('missed periods', ('missed_periods',), 'd'), ('gaps', ('gaps',), 'd'),
               ('out of order', ('out_of_order',), 'd'), ('unanswered', ('unanswered',), 'd'),
               *((f'command delay {name} [ms]', ('command_delay_ms', key), '.4g')
                 for name, key in (('median', 'p50'), ('99 %', 'p99'), ('max', 'max')))]
    head = ''.join(f'<th>{title}</th>' for title, _, _ in columns)
    rows, tables = '', ''
    for b, bag in enumerate(numbers['bags']):
        rows += f'<tr><td>{escape(bag["name"])}</td>' + ''.join(
            _cell(numbers, ('bags', b, 'timing', *key), form) for _, key, form in columns
        ) + '</tr>'
        tables += _topic_table(numbers, b)
    parts = ['<h2 id="timing">Timing and dropped samples</h2>',
             '<p class="note">A command delay runs from a state to the first command after '
             'it, as the recorder heard both; an offline run has none.</p>',
             '<div class="card"><div class="scroll"><table>'
             f'<tr><th>bag</th>{head}</tr>{rows}</table></div>{tables}</div>']
    for section in found:
        cards = ''.join(card(panel, section, plots)
                        for panel in section.panels)
        parts.append(f'<div class="grid columns{section.columns}" style="margin-top:12px">'
                     f'{cards}</div>')
    return '\n'.join(parts)


def _topic_table(numbers: Mapping[str, Any], b: int) -> str:
    bag = numbers['bags'][b]
    rows = ''.join(
        f'<tr><td>{escape(topic["name"])}</td><td class="text">{escape(topic["type"])}</td>'
        + _cell(numbers, ('bags', b, 'timing', 'topics', i, 'count'), 'd')
        + _cell(numbers, ('bags', b, 'timing', 'topics', i, 'rate_hz'), '.1f') + '</tr>'
        for i, topic in enumerate(bag['timing']['topics']))
    drops = ''.join(
        f'<tr><td>{escape(drop["node"])}</td><td class="text">{escape(drop["what"])}</td>'
        + _cell(numbers, ('bags', b, 'timing', 'drops', i, 'count'), 'd') + '</tr>'
        for i, drop in enumerate(bag['timing']['drops']))
    counted = (f'<table><tr><th>node</th><th class="text">counted by the node itself</th>'
               f'<th>messages</th></tr>{drops}</table>') if drops else ''
    return (f'<details><summary>{escape(bag["name"])}: messages per topic</summary>'
            '<div class="scroll"><table><tr><th>topic</th><th class="text">type</th>'
            f'<th>messages</th><th>rate [Hz]</th></tr>{rows}</table>{counted}</div></details>')


def _parameters(recording: Recording) -> str:
    title = escape(recording.name)
    if recording.parameters is None:
        return f'<p class="note">{title}: the bag holds no parameters.</p>'
    nodes = []
    for key, section in recording.parameters.items():
        values = section.get('ros__parameters', {}) if isinstance(section, dict) else {}
        table = per_joint(TABLES.get(str(key).rpartition('/')[2], ()), recording.joints)
        rows = ''.join(
            f'<tr><td>{escape(name)}</td><td class="text">{escape(_value_text(value))}</td>'
            f'<td class="text">{escape(table[name].unit if name in table else "")}</td>'
            f'<td class="text">{escape(table[name].description if name in table else "")}</td>'
            '</tr>' for name, value in _flat(values))
        nodes.append(f'<h3>{escape(str(key))}</h3><div class="scroll"><table><tr><th>name</th>'
                     '<th class="text">value</th><th class="text">unit</th>'
                     f'<th class="text">meaning</th></tr>{rows}</table></div>')
    return f'<details class="card"><summary>{title}</summary>{"".join(nodes)}</details>'


def _value_text(value: Any) -> str:
    if isinstance(value, list):
        return ', '.join(map(_value_text, value)) or '(empty)'
    return f'{value:g}' if isinstance(value, float) else str(value)


def _flat(values: Mapping[str, Any], prefix: str = '') -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', value
