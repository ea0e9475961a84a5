# SPDX-License-Identifier: Apache-2.0
"""The picture of docs/limits.md: the law alone enters a sphere, with the filter it passes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_changes
from adaptive_blf_control.errors import MissingExtra
from adaptive_blf_control.limits.filter_look import Scene
from adaptive_blf_control.limits.link_spheres import sphere_centres
from adaptive_blf_control.limits.obstacles import distance
from adaptive_blf_control.limits.scene import scene_of

__all__ = ['draw']

TITLES = ('law alone', 'with safety_filter: limits')
COLOURS = ('#D55E00', '#0072B2')
OBSTACLE = '#A31621'
EVERY = 10  # samples between two points


class _Passed(NamedTuple):
    """A run: times (N,) [s], centres of link spheres (N, k, 3), least clearance (N,) [m]."""

    t: np.ndarray
    centres: np.ndarray
    clearance: np.ndarray


def draw(path: Path, data: Mapping[str, Any], duration: float) -> tuple[float, ...]:
    """Draw both runs of a parameter file; return their least clearances [m].

    Args:
        path: PNG file.
        data: Of an arm with one sphere in its way.
        duration: Of the runs [s].

    Raises:
        MissingExtra: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtra('matplotlib', 'plot', 'the picture of the limits') from None
    runs, scene = [], None
    for changes in ({'controller.safety_filter': 'none'}, {}):
        loop = build_closed_loop(apply_changes(dict(data), changes))
        loop.warm_up()
        scene = scene_of(loop.arm, loop.controller.settings.limits)
        runs.append(_passed(scene, loop.run(duration)))
    assert scene is not None
    figure = Figure(figsize=(10.0, 6.6), layout='constrained')
    grid = figure.add_gridspec(2, 2, height_ratios=(2.4, 1.0))
    for column, passed in enumerate(runs):
        _draw_arm(figure.add_subplot(grid[0, column], projection='3d'), scene, passed, column)
    axes = figure.add_subplot(grid[1, :])
    for passed, title, colour in zip(runs, TITLES, COLOURS):
        axes.plot(passed.t, passed.clearance, color=colour, label=title, lw=1.6)
    axes.axhline(0.0, color=OBSTACLE, lw=1.2)
    axes.axhspan(min(float(runs[0].clearance.min()), 0.0) - 0.02, 0.0, color=OBSTACLE, alpha=0.1)
    axes.set(xlabel='time [s]', ylabel='distance [m]', xlim=(0.0, duration),
             title='distance of the arm from sphere and table')
    axes.grid(color='#E3E7EC', lw=0.6)
    axes.legend(frameon=False, ncols=2)
    figure.savefig(path, dpi=130)
    return tuple(float(passed.clearance.min()) for passed in runs)


def _passed(scene: Scene, trace: Any) -> _Passed:
    rows = np.arange(0, trace.t.size, EVERY)
    centres = np.array([sphere_centres(scene.chain, scene.spheres, q)
                        for q in np.ascontiguousarray(trace.q[rows])])
    normal = np.empty(3)
    clearance = np.array([min(
        distance(scene.obstacles, k, point, normal) - radius
        for point, radius in zip(points, scene.spheres.radius)
        for k in range(scene.obstacles.radius.size)) for points in centres])
    return _Passed(trace.t[rows], centres, clearance)


def _draw_arm(axes: Any, scene: Scene, passed: _Passed, column: int) -> None:
    """Draw the arm where it is closest to the sphere, and the way of what is closest."""
    obstacles, links = scene.obstacles, scene.spheres
    ball = int(np.flatnonzero((obstacles.half == 0.0).all(axis=1))[0])
    centre, radius = obstacles.centre[ball], obstacles.radius[ball]
    apart = np.linalg.norm(passed.centres - centre, axis=2) - links.radius - radius
    frame, link = np.unravel_index(int(np.argmin(apart)), apart.shape)
    _ball(axes, centre, radius, OBSTACLE, 0.55)
    for point, size in zip(passed.centres[frame], links.radius):
        _ball(axes, point, size, COLOURS[column], 0.35)
    chain = np.vstack([np.zeros(3), passed.centres[frame]])
    axes.plot(*chain.T, color='#222222', lw=1.5)
    axes.plot(*passed.centres[:, link].T, color=COLOURS[column], lw=0.9)
    axes.set_title(f'{TITLES[column]}: {1e3 * apart[frame, link]:.0f} mm at '
                   f'{passed.t[frame]:.1f} s', fontsize=10)
    axes.set(xlim=(-0.1, 0.8), ylim=(-0.4, 0.5), zlim=(0.0, 0.9), xlabel='x [m]', ylabel='y [m]',
             zlabel='z [m]')
    axes.view_init(elev=22.0, azim=35.0)
    axes.set_box_aspect((1.0, 1.0, 1.0))


def _ball(axes: Any, centre: np.ndarray, radius: float, colour: str, alpha: float) -> None:
    u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 24), np.linspace(0.0, np.pi, 13))
    axes.plot_surface(centre[0] + radius * np.cos(u) * np.sin(v),
                      centre[1] + radius * np.sin(u) * np.sin(v), centre[2] + radius * np.cos(v),
                      color=colour, alpha=alpha, linewidth=0.0)
