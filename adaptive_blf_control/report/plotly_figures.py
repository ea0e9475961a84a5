# SPDX-License-Identifier: Apache-2.0
"""Panels and the animation as plotly figures, ready for the page."""

from __future__ import annotations

from collections.abc import Sequence
import json
from typing import Any

import numpy as np

from adaptive_blf_control.errors import MissingExtra
from adaptive_blf_control.report.animation import Animation
from adaptive_blf_control.report.curves import Curve, INK, Panel

__all__ = ['animation_figure', 'animation_frames', 'panel_figure', 'plotly_js', 'y_axis']

FONT = 'system-ui, -apple-system, "Segoe UI", "Liberation Sans", "DejaVu Sans", sans-serif'
GRID = '#E3E7EC'
BAND = 'rgba(46, 139, 87, 0.12)'
BAND_EDGE = 'rgba(46, 139, 87, 0.75)'
SPAN = 'rgba(214, 39, 40, 0.13)'


def _plotly() -> Any:
    try:
        import plotly.graph_objects
        import plotly.offline
    except ImportError:
        raise MissingExtra('plotly', 'plot', 'the page of the report') from None
    return plotly


def plotly_js() -> str:
    """Return plotly's JavaScript, to embed; MissingExtra where plotly is not installed."""
    return str(_plotly().offline.get_plotlyjs())


def panel_figure(panel: Panel, height: int, legend_right: bool,
                 span: tuple[float, float]) -> dict[str, Any]:
    """Return a panel as plotly's JSON: ``data`` and ``layout``.

    Args:
        panel: What to draw.
        height: Height on the page [px].
        legend_right: A column of names on the right instead of a row above the plot.
        span: First and last time of all bags [s].
    """
    traces = [_trace(curve, panel) for curve in panel.curves]
    traces += [_band_name(panel.bands[0].label)] if panel.bands else []
    layout = _layout(height, legend_right)
    layout['title'] = {'text': panel.title, 'x': 0, 'xref': 'paper', 'xanchor': 'left',
                       'font': {'size': 14, 'color': INK}, 'y': 0.98, 'yanchor': 'top'}
    layout['xaxis'] = {**_axis(panel.x_label), **({'range': list(span)} if panel.time else {})}
    layout['yaxis'] = {**_axis(panel.y_label), **y_axis(panel)}
    layout['shapes'] = [
        {'type': 'rect', 'xref': 'paper', 'x0': 0, 'x1': 1, 'y0': band.lower, 'y1': band.upper,
         'fillcolor': BAND, 'line': {'width': 1, 'color': BAND_EDGE}, 'layer': 'below'}
        for band in panel.bands]
    layout['shapes'] += [
        {'type': 'rect', 'yref': 'paper', 'y0': 0, 'y1': 1, 'x0': begin, 'x1': end,
         'fillcolor': SPAN, 'line': {'width': 0}, 'layer': 'below'} for begin, end in panel.spans]
    if panel.time:  # the last shape is the cursor that follows the slider
        layout['shapes'].append({
            'type': 'line', 'yref': 'paper', 'y0': 0, 'y1': 1, 'x0': 0, 'x1': 0, 'opacity': 0.0,
            'line': {'color': '#D62728', 'width': 1}})
    if menu := _menu(panel):
        layout['updatemenus'] = [menu]
        layout['legend']['y'] = 0.86 if height > 350 else 0.80
    return _json(traces, layout)


def _trace(curve: Curve, panel: Panel) -> dict[str, Any]:
    hover = ('%{y:.5g}' if panel.time else '%{x:.4g} ms: %{y:.0f}' if '[ms]' in panel.x_label
             else '%{x:.4g}: %{y:.5g}')
    return {
        'type': 'scatter', 'mode': 'lines', 'x': _single(curve.x), 'y': _single(curve.y),
        'name': curve.label, 'legendgroup': curve.group or curve.label, 'showlegend': curve.legend,
        'meta': {'bag': curve.bag}, 'hovertemplate': f'{curve.label} {hover}<extra></extra>',
        'fill': 'tozeroy' if curve.fill else None,
        'fillcolor': _translucent(curve.colour) if curve.fill else None,
        'line': {'color': curve.colour, 'width': curve.width, 'dash': curve.dash,
                 'shape': 'hv' if curve.step else 'linear', 'simplify': True}}


def _band_name(label: str) -> dict[str, Any]:
    """An empty trace that only puts the shaded range into the legend."""
    return {'type': 'scatter', 'mode': 'markers', 'x': [None], 'y': [None], 'name': label,
            'hoverinfo': 'skip', 'marker': {'symbol': 'square', 'size': 11, 'color': BAND,
                                            'line': {'width': 1, 'color': BAND_EDGE}}}


def _single(values: np.ndarray) -> np.ndarray:
    """Single precision is enough for drawing and halves the size of the page."""
    return np.asarray(values, dtype=np.float32)


def _translucent(colour: str) -> str:
    red, green, blue = (int(colour[i:i + 2], 16) for i in (1, 3, 5))
    return f'rgba({red}, {green}, {blue}, 0.25)'


def _layout(height: int, legend_right: bool) -> dict[str, Any]:
    legend = {'orientation': 'h', 'x': 1, 'xanchor': 'right', 'y': 1.0, 'yanchor': 'bottom'}
    if legend_right:
        legend = {'x': 1.01, 'xanchor': 'left', 'y': 1.0, 'yanchor': 'top'}
    return {
        'template': 'none', 'height': height, 'autosize': True, 'hovermode': 'x unified',
        'font': {'family': FONT, 'size': 12, 'color': INK}, 'showlegend': True,
        'legend': {**legend, 'font': {'size': 11}, 'bgcolor': 'rgba(0,0,0,0)',
                   'itemwidth': 30},
        'margin': {'l': 62, 'r': 14, 't': 54, 'b': 44},
        'paper_bgcolor': 'white', 'plot_bgcolor': 'white', 'hoverlabel': {'namelength': -1}}


def _axis(label: str) -> dict[str, Any]:
    return {'title': {'text': label, 'font': {'size': 12}, 'standoff': 6}, 'gridcolor': GRID,
            'zeroline': False, 'showline': True, 'linecolor': '#8A94A0', 'ticks': 'outside',
            'tickcolor': '#8A94A0', 'ticklen': 4, 'automargin': True}


def y_axis(panel: Panel) -> dict[str, Any]:
    """Return type and range of the y axis; {} where plotly finds the range."""
    if panel.log_y:
        low, high = np.log10(panel.log_range())
        # One label per decade or a few: dense minor labels are unreadable.
        return {'type': 'log', 'exponentformat': 'power', 'range': [low, high],
                'tickfont': {'size': 10}, 'dtick': max(1, int(np.ceil((high - low) / 6.0)))}
    if not panel.bands:
        return {}
    low = min([band.lower for band in panel.bands] + [_extreme(panel, np.nanmin)])
    high = max([band.upper for band in panel.bands] + [_extreme(panel, np.nanmax)])
    room = 0.07 * (high - low)
    return {'range': [low - room, high + room]}


def _extreme(panel: Panel, which: Any) -> float:
    values = [c.y[np.isfinite(c.y)] for c in panel.curves]
    return float(which([which(v) for v in values if v.size] or [1.0]))


def _menu(panel: Panel) -> dict[str, Any] | None:
    """A menu that shows one parameter alone, above the legend on the right."""
    if len(panel.filters) < 2:
        return None
    buttons = [{'label': 'all', 'method': 'restyle', 'args': [{'visible': True}]}]
    for name in panel.filters:
        shown = [_is_of(curve.label, name) for curve in panel.curves]
        buttons.append({'label': name, 'method': 'restyle', 'args': [{'visible': shown}]})
    return {'type': 'dropdown', 'direction': 'down', 'buttons': buttons, 'showactive': True,
            'font': {'size': 11}, 'x': 1.01, 'xanchor': 'left', 'y': 1.0, 'yanchor': 'top',
            'bgcolor': 'white', 'bordercolor': '#C3CAD3', 'pad': {'t': 0, 'b': 0}}


def _is_of(label: str, name: str) -> bool:
    what = label.rpartition(': ')[2]
    return what in (name, f'{name} true')


def _json(traces: Sequence[dict[str, Any]], layout: dict[str, Any]) -> dict[str, Any]:
    figure = _plotly().graph_objects.Figure(data=list(traces), layout=layout)
    result: dict[str, Any] = json.loads(figure.to_json())
    return result


def animation_figure(animation: Animation, names: Sequence[str],
                     colours: Sequence[str]) -> dict[str, Any]:
    """Return the first frame: for each bag the reference posture and the arm, in trace order."""
    traces = []
    for b, (arm, reference) in enumerate(zip(animation.arms, animation.references)):
        for points, what, dash in ((reference, 'reference', 'dot'), (arm, 'measured', 'solid')):
            if points is not None:
                label = what if len(names) == 1 else f'{names[b]}: {what}'
                traces.append({**_skeleton(points[0], label, colours[b], dash, animation.planar),
                               'meta': {'bag': b}})
    # Behind the skeletons: the frames are those of the first traces.
    traces += [{**_marks(points, 'acted on from outside', animation.planar), 'meta': {'bag': b}}
               for b, points in enumerate(animation.disturbed) if points is not None]
    layout = _layout(400, legend_right=False)
    layout['showlegend'] = len(names) == 1
    layout['hovermode'] = 'closest'
    low, high = _extent(animation)
    if animation.planar:
        layout['xaxis'] = {**_axis('x [m]'), 'range': [low[0], high[0]], 'constrain': 'domain'}
        layout['yaxis'] = {**_axis('y [m]'), 'range': [low[1], high[1]], 'scaleanchor': 'x',
                           'constrain': 'domain'}
    else:
        layout['margin'] = {'l': 0, 'r': 0, 't': 54, 'b': 0}
        # Equal scales; plotly's own mode looks at the first frame only, which may be flat.
        ratio = 1.15 * (high - low) / np.max(high - low)
        layout['scene'] = {
            'aspectmode': 'manual', 'aspectratio': dict(zip('xyz', ratio.tolist())),
            'camera': {'eye': {'x': 1.55, 'y': 1.55, 'z': 0.8},
                       'center': {'x': 0, 'y': 0, 'z': -0.12}},
            **{f'{axis}axis': {'title': {'text': f'{axis} [m]'}, 'range': [low[i], high[i]],
                               'gridcolor': '#C3CAD3', 'zerolinecolor': '#C3CAD3'}
               for i, axis in enumerate('xyz')}}
    return _json(traces, layout)


def _skeleton(points: np.ndarray, name: str, colour: str, dash: str,
              planar: bool) -> dict[str, Any]:
    measured = dash == 'solid'
    axes = dict(zip('xy' if planar else 'xyz', points.T.tolist()))
    # Sizes in 3D are drawn larger than in the plane.
    width, size = ((6 if planar else 9), (11 if planar else 5)) if measured else \
        (3, (6 if planar else 3))
    return {'type': 'scatter' if planar else 'scatter3d', 'mode': 'lines+markers', **axes,
            'name': name, 'opacity': 1.0 if measured else 0.55,
            'line': {'color': colour if measured else '#555555', 'width': width, 'dash': dash},
            'marker': {'size': size, 'color': 'white' if measured and planar else colour,
                       'line': {'color': colour, 'width': 2 if planar else 0}},
            'hovertemplate': '%{x:.3f}, %{y:.3f} m<extra></extra>' if planar else
                             '%{x:.3f}, %{y:.3f}, %{z:.3f} m<extra></extra>'}


def _marks(points: np.ndarray, name: str, planar: bool) -> dict[str, Any]:
    """Return where the tip was while something acted on it, (K, 3)."""
    axes = dict(zip('xy' if planar else 'xyz', points.T.tolist()))
    return {'type': 'scatter' if planar else 'scatter3d', 'mode': 'markers', **axes, 'name': name,
            'marker': {'size': 9 if planar else 4, 'color': '#D62728', 'symbol': 'x'},
            'hovertemplate': f'{name}<extra></extra>'}


def _extent(animation: Animation) -> tuple[np.ndarray, np.ndarray]:
    points = np.concatenate([p.reshape(-1, 3) for p in (*animation.arms, *animation.references)
                             if p is not None])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.08 * float(np.max(high - low)) + 1e-3
    return low - room, high + room


def animation_frames(animation: Animation) -> dict[str, Any]:
    """Return the frames for the slider: times and, per trace, x, y (and z) of each frame."""
    axes = 2 if animation.planar else 3
    traces = [points for pair in zip(animation.references, animation.arms) for points in pair
              if points is not None]
    return {'t': np.round(animation.t, 4).tolist(),
            'axes': ['x', 'y', 'z'][:axes],
            'traces': [np.round(p[:, :, :axes].transpose(0, 2, 1), 4).tolist() for p in traces]}
