# SPDX-License-Identifier: Apache-2.0
"""Panels as PNG files for papers, one figure each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import re
from typing import Any

from adaptive_blf_control.errors import MissingExtra
from adaptive_blf_control.report.curves import Panel, Section

__all__ = ['write_png']

SIZE = (5.0, 3.0)  # inches
DPI = 200
LEGEND_ROWS = 9  # more names go beside the plot
STYLES = {'solid': '-', 'dash': '--', 'dot': ':'}


def write_png(folder: Path, sections: Sequence[Section]) -> list[Path]:
    """Draw every panel to ``folder/KEY.png`` and return the files.

    Raises:
        MissingExtra: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtra('matplotlib', 'plot', 'the pictures of the report') from None
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for panel in (panel for section in sections for panel in section.panels):
        figure = Figure(figsize=SIZE, layout='constrained')
        _draw(figure.add_subplot(), panel)
        files.append(folder / f'{re.sub(r"[^A-Za-z0-9_.-]", "_", panel.key)}.png')
        figure.savefig(files[-1], dpi=DPI)
    return files


def _draw(axes: Any, panel: Panel) -> None:
    for i, band in enumerate(panel.bands):
        axes.axhspan(band.lower, band.upper, color='seagreen', alpha=0.13,
                     label=band.label if i == 0 else None)
    for begin, end in panel.spans:
        axes.axvspan(begin, end, color='tab:red', alpha=0.13, lw=0)
    _lines(axes, panel)
    if panel.zoom is not None:  # the error is far smaller than its bound: show both
        inset = axes.inset_axes((0.42, 0.60, 0.55, 0.34))
        _lines(inset, panel)
        inset.set_ylim(*panel.zoom)
        inset.tick_params(labelsize=6)
    if panel.log_y:
        axes.set_yscale('log')
        axes.set_ylim(*panel.log_range())
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.set_title(panel.title, fontsize=9, loc='left')
    axes.grid(color='#E3E7EC', lw=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0.0)
    _, labels = axes.get_legend_handles_labels()
    if not labels:
        return
    many = len(labels) > LEGEND_ROWS
    place: dict[str, Any] = {'loc': 'lower right'} if panel.zoom else {}  # the inset is above
    if many or panel.filters:
        place = {'loc': 'center left', 'bbox_to_anchor': (1.0, 0.5)}
    axes.legend(fontsize=5 if many else 7, framealpha=0.8, ncols=1 + len(labels) // 28, **place)


def _lines(axes: Any, panel: Panel) -> None:
    for curve in panel.curves:
        draw = axes.step if curve.step else axes.plot
        step = {'where': 'post'} if curve.step else {}
        draw(curve.x, curve.y, color=curve.colour, ls=STYLES[curve.dash], lw=0.75 * curve.width,
             label=curve.label if curve.legend else None, **step)
        if curve.fill:
            axes.fill_between(curve.x, curve.y, step='post' if curve.step else None,
                              color=curve.colour, alpha=0.25)
    if panel.bands:
        axes.axhline(0.0, color='#AAAAAA', lw=0.5, zorder=0)
