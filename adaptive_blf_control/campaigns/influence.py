# SPDX-License-Identifier: Apache-2.0
"""Which of the parameters that varied decided over the outcomes of a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.campaigns.campaign import Campaign

__all__ = ['Quarter', 'influence_table', 'numbers_by_name', 'quarters']

MOST = 12  # varied parameters in the table; the elements of a long array are many
Row = Mapping[str, Any]


class Quarter(NamedTuple):
    """The quarter of the runs in which a parameter was lowest, second lowest, and so on.

    Attributes:
        low: Smallest value of the parameter.
        high: Largest.
        runs: How many they are.
        kept: Part of them that kept their sets.
        least_margin: Smallest margin of all of them [rad].
        usual_margin: Median of their margins [rad].
        torque_error: Median of the predicted torque error, 0.01 is 1 %.
    """

    low: float
    high: float
    runs: int
    kept: float
    least_margin: float
    usual_margin: float
    torque_error: float


def numbers_by_name(campaign: Campaign) -> dict[str, np.ndarray]:
    """Return what varied as numbers, over all runs, shape (runs,)."""
    return {name: np.array(column, dtype=float)
            for name, column in campaign.drawn.shown.items()
            if all(isinstance(value, (int, float)) for value in column)}


def quarters(values: np.ndarray, rows: Sequence[Row], count: int = 4) -> list[Quarter]:
    """Return outcomes over the quarters of a parameter; equal values are never parted.

    Args:
        values: The parameter in each run, shape (N,).
        rows: The outcomes of these runs.
        count: Into how many parts they are parted, fewer where few values differ.
    """
    edges = np.unique(np.quantile(values, np.arange(1, count) / count, method='lower'))
    number = np.searchsorted(edges, values)
    columns = {name: np.array([row[name] for row in rows], dtype=float)
               for name in ('kept', 'least_margin', 'torque_error')}
    found = []
    for part in np.unique(number):
        inside = number == part
        kept, margin, torque = (column[inside] for column in columns.values())
        found.append(Quarter(
            float(values[inside].min()), float(values[inside].max()), int(inside.sum()),
            float(kept.mean()), _of(margin, 0.0), _of(margin, 0.5), _of(torque, 0.5)))
    return found


def _of(values: np.ndarray, quantile: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, quantile)) if known.size else np.nan


def influence_table(rows: Sequence[Row], campaign: Campaign) -> str:
    """Return as text what each quarter of each parameter came to, seeds left out."""
    lines = [f'{"over quarters of what varied":<50}{"runs":>6}{"kept":>9}{"least":>10}'
             f'{"median":>10}{"torque":>10}',
             f'{"":<50}{"":>6}{"":>9}{"margin":>10}{"margin":>10}{"error":>10}']
    for name, column in list(numbers_by_name(campaign).items())[:MOST]:
        values = column[[row['run'] for row in rows]]
        if name.endswith('seed') or values.min() == values.max():
            continue
        lines.append(name)
        lines += [f'{f"  {each.low:.3g} to {each.high:.3g}":<50}{each.runs:>6}'
                  f'{100.0 * each.kept:>7.1f} %{each.least_margin:>10.3g}'
                  f'{each.usual_margin:>10.3g}{100.0 * each.torque_error:>8.2g} %'
                  for each in quarters(values, rows)]
    return '\n'.join(lines)
