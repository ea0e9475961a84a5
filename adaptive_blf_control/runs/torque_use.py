# SPDX-License-Identifier: Apache-2.0
"""What a run asked of the drives, and whether a joint oscillates inside its sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

__all__ = ['TorqueUse', 'name_width', 'oscillation_text', 'oscillations', 'torque_figures',
           'torque_table']

LAST = 0.75  # statistics are of what comes after this part of the run
FREQUENCY = 15.0  # rad/s: above what an arm is asked to follow, so it is the loop that oscillates
PART = 0.05  # of its bound that RMS e1 has to reach to be worth a word


class TorqueUse(NamedTuple):
    """Commanded torques of a run.

    Attributes:
        torque: Shape (K, n) [N·m].
        limit: Shape (n,) [N·m].
    """

    torque: np.ndarray
    limit: np.ndarray


def torque_figures(use: TorqueUse | None) -> dict[str, list[float] | None]:
    """Return chatter [N·m], saturated part and reserve per joint; None where not known.

    ``chatter`` is the RMS of the difference between two commands, over the last quarter,
    ``saturated`` the part of the commands at the limit, ``torque_reserve`` the part of the limit
    that the largest command leaves.
    """
    if use is None or use.torque.shape[0] < 2:
        return {'chatter': None, 'saturated': None, 'torque_reserve': None}
    size = np.abs(use.torque)
    steps = np.diff(use.torque[int(LAST * use.torque.shape[0]):], axis=0)
    return {'chatter': np.sqrt(np.mean(steps ** 2, axis=0)).tolist() if steps.size else None,
            'saturated': np.mean(size >= use.limit * (1.0 - 1e-9), axis=0).tolist(),
            'torque_reserve': (1.0 - size.max(axis=0) / use.limit).tolist()}


def oscillations(t: np.ndarray, e1: np.ndarray, lower: np.ndarray,
                 upper: np.ndarray) -> list[float | None]:
    """Return how fast each joint oscillates within its bounds [rad/s], None where it does not.

    Over the last quarter, e1 without its mean has the mean frequency RMS(ė1)/RMS(e1).

    Args:
        t: Times, shape (N,) [s].
        e1: Tracking errors, shape (N, n) [rad].
        lower: Performance bounds, shape (n,) [rad].
        upper: Likewise.
    """
    last = t >= t[0] + LAST * (t[-1] - t[0])
    if np.count_nonzero(last) < 3:
        return [None] * e1.shape[1]
    times, errors = t[last], e1[last] - np.mean(e1[last], axis=0)
    speed = np.sqrt(np.mean((np.diff(errors, axis=0) / np.diff(times)[:, None]) ** 2, axis=0))
    size = np.sqrt(np.mean(errors ** 2, axis=0))
    wide = size > PART * np.minimum(-lower, upper)
    fast = speed > FREQUENCY * size
    return [float(v / s) if a and b else None for v, s, a, b in zip(speed, size, wide, fast)]


def oscillation_text(figures: Mapping[str, Any]) -> str:
    """Name the joints that oscillate, '' where none does."""
    return ', '.join(f'{joint} oscillates with {frequency:.0f} rad/s' for joint, frequency in zip(
        figures['joints'], figures['oscillation'] or ()) if frequency is not None)


def name_width(joints: Sequence[str]) -> int:
    """Return the width of the column with the names of the joints [characters]."""
    return max([18, *map(len, joints)])


def torque_table(figures: Mapping[str, Any]) -> list[str]:
    """Return the figures of the torque as lines of a table, none where they are not known."""
    if figures['chatter'] is None:
        return []
    rows = zip(figures['joints'], figures['chatter'], figures['saturated'],
               figures['torque_reserve'])
    wide = name_width(figures['joints'])
    return ['', f'{"joint":<{wide}}{"chatter [N·m]":>14}{"saturated [%]":>15}{"reserve [%]":>13}'
            '   commanded torque',
            *(f'{joint:<{wide}}{chatter:>14.2e}{100.0 * saturated:>15.2f}{100.0 * reserve:>13.0f}'
              for joint, chatter, saturated, reserve in rows)]
