# SPDX-License-Identifier: Apache-2.0
"""What is plotted of an identification: torques, residuals, and what the history determines."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.bags.row_store import row_blocks
from adaptive_blf_control.report.curves import BAG_COLOURS, Curve, INK, Panel, Section
from adaptive_blf_control.runs.identification import Identification
from adaptive_blf_control.runs.log_pass import Prediction
from adaptive_blf_control.runs.thinning import thin

__all__ = ['identification_sections']

ROWS = 200_000  # of a longer test that are looked at
POINTS = 1500  # of a curve
BINS = 40
FEWEST = 5  # samples of a bin that is drawn
MEASURED, PREDICTED, INTERVAL = INK, BAG_COLOURS[0], BAG_COLOURS[1]


def identification_sections(result: Identification) -> list[Section]:
    """Return what can be plotted; without a test only what the history determines."""
    joints, prediction = result.arm.joints, _some(result.prediction)
    columns = min(len(joints), 3)
    found = []
    if prediction.t.size:
        lagged = _lagged(prediction, result.identifier.settings.filter.time_constant)
        found = [
            Section('torques', 'Torques that θ̂ was not learned from', 'Filtered torque τ_f, '
                    'measured and predicted with θ̂ frozen.', tuple(
                        _torque(prediction, i, joint) for i, joint in enumerate(joints)),
                    columns),
            Section('residuals', 'Residuals', 'Measured less predicted torque, and the 95 % '
                    'interval. It should look like noise that stays inside. While the arm '
                    'rests it need not: dry friction then takes any value up to its size.',
                    tuple(_residual(prediction, i, joint) for i, joint in enumerate(joints)),
                    columns),
            Section('friction', 'Residuals against velocity', 'Mean and standard deviation over '
                    f'{BINS} bins. A step at zero is dry friction that is not learned, a slope '
                    'viscous friction, a bow friction that grows otherwise; a peak at zero alone '
                    'is rest.', tuple(
                        _against(prediction, lagged[1], i, joint, 'velocity [rad/s]', 'friction')
                        for i, joint in enumerate(joints)), columns),
            Section('gravity', 'Residuals against position', 'The same over the position: a '
                    'wave is gravity, of a mass or a payload that is not learned.', tuple(
                        _against(prediction, lagged[0], i, joint, 'position [rad]', 'gravity')
                        for i, joint in enumerate(joints)), columns)]
    return found + _determined(result)


def _some(prediction: Prediction) -> Prediction:
    """Return evenly spaced rows: a long test is not taken into memory."""
    step = -(-prediction.t.size // ROWS) or 1
    if step == 1:
        return prediction
    rows = np.arange(0, prediction.t.size, step)
    chosen = Prediction(*(np.empty((len(rows), *part.shape[1:])) for part in prediction))
    for some in row_blocks(*prediction):
        first, end = np.searchsorted(rows, [some.start, some.stop])
        for part, whole in zip(chosen, prediction, strict=True):
            part[first:end] = whole[rows[first:end]]
    return chosen


def _lagged(prediction: Prediction, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Return q and q̇ behind the torque filter's lag, shape (K, n) each: what τ_f belongs to."""
    both = np.hstack([prediction.q, prediction.qd])
    steps = np.clip(np.diff(prediction.t, prepend=prediction.t[0]), 0.0, None)
    kept = np.exp(-steps / lag) if lag > 0.0 else np.zeros_like(steps)
    result, state = np.empty_like(both), both[0]
    for k, (row, part) in enumerate(zip(both, kept)):
        state = row + part * (state - row)
        result[k] = state
    q, qd = np.hsplit(result, 2)
    return q, qd


def _curve(t: np.ndarray, y: np.ndarray, label: str, colour: str, **style: object) -> Curve:
    return Curve(*thin(t, y, POINTS), label, colour, 0, **style)  # type: ignore[arg-type]


def _torque(prediction: Prediction, i: int, joint: str) -> Panel:
    t = prediction.t
    return Panel(f'torque_{joint}', joint, 'torque [N·m]', (
        _curve(t, prediction.measured[:, i], 'measured', MEASURED, width=2.2),
        _curve(t, prediction.predicted[:, i], 'predicted', PREDICTED, width=1.2)))


def _residual(prediction: Prediction, i: int, joint: str) -> Panel:
    t, half = prediction.t, prediction.half_width[:, i]
    curves = [_curve(t, prediction.measured[:, i] - prediction.predicted[:, i], 'residual',
                     PREDICTED, width=1.0)]
    if np.isfinite(half).any():
        curves += [_curve(t, sign * half, '95 % interval', INTERVAL, dash='dot', width=1.2,
                          legend=sign > 0.0) for sign in (1.0, -1.0)]
    return Panel(f'residual_{joint}', joint, 'residual [N·m]', tuple(curves))


def _against(prediction: Prediction, over: np.ndarray, i: int, joint: str, label: str,
             key: str) -> Panel:
    residual, x = prediction.measured[:, i] - prediction.predicted[:, i], over[:, i]
    centres, means, spreads = _binned(x, residual)
    return Panel(f'{key}_{joint}', joint, 'residual [N·m]', (
        Curve(centres, means, 'mean', PREDICTED, 0, width=2.0),
        Curve(centres, means + spreads, '± standard deviation', INTERVAL, 0, 'dot', 1.2),
        Curve(centres, means - spreads, '', INTERVAL, 0, 'dot', 1.2, legend=False)), label,
        time=False)


def _binned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return centres, means and standard deviations of the bins that hold enough."""
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    number = np.clip(np.searchsorted(edges, x, side='right') - 1, 0, BINS - 1)
    count = np.bincount(number, minlength=BINS)
    enough = count >= FEWEST
    with np.errstate(invalid='ignore', divide='ignore'):
        mean = np.bincount(number, y, BINS) / count
        square = np.bincount(number, y ** 2, BINS) / count
    spread = np.sqrt(np.maximum(square - mean ** 2, 0.0))
    return (0.5 * (edges[:-1] + edges[1:]))[enough], mean[enough], spread[enough]


def _determined(result: Identification) -> list[Section]:
    stack, growth = result.identifier.stack, result.growth
    panels = []
    if growth is not None and growth.t.size:
        names = ('largest', 'median', 'smallest')
        panels.append(Panel(
            'singular_values', 'While learning', 'singular value', tuple(
                Curve(growth.t, growth.singular[:, k], name, BAG_COLOURS[k], 0, step=True)
                for k, name in enumerate(names)), log_y=True))
        panels.append(Panel('rank', f'Rank, of {result.arm.m} parameters', 'rank', (
            Curve(growth.t, growth.rank, '', BAG_COLOURS[0], 0, step=True, legend=False),)))
    if stack.count:
        size = np.sqrt(np.maximum(np.diag(stack.gram), 1e-300))
        values = np.linalg.eigvalsh(stack.gram / np.outer(size, size))[::-1]
        panels.append(Panel(
            'directions', 'At the end', 'singular value', (
                Curve(np.arange(1.0, values.size + 1.0), np.sqrt(np.maximum(values, 1e-16)),
                      '', BAG_COLOURS[0], 0, legend=False),),
            'number of the direction', log_y=True, time=False))
    if not panels:
        return []
    return [Section('history', 'What the motion shows', 'Singular values of the recorded '
                    'regressors with columns of length one. The ratio of the largest to the '
                    'smallest is the condition: below 100 is good.', tuple(panels), 3)]
