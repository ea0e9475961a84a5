# SPDX-License-Identifier: Apache-2.0
"""The page of a campaign: the verdict, and each outcome against each parameter that varied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
import json
import math
from typing import Any

import numpy as np

from adaptive_blf_control import __version__
from adaptive_blf_control.campaigns.campaign import Campaign
from adaptive_blf_control.campaigns.influence import numbers_by_name
from adaptive_blf_control.campaigns.summary import (
    FIGURES,
    summarise,
    varied_text,
    verdict,
    verdict_line,
    wilson_interval,
    worst_runs,
)
from adaptive_blf_control.report.plotly_figures import plotly_js

__all__ = ['campaign_page', 'shares_by_bin']

MOST_COLUMNS = 24  # varied parameters that are plotted; the elements of a long array are many
BINS = 8
FEW = 0.25  # median over largest value under which decades are shown, as of log_uniform
PACKAGE = 'adaptive_blf_control.campaigns'
Row = Mapping[str, Any]


def shares_by_bin(values: np.ndarray, kept: np.ndarray) -> dict[str, list[float]]:
    """Return the share of runs that were kept over bins of a varied parameter.

    Args:
        values: The parameter in each run, shape (N,); few different values are bins themselves.
        kept: Whether the run was kept, shape (N,).

    Returns:
        Centres, widths and shares of the bins, and how far the 95 % interval reaches above and
        below each share.
    """
    distinct = np.unique(values)
    if distinct.size <= BINS:
        gap = float(np.diff(distinct).min()) if distinct.size > 1 else 1.0
        centres, widths = distinct, np.full(distinct.size, 0.8 * gap)
        inside = [values == value for value in distinct]
    else:
        edges = np.linspace(values.min(), values.max(), BINS + 1)
        centres, widths = (edges[:-1] + edges[1:]) / 2.0, np.diff(edges)
        number = np.clip(np.searchsorted(edges, values, side='right') - 1, 0, BINS - 1)
        inside = [number == i for i in range(BINS)]
    result: dict[str, list[float]] = {key: [] for key in ('centres', 'widths', 'shares', 'above',
                                                          'below')}
    for centre, width, chosen in zip(centres, widths, inside):
        if not chosen.any():
            continue
        good = int(kept[chosen].sum())
        share = good / int(chosen.sum())
        low, high = wilson_interval(good, int(chosen.sum()))
        for key, value in zip(result, (centre, width, share, high - share, share - low)):
            result[key].append(float(value))
    return result


def campaign_page(rows: Sequence[Row], campaign: Campaign) -> str:
    """Return the page as one HTML text that needs nothing else.

    Raises:
        MissingExtra: plotly is not installed.
    """
    library = plotly_js()
    columns = _columns(rows, campaign)
    figures = summarise(rows)
    options = ''.join(f'<option value="{figure.column}">{escape(figure.name)}</option>'
                      for figure in FIGURES)
    plots = ''.join(f'<div id="plot{i}"></div>' for i in range(len(columns['varied'])))
    data = json.dumps(columns, allow_nan=False).replace('<', '\\u003c')
    return '\n'.join([
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        f'<title>Campaign: {escape(campaign.config)}</title><style>{_file("page.css")}</style>',
        f'<script>{library}</script></head><body><h1>Campaign: {escape(campaign.config)}</h1>',
        f'<p class="verdict">{escape(verdict_line(figures, campaign))}</p>', _spreads(figures),
        '<p>Each mark below is a run: green kept its sets, red left them. The shaded columns are '
        'the share of runs that kept them, with its 95 % interval.</p>',
        f'<label>Outcome: <select id="figure">{options}</select></label>', plots,
        '<h2>Worst runs</h2><p>Open one for the command that repeats it exactly.</p>',
        *_worst(rows, campaign),
        f'<p>adaptive_blf_control {__version__}, seed {campaign.seed}</p>',
        f'<script type="application/json" id="columns">{data}</script>',
        f'<script>{_file("page.js")}</script></body></html>'])


def _file(name: str) -> str:
    return resources.files(PACKAGE).joinpath(name).read_text(encoding='utf-8')


def _number(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _columns(rows: Sequence[Row], campaign: Campaign) -> dict[str, Any]:
    """Return what the page plots, without NaN, which JSON does not know."""
    done = [row for row in rows if not row['problem']]
    kept = np.array([bool(row['kept']) for row in done])
    varied = []
    for name, column in list(numbers_by_name(campaign).items())[:MOST_COLUMNS] if done else []:
        values = column[[row['run'] for row in done]]
        decades = values.min() > 0.0 and float(np.median(values)) < FEW * values.max()
        values = np.log10(values) if decades else values
        varied.append({'name': name, 'values': values.tolist(),
                       'ticks': _decade_ticks(values) if decades else None,
                       **shares_by_bin(values, kept)})
    return {
        'run': [row['run'] for row in done], 'kept': kept.tolist(), 'varied': varied,
        'figures': {figure.column: {
            'label': figure.label, 'log': 'error' in figure.column,
            'values': [_number(figure.factor * row[figure.column]) for row in done]}
            for figure in FIGURES}}


def _decade_ticks(logarithms: np.ndarray) -> dict[str, Any]:
    """Return where an axis of logarithms is marked, and with which numbers."""
    low, high = math.floor(logarithms.min()), math.ceil(logarithms.max())
    marks = [mantissa * 10.0 ** exponent for exponent in range(low, high + 1)
             for mantissa in ((1, 2, 5) if high - low <= 3 else (1,))]
    return {'at': [math.log10(mark) for mark in marks], 'text': [f'{mark:g}' for mark in marks]}


def _spreads(figures: Mapping[str, Any]) -> str:
    heads = ''.join(f'<th>{head}</th>' for head in ('', 'least', '5 %', 'median', '95 %',
                                                   'largest'))
    lines = []
    for figure in FIGURES:
        quantiles = figures[figure.column]['quantiles']
        cells = ''.join(f'<td>{figure.factor * value:.3g}</td>' for value in quantiles.values()) \
            if quantiles else '<td colspan="5">not known</td>'
        lines.append(f'<tr><td>{escape(figure.label)}</td>{cells}</tr>')
    return f'<table><tr>{heads}</tr>{"".join(lines)}</table>'


def _worst(rows: Sequence[Row], campaign: Campaign) -> list[str]:
    lines = []
    for row in worst_runs(rows):
        lines.append(f'<details><summary>run {row["run"]}: {escape(verdict(row))}<br><small>'
                     f'{escape(varied_text(row["run"], campaign))}</small></summary>'
                     f'<code>{escape(campaign.command(row["run"]))}</code></details>')
    return lines
