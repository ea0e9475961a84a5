# SPDX-License-Identifier: Apache-2.0
"""A self-contained page: its frame, and cards with plots."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib import resources
import json
from typing import Any

from adaptive_blf_control import __version__
from adaptive_blf_control.report.curves import Panel, Section
from adaptive_blf_control.report.plotly_figures import panel_figure, plotly_js, y_axis

__all__ = ['Plots', 'card', 'document', 'section_html']

PACKAGE = 'adaptive_blf_control.report'
LEGEND = 13  # names that fit beside a plot of several bags


class Plots:
    """The plots of a page as they are made, in order."""

    def __init__(self, span: tuple[float, float], *, one: bool) -> None:
        """Take first and last time [s], and whether the page is of one bag."""
        self.made: list[dict[str, Any]] = []
        self.span = span
        self.one = one


def document(title: str, hint: str, body: Sequence[str], plots: Plots, *, figures: Any,
             frames: Any = None) -> str:
    """Return the whole page as one HTML text that needs nothing else.

    Args:
        title: Of the page, plain text.
        hint: What can be done with it, at its foot.
        body: HTML.
        plots: Plots that the body has a place for.
        figures: The numbers of the page, for programs that read it.
        frames: Of the animation, or None.

    Raises:
        MissingExtra: plotly is not installed.
    """
    library = plotly_js()
    css, script = (resources.files(PACKAGE).joinpath(name).read_text(encoding='utf-8')
                   for name in ('page.css', 'page.js'))
    return '\n'.join([
        '<!DOCTYPE html>', '<html lang="en">', '<head>', '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<title>{escape(title)}</title>', '<link rel="icon" href="data:,">',
        f'<style>{css}</style>', f'<script>{library}</script>', '</head>', '<body>', '<main>',
        *body, f'<footer>adaptive_blf_control {__version__}. {hint}</footer>', '</main>',
        _data('figures', figures), _data('plots', plots.made), _data('frames', frames),
        f'<script>{script}</script>', '</body>', '</html>', ''])


def _data(name: str, value: Any) -> str:
    """A script tag with JSON in it, which no text of a log can end or open."""
    text = json.dumps(value, separators=(',', ':'), allow_nan=False).replace('<', '\\u003c')
    return f'<script type="application/json" id="{name}">{text}</script>'


def section_html(section: Section, plots: Plots) -> str:
    """Return a heading with a card for each panel."""
    cards = ''.join(card(panel, section, plots) for panel in section.panels)
    zoom = any(panel.zoom is not None for panel in section.panels)
    button = (f'<button type="button" class="zoom" data-section="{section.key}">'
              'zoom to the errors</button>') if zoom else ''
    return (f'<h2 id="{section.key}">{section.title} {button}</h2>'
            f'<p class="note">{section.note}</p>'
            f'<div class="grid columns{section.columns}">{cards}</div>')


def card(panel: Panel, section: Section, plots: Plots) -> str:
    """Return the place of a plot."""
    name = f'{section.key}{len(plots.made)}'
    right = section.columns == 1 or bool(panel.filters)
    figure = panel_figure(panel, 400 if section.columns == 1 else 310, right, plots.span)
    if not plots.one and not (section.columns == 1 and len(panel.curves) < LEGEND):
        figure['layout']['showlegend'] = False  # the bags' legend is above, for all plots
    zoom = None if panel.zoom is None else [y_axis(panel)['range'], list(panel.zoom)]
    plots.made.append({'id': name, 'section': section.key, 'time': panel.time, 'zoom': zoom,
                       **figure})
    return f'<div class="card"><div id="{name}"></div></div>'
