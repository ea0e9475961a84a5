# SPDX-License-Identifier: Apache-2.0
"""What is plotted of bags: sections of panels of curves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import cycle, islice

import numpy as np

from adaptive_blf_control.report.curves import (
    BAG_COLOURS,
    Band,
    Curve,
    held,
    histogram,
    histogram_edges,
    INK,
    Panel,
    Section,
    zoomed,
)
from adaptive_blf_control.runs.lyapunov import GuaranteeOverTime, true_over_time
from adaptive_blf_control.runs.margins import least_per_body
from adaptive_blf_control.runs.recording import Recording, Series
from adaptive_blf_control.runs.thinning import POINTS, thin
from adaptive_blf_control.runs.timing import command_delays_ms, intervals_ms

__all__ = ['sections', 'time_span']

SPANS = 100  # shaded intervals, the longest ones
BUDGET = 300_000  # points on a page, so that many bags of many parameters stay below 10 MB


def time_span(recordings: Sequence[Recording]) -> tuple[float, float]:
    """Return 0 and the last time of any bag [s]; states before the controller's are outside."""
    ends = [float(series.t[-1]) for r in recordings
            for series in (r.q, r.e1, r.theta_hat, r.torque)
            if series is not None and series.t.size]
    return 0.0, max([*ends, 1e-3])


def sections(recordings: Sequence[Recording],
             guarantees: Sequence[GuaranteeOverTime | None]) -> list[Section]:
    """Return what can be plotted of these bags, all bags in each panel."""
    maker = _Maker(recordings, guarantees)
    found = [
        Section('margins', 'Margins', 'Distance to the nearest bound of all constraints in '
                'one unit.', maker.margins(), 1),
        Section('positions', 'Joint positions', 'q and its reference; the shaded range is the '
                'safety set (7). Figs. 4, 9 and 13 of the paper.',
                maker.per_joint(maker.position), maker.columns),
        Section('errors', 'Tracking errors', 'e1 = q − y_d inside the performance set (8), '
                'shaded; dotted: what Theorem 2 guarantees (39). Figs. 5, 10 and 14.',
                maker.per_joint(maker.error), maker.columns),
        Section('torques', 'Torques', 'τ held over each sample interval; the shaded range is '
                'torque_limit. Figs. 6 and 11.',
                maker.per_joint(maker.torque), maker.columns),
        Section('estimates', 'Parameter estimates', 'θ̂ (solid) and, where known, θ* (dashed). '
                'Figs. 2, 7 and 15.', maker.estimates(), 1),
        Section('estimate_errors', 'Parameter errors', 'θ̃ = θ̂ − θ*. Figs. 3 and 8.',
                maker.estimate_errors(), 2),
        Section('history', 'History stack', 'Full rank makes θ̂ converge (Assumption 2), σ_min '
                'sets how fast.', maker.history(), 2),
        Section('external', 'External torque', 'Measured minus predicted torque behind the '
                'filters; dotted: up to there it means nothing. Where a joint is beyond, the '
                'plots over time are shaded in red and the tip is marked: a contact, a push, or '
                'an arm that is no longer the one that was recorded.',
                maker.per_joint(maker.external), maker.columns),
        Section('payload', 'Load', 'Mass at `payload.frame`, as found beside the model of the '
                'arm without it, with two standard deviations; 0 while there is none.',
                maker.payload(), 1),
        Section('limits', 'Limits', 'What the safety filter and the reference governor did '
                '(docs/limits.md): the torque that braking of all joints leaves, the distance of '
                'the links from obstacles now and until all joints stand, how fast and how far '
                'from its path the reference moves, and what came of the torque of the law.',
                maker.limits(), 2),
        Section('lyapunov', 'Lyapunov function', 'V = V1 + ½ e2ᵀM(θ*)e2 + ½ θ̃ᵀΓ⁻¹θ̃ must stay '
                'below its value at the start, or at a change of θ* (Theorem 2). The controller '
                'publishes V1 + ½ e2ᵀM(θ̂)e2.',
                maker.lyapunov(), 1),
        Section('timing', 'Timing', 'Sample interval from the stamps, delay from the times of '
                'reception.', maker.timing(), 2),
    ]
    spans = recordings[0].disturbed if len(recordings) == 1 else ()
    spans = tuple(sorted(spans, key=lambda span: span[0] - span[1])[:SPANS])
    return [replace(section, panels=tuple(
        replace(panel, spans=spans) if panel.time else panel for panel in section.panels))
        for section in found if section.panels]


class _Maker:
    """Makes the panels; colours go by bag, or by what is shown where there is one bag."""

    def __init__(self, recordings: Sequence[Recording],
                 guarantees: Sequence[GuaranteeOverTime | None]) -> None:
        self.recordings = recordings
        self.guarantees = guarantees
        self.one = len(recordings) == 1
        self.end = time_span(recordings)[1]
        curves = sum(4 * len(r.joints) + 2 * len(r.theta_names) + 6 for r in recordings)
        self.points = int(np.clip(BUDGET / max(curves, 1), 500, POINTS))
        self.joints = list(dict.fromkeys(j for r in recordings for j in r.joints))
        self.columns = min(max(len(self.joints), 1), 3)  # 3 are readable at 1280 px
        self.colours = list(islice(cycle(BAG_COLOURS), len(recordings)))

    def per_joint(self, make: Callable[[str], Panel]) -> tuple[Panel, ...]:
        panels = [make(joint) for joint in self.joints]
        return tuple(panel for panel in panels if panel.curves)

    def _curve(self, series: Series, column: int, label: str, colour: str, bag: int,
               dash: str = 'solid', width: float = 1.6) -> Curve:
        return Curve(*thin(series.t, series.values[:, column], self.points), label, colour, bag,
                     dash, width)

    def _label(self, bag: int, what: str) -> str:
        return what if self.one else f'{self.recordings[bag].name}: {what}'

    def _with(self, joint: str) -> list[tuple[int, Recording, int]]:
        return [(b, r, r.joints.index(joint)) for b, r in enumerate(self.recordings)
                if joint in r.joints]

    def position(self, joint: str) -> Panel:
        curves: list[Curve] = []
        bands: dict[Band, None] = {}
        for b, r, i in self._with(joint):
            if r.q is not None:
                curves.append(self._curve(r.q, i, self._label(b, 'q'), self.colours[b], b))
            if r.reference is not None:
                line = self._curve(r.reference, i, self._label(b, 'reference'),
                              INK if self.one else self.colours[b], b, dash='dash', width=1.2)
                curves.append(line)
            if r.safety is not None:
                bands[Band(float(r.safety.lower[i]), float(r.safety.upper[i]),
                           'set (7)')] = None
        return Panel(f'position_{joint}', joint, 'q [rad]', tuple(curves), bands=tuple(bands))

    def error(self, joint: str) -> Panel:
        curves: list[Curve] = []
        bands: dict[Band, None] = {}
        for b, r, i in self._with(joint):
            if r.e1 is None:
                continue
            curves.append(self._curve(r.e1, i, self._label(b, 'e1'), self.colours[b], b))
            if r.performance is not None:
                bands[Band(float(r.performance.lower[i]), float(r.performance.upper[i]),
                           'set (8)')] = None
        zoom = zoomed(curves, tuple(bands))
        for b, r, i in self._with(joint):
            guaranteed = self.guarantees[b]
            if guaranteed is not None and r.e1 is not None:
                ends = np.array([r.e1.t[0], r.e1.t[-1]])
                for which, limit in enumerate((guaranteed.lower[i], guaranteed.upper[i])):
                    curves.append(Curve(ends, np.full(2, limit),
                                        self._label(b, 'Ω_e1 (39)'),
                                        INK if self.one else self.colours[b], b, dash='dot',
                                        width=1.2, legend=which == 0))
        return Panel(f'error_{joint}', joint, 'e1 [rad]', tuple(curves), bands=tuple(bands),
                     zoom=zoom)

    def margins(self) -> tuple[Panel, ...]:
        units = dict.fromkeys(m.unit for r in self.recordings for m in r.margins)
        return tuple(self._margins_in(unit) for unit in units)

    def _margins_in(self, unit: str) -> Panel:
        curves = []
        for b, r in enumerate(self.recordings):
            margins = [m for m in r.margins if m.unit == unit]
            if not self.one:
                margins = [m._replace(bodies=('least of all joints',),
                                      values=m.values.min(axis=1)[:, None]) for m in margins]
            curves += [
                self._curve(Series(t, values[:, None]), 0, self._label(b, body),
                            self._tone(b, i), b)
                for i, (body, (t, values)) in enumerate(least_per_body(margins).items())]
        ends = np.array([min(c.x[0] for c in curves), max(c.x[-1] for c in curves)])
        curves.append(Curve(ends, np.zeros(2), 'bound', '#C0262D', -1, width=1.2))
        key = 'margins' if unit == 'rad' else f'margins_{unit}'
        return Panel(key, 'Margin to the nearer bound', f'margin [{unit}]', tuple(curves))

    def torque(self, joint: str) -> Panel:
        curves = [self._curve(r.torque, i, self._label(b, 'τ'), self.colours[b], b, width=1.2)
                  for b, r, i in self._with(joint) if r.torque is not None]
        limits = {float(r.run.torques.limit[i]) for _, r, i in self._with(joint)
                  if r.run is not None and r.run.torques is not None}
        bands = tuple(Band(-limit, limit, 'torque_limit') for limit in sorted(limits))
        return Panel(f'torque_{joint}', joint, 'τ [N·m]', tuple(curves), bands=bands,
                     zoom=zoomed(curves, bands))

    def external(self, joint: str) -> Panel:
        curves: list[Curve] = []
        for b, r, i in self._with(joint):
            known = r.external
            if known is None or not np.isfinite(known.values).any():
                continue
            n = len(r.joints)
            bound = np.where(np.isfinite(known.values[:, n + i]), known.values[:, n + i], np.nan)
            curves.append(self._curve(known, i, self._label(b, 'measured − predicted'),
                                      self.colours[b], b, width=1.2))
            for side in (1.0, -1.0):
                curves.append(replace(
                    self._curve(Series(known.t, side * bound[:, None]), 0,
                                self._label(b, 'bound'), INK if self.one else self.colours[b], b,
                                dash='dot', width=1.0), legend=side > 0.0))
        return Panel(f'external_{joint}', joint, 'τ [N·m]', tuple(curves))

    def _names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(n for r in self.recordings for n in r.theta_names))

    def _tone(self, bag: int, number: int) -> str:
        return BAG_COLOURS[number % len(BAG_COLOURS)] if self.one else self.colours[bag]

    def estimates(self) -> tuple[Panel, ...]:
        names = self._names()
        curves = []
        for b, r in enumerate(self.recordings):
            truth = true_over_time(r)
            if r.theta_hat is None:
                continue
            for j, name in enumerate(r.theta_names):
                tone = self._tone(b, names.index(name))
                curves.append(self._curve(r.theta_hat, j, self._label(b, name), tone, b))
                if truth is not None:
                    curves.append(replace(held(
                        r.theta_hat.t, truth[:, j], self._label(b, f'{name} true'), tone, b),
                        legend=False, group=self._label(b, name)))
        return (Panel('estimates', 'θ̂ and θ*', 'θ̂ [SI units of each parameter]', tuple(curves),
                      filters=names),) if curves else ()

    def estimate_errors(self) -> tuple[Panel, ...]:
        names = self._names()
        norms, parts = [], []
        for b, r in enumerate(self.recordings):
            truth = true_over_time(r)
            if r.theta_hat is None or truth is None:
                continue
            error = Series(r.theta_hat.t, r.theta_hat.values - truth)
            norm = Series(error.t, np.linalg.norm(error.values, axis=1)[:, None])
            norms.append(self._curve(norm, 0, self._label(b, '‖θ̃‖'), self.colours[b], b))
            size = 0.01 * float(np.linalg.norm(truth[-1]))
            norms.append(Curve(norm.t[[0, -1]], np.full(2, size),
                               self._label(b, '1 % of ‖θ*‖'), INK if self.one
                               else self.colours[b], b, dash='dash', width=1.0))
            parts += [self._curve(error, j, self._label(b, name),
                                  self._tone(b, names.index(name)), b)
                      for j, name in enumerate(r.theta_names)]
        if not norms:
            return ()
        return (Panel('error_norm', 'Norm', '‖θ̃‖', tuple(norms), log_y=True),
                Panel('error_components', 'Components', 'θ̃ [SI units of each parameter]',
                      tuple(parts), filters=names))

    def history(self) -> tuple[Panel, ...]:
        panels = []
        for key, title, label in (('rank', 'Rank', 'rank'),
                                  ('sigma_min', 'Smallest eigenvalue', 'σ_min(H Hᵀ)')):
            curves = []
            for b, r in enumerate(self.recordings):
                series: Series | None = getattr(r, key)
                if series is not None:
                    # It is published on change: the last value holds to the end.
                    t, y = thin(np.append(series.t, max(self.end, series.t[-1])),
                                np.append(series.values, series.values[-1]))
                    if key == 'sigma_min':  # 0 has no logarithm
                        t, y = t[y > 0.0], y[y > 0.0]
                    curves.append(Curve(t, y, self._label(b, label), self.colours[b], b,
                                        step=True))
                if series is not None and key == 'rank' and r.theta_names and (
                        self.one or b == 0):
                    curves.append(Curve(np.array([0.0, self.end]),
                                        np.full(2, len(r.theta_names)),
                                        'full rank', INK, b, dash='dash', width=1.0))
            if any(curve.x.size for curve in curves):
                panels.append(Panel(key, title, label, tuple(curves), log_y=key != 'rank'))
        return tuple(panels)

    def limits(self) -> tuple[Panel, ...]:
        """Return reserve, clearances, path and kind, as `controller/reserve` has them."""
        panels = [self._watched('reserve', 'Reserve of torque', 'reserve [N·m]', '.reserve'),
                  self._watched('clearance', 'Distance from obstacles', 'distance [m]',
                                'clearance', bound=0.0),
                  self._watched('path', 'Rate of the path, and distance from it', 'rate; [rad]',
                                'path_rate', 'path_off'),
                  self._watched('kind', '0 let through, 1 filtered, 2 braking, 3 softened',
                                'kind', 'kind', step=True)]
        return tuple(panel for panel in panels if panel.curves)

    def _watched(self, key: str, title: str, label: str, *ends: str, bound: float | None = None,
                 step: bool = False) -> Panel:
        curves = []
        for b, r in enumerate(self.recordings):
            chosen = [(i, name) for i, name in enumerate(r.reserve_names)
                      if name.endswith(ends)] if r.reserve is not None else []
            for number, (i, name) in enumerate(chosen):
                assert r.reserve is not None
                curves.append(replace(self._curve(
                    r.reserve, i, self._label(b, name.removesuffix('.reserve')),
                    self._tone(b, number), b), step=step))
        if curves and bound is not None:
            times = np.array([min(c.x[0] for c in curves), max(c.x[-1] for c in curves)])
            curves.append(Curve(times, np.full(2, bound), 'bound', '#C0262D', -1, width=1.2))
        return Panel(f'limits_{key}', title, label, tuple(curves))

    def payload(self) -> tuple[Panel, ...]:
        curves = []
        for b, r in enumerate(self.recordings):
            if r.payload is None:
                continue
            mass, std = r.payload.values.T
            for label, values, dash in (('mass', mass, 'solid'),
                                        ('± 2 std', mass + 2.0 * std, 'dot'),
                                        ('', np.maximum(mass - 2.0 * std, 0.0), 'dot')):
                curves.append(replace(
                    self._curve(Series(r.payload.t, values[:, None]), 0, self._label(b, label),
                                self.colours[b], b, dash=dash),
                    legend=bool(label), step=True))
        return (Panel('payload', 'Mass of the load', 'mass [kg]', tuple(curves)),) if curves \
            else ()

    def lyapunov(self) -> tuple[Panel, ...]:
        curves = []
        for b, (r, guaranteed) in enumerate(zip(self.recordings, self.guarantees)):
            if r.lyapunov is not None:
                t, y = thin(*r.lyapunov)
                t, y = t[y > 0.0], y[y > 0.0]
                curves.append(Curve(t, y, self._label(b, 'V without θ̃, published'),
                                    '#8899AA' if self.one else self.colours[b], b, width=1.0,
                                    dash='solid' if self.one else 'dot'))
            if guaranteed is not None:
                curves.append(Curve(*thin(guaranteed.t, guaranteed.v), self._label(b, 'V (57)'),
                                    self.colours[b], b, width=2.0))
                curves.append(held(guaranteed.t, guaranteed.bound, self._label(b, 'bound V(0)'),
                                    INK if self.one else self.colours[b], b))
        return (Panel('lyapunov', 'V', 'V', tuple(curves), log_y=True),) if curves else ()

    def timing(self) -> tuple[Panel, ...]:
        panels = []
        for key, title, x_label, values in (
                ('intervals', 'Sample interval', 'interval between stamps [ms]', intervals_ms),
                ('delays', 'Delay from state to command', 'delay at the recorder [ms]',
                 command_delays_ms)):
            found = [(b, values(r)) for b, r in enumerate(self.recordings)]
            found = [(b, v) for b, v in found if v.size and (key == 'intervals' or v.max() > 0)]
            if found:
                edges = histogram_edges([v for _, v in found])
                curves = [histogram(v, edges, self._label(b, 'samples'), self.colours[b], b)
                          for b, v in found]
                panels.append(Panel(key, title, 'samples', tuple(curves), x_label=x_label,
                                    log_y=True, time=False))
        return tuple(panels)
