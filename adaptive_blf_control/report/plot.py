# SPDX-License-Identifier: Apache-2.0
"""One picture of a run: tracking inside its bounds, the estimates converging."""

from __future__ import annotations

from pathlib import Path

from adaptive_blf_control.errors import MissingExtra
from adaptive_blf_control.runs.summary import Run
from adaptive_blf_control.runs.thinning import thin

__all__ = ['plot_run']

def plot_run(run: Run, path: Path, title: str) -> None:
    """Draw the run to a PNG.

    Args:
        run: The run.
        path: File to write.
        title: Line above the picture.

    Raises:
        MissingExtra: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtra('matplotlib', 'plot', 'the picture') from None
    n = len(run.joints)
    figure = Figure(figsize=(max(9.0, 2.6 * n), 8.5), layout='constrained')
    grid = figure.add_gridspec(3, n, height_ratios=(1.0, 1.0, 1.3))
    figure.suptitle(title)
    for i, joint in enumerate(run.joints):
        axes = figure.add_subplot(grid[0, i], title=joint)
        axes.axhspan(run.safety.lower[i], run.safety.upper[i], color='tab:green', alpha=0.10,
                     label='safety set')
        axes.plot(*thin(run.t, run.q[:, i]), color='tab:blue', label='measured')
        axes.plot(*thin(run.t, run.q[:, i] - run.e1[:, i]), 'k--', lw=1.0, label='reference')
        errors = figure.add_subplot(grid[1, i], sharex=axes)
        errors.axhspan(run.performance.lower[i], run.performance.upper[i], color='tab:green',
                       alpha=0.10, label='performance set')
        errors.axhline(0.0, color='k', lw=0.5)
        errors.plot(*thin(run.t, run.e1[:, i]), color='tab:red', label='tracking error')
        # The error is far smaller than its bound: show both, the error in an inset.
        inset = errors.inset_axes((0.48, 0.55, 0.5, 0.4))
        inset.plot(*thin(run.t, 1e3 * run.e1[:, i]), color='tab:red', lw=0.8)
        inset.tick_params(labelsize=6)
        inset.set_title('mrad', fontsize=7, pad=2)
        if i == 0:
            axes.set_ylabel('q [rad]')
            errors.set_ylabel('e1 [rad]')
            axes.legend(fontsize=7, loc='lower right')
            errors.legend(fontsize=7, loc='lower right')
        errors.set_xlabel('time [s]')
    estimates = figure.add_subplot(grid[2, :], xlabel='time [s]', ylabel='estimates')
    few = len(run.parameters) <= 12
    for j, name in enumerate(run.parameters):
        line, = estimates.plot(*thin(run.t_theta, run.theta_hat[:, j]), lw=1.5 if few else 0.7,
                               label=name if few else None)
        if run.truth:
            estimates.plot(run.t_theta, run.theta_true(run.t_theta)[:, j], color=line.get_color(),
                           ls='--', lw=0.8)
    estimates.set_title('estimates (solid)' + (
        ' and true parameters (dashed)' if run.truth else ''), fontsize=10)
    if few:
        estimates.legend(fontsize=8, loc='center left', bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, dpi=110)
