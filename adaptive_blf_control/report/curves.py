# SPDX-License-Identifier: Apache-2.0
"""What a plot is made of, independent of any plotting library: curves in panels in sections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ['BAG_COLOURS', 'Band', 'Curve', 'INK', 'Panel', 'Section', 'held', 'histogram',
           'histogram_edges', 'zoomed']

# Okabe and Ito's colours, which colour-blind people tell apart, then darker ones.
BAG_COLOURS = ('#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9', '#7F3C8D',
               '#6B4C1E', '#3A6B35', '#A31621', '#4B4E6D', '#B8A600')
INK = '#222222'
BINS = 60
DECADES = 15  # below are rounding errors


@dataclass(frozen=True)
class Curve:
    """One line; ``x`` and ``y`` have shape (N,). ``step`` holds each value up to the next.

    Curves of one ``group`` are switched on and off together in the legend.
    """

    x: np.ndarray
    y: np.ndarray
    label: str
    colour: str
    bag: int
    dash: str = 'solid'
    width: float = 1.6
    step: bool = False
    fill: bool = False
    legend: bool = True
    group: str = ''


@dataclass(frozen=True)
class Band:
    """A shaded range of y, from ``lower`` to ``upper``."""

    lower: float
    upper: float
    label: str


@dataclass(frozen=True)
class Panel:
    """One plot.

    Attributes:
        key: File name and HTML id.
        title: Title.
        x_label: Label of x with its unit.
        y_label: Label of y with its unit.
        curves: Lines.
        bands: Shaded ranges.
        log_y: Logarithmic y axis.
        zoom: y-range of the curves alone, where the bands are far wider; else None.
        time: x is the time of the run.
        filters: Names of curves that a menu shows alone.
        spans: Intervals of time in which something acts from outside [s].
    """

    key: str
    title: str
    y_label: str
    curves: tuple[Curve, ...]
    x_label: str = 'time [s]'
    bands: tuple[Band, ...] = ()
    log_y: bool = False
    zoom: tuple[float, float] | None = None
    time: bool = True
    filters: tuple[str, ...] = ()
    spans: tuple[tuple[float, float], ...] = ()

    def log_range(self) -> tuple[float, float]:
        """Return the y-range of a logarithmic axis: at most ``DECADES`` below the largest."""
        values = np.concatenate([curve.y for curve in self.curves] or [np.ones(1)])
        values = values[np.isfinite(values) & (values > 0.0)]
        if values.size == 0:
            return 0.1, 10.0
        high = float(values.max())
        low = max(float(values.min()), high * 10.0 ** -DECADES)
        room = max((high / low) ** 0.05, 1.2)
        return low / room, high * room


@dataclass(frozen=True)
class Section:
    """Panels under one heading; ``columns`` of them side by side."""

    key: str
    title: str
    note: str
    panels: tuple[Panel, ...]
    columns: int = 2


def held(t: np.ndarray, y: np.ndarray, label: str, colour: str, bag: int) -> Curve:
    """Return a dashed line that is constant between changes: only the changes are kept."""
    change = np.flatnonzero(np.diff(y) != 0.0) + 1
    keep = np.unique(np.concatenate([[0], change, [t.size - 1]]))
    return Curve(t[keep], y[keep], label, colour, bag, 'dash', 1.0, step=True)


def zoomed(curves: Sequence[Curve], bands: Sequence[Band]) -> tuple[float, float] | None:
    """Return the y-range of curves alone where the bands are far wider, else None."""
    alone = _range(curves)
    wide = max((band.upper - band.lower for band in bands), default=0.0)
    return alone if alone and alone[1] - alone[0] < 0.5 * wide else None


def _range(curves: Sequence[Curve]) -> tuple[float, float] | None:
    """Return the y-range of curves with a little room, or None without a finite value."""
    values = np.concatenate([c.y for c in curves]) if curves else np.zeros(0)
    values = values[np.isfinite(values)]
    if values.size == 0:
        return None
    low, high = float(values.min()), float(values.max())
    room = 0.06 * (high - low) or 1e-6
    return low - room, high + room


def histogram_edges(values: Sequence[np.ndarray]) -> np.ndarray:
    """Return the edges of the bins that hold all these values, shape (BINS + 1,)."""
    low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
    if high - low < 1e-3 * max(abs(high), 1e-3):  # all alike, as offline: one bar of some width
        low, high = low - 0.05 * max(abs(low), 1e-3), high + 0.05 * max(abs(high), 1e-3)
    return np.linspace(low, high, BINS + 1)


def histogram(values: np.ndarray, edges: np.ndarray, label: str, colour: str,
              bag: int) -> Curve:
    """Return how many values lie in each bin as a filled line of steps."""
    counts, _ = np.histogram(values, edges)
    # Empty bins stay at a tenth of a sample, so that a logarithmic axis has a floor.
    y = np.maximum(np.append(counts, counts[-1]).astype(float), 0.1)
    return Curve(edges, y, label, colour, bag, step=True, fill=True, width=1.0)
