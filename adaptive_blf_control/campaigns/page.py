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
from adaptive_blf_control.campaigns.results import flat_changes
from adaptive_blf_control.campaigns.summary import (
    FIGURES,
    shown_per_unit,
    summarise,
    wilson_interval,
    worst_runs,
)
from adaptive_blf_control.report.plotly_figures import plotly_js

__all__ = ['campaign_page', 'shares_by_bin']

MOST_COLUMNS = 24  # varied parameters that are plotted; the elements of a long array are many
BINS = 8
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
    low, high = figures['kept_share_interval']
    options = ''.join(f'<option value="{column}">{escape(name)}</option>'
                      for column, name, _ in FIGURES)
    plots = ''.join(f'<div id="plot{i}"></div>' for i in range(len(columns['varied'])))
    data = json.dumps(columns, allow_nan=False).replace('<', '\\u003c')
    return '\n'.join([
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        f'<title>Campaign: {escape(campaign.config)}</title><style>{_file("page.css")}</style>',
        f'<script>{library}</script></head><body><h1>Campaign: {escape(campaign.config)}</h1>',
        f'<p class="verdict">{figures["kept"]} of {figures["runs"]} runs of '
        f'{campaign.duration:g} s kept their sets: <b>{100.0 * figures["kept_share"]:.1f} %</b> '
        f'(95 %: {100.0 * low:.1f} to {100.0 * high:.1f} %).</p>', _spreads(figures),
        f'<label>Outcome: <select id="figure">{options}</select></label>', plots,
        '<h2>Worst runs</h2>', *_worst(rows, campaign),
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
    flat = [flat_changes(campaign.changes[row['run']]) for row in done]
    names = [name for name in (flat[0] if flat else {}) if all(
        isinstance(row[name], (int, float)) for row in flat)]
    varied = []
    for name in names[:MOST_COLUMNS]:
        values = np.array([row[name] for row in flat], dtype=float)
        varied.append({'name': name, 'values': values.tolist(), **shares_by_bin(values, kept)})
    return {
        'run': [row['run'] for row in done], 'kept': kept.tolist(), 'varied': varied,
        'figures': {column: {
            'label': f'{name} [{unit}]' if unit else name, 'log': 'error' in column,
            'values': [_number(shown_per_unit(unit) * row[column]) for row in done]}
            for column, name, unit in FIGURES}}


def _spreads(figures: Mapping[str, Any]) -> str:
    heads = ''.join(f'<th>{head}</th>' for head in ('', 'least', '5 %', 'median', '95 %',
                                                   'largest'))
    lines = []
    for column, name, unit in FIGURES:
        quantiles = figures[column]['quantiles']
        scale = shown_per_unit(unit)
        cells = ''.join(f'<td>{scale * value:.3g}</td>' for value in quantiles.values()) \
            if quantiles else '<td colspan="5">not known</td>'
        lines.append(f'<tr><td>{escape(f"{name} [{unit}]" if unit else name)}</td>{cells}</tr>')
    return f'<table><tr>{heads}</tr>{"".join(lines)}</table>'


def _worst(rows: Sequence[Row], campaign: Campaign) -> list[str]:
    lines = []
    for row in worst_runs(rows):
        verdict = row['problem'] or ('kept' if row['kept'] else
                                     f'left at {row["first_violation_s"]:.3f} s')
        lines.append(f'<p>run {row["run"]}: {escape(str(verdict))}<br>'
                     f'<code>{escape(campaign.command(row["run"]))}</code></p>')
    return lines
