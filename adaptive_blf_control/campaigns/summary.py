# SPDX-License-Identifier: Apache-2.0
"""What a campaign showed: how many runs kept their sets, how sure that is, and the worst runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.campaigns.campaign import Campaign
from adaptive_blf_control.campaigns.influence import influence_table

__all__ = ['FIGURES', 'Figure', 'summarise', 'table', 'varied_text', 'verdict', 'verdict_line',
           'wilson_interval', 'worst_runs']

QUANTILES = (0.0, 0.05, 0.5, 0.95, 1.0)
WORST = 10
MOST_SHOWN = 12
Row = Mapping[str, Any]


class Figure(NamedTuple):
    """What is shown of the outcomes as a distribution.

    Attributes:
        column: Of the results.
        name: For people.
        unit: Of what is shown.
        factor: From the column to what is shown.
    """

    column: str
    name: str
    unit: str
    factor: float = 1.0

    @property
    def label(self) -> str:
        """Name and unit."""
        return f'{self.name} [{self.unit}]'


FIGURES = (
    Figure('least_margin', 'least margin', 'rad'),
    Figure('largest_error', 'largest |e1|', 'rad'),
    Figure('rms_error_end', 'RMS e1, last quarter', 'rad'),
    Figure('convergence_time_s', 'convergence time', 's'),
    Figure('parameter_error', 'parameter error', '%', 100.0),
    Figure('torque_error', 'predicted torque error', '%', 100.0))


def shown_per_unit(unit: str) -> float:
    """Return what a column is multiplied by where it is shown: parts are shown in %."""
    return 100.0 if unit == '%' else 1.0


def wilson_interval(kept: int, runs: int, z: float = 1.959963984540054) -> tuple[float, float]:
    """Return the interval that holds a share with 95 % confidence.

    Wilson, Journal of the American Statistical Association 22(158), 1927: it keeps its confidence
    where all runs or none were kept.

    Args:
        kept: Runs that were kept.
        runs: All runs, > 0.
        z: Quantile of the standard normal distribution for the confidence.
    """
    share, square = kept / runs, z * z / runs
    centre = (share + square / 2.0) / (1.0 + square)
    half = z * math.sqrt(share * (1.0 - share) / runs + square / runs / 4.0) / (1.0 + square)
    return max(centre - half, 0.0), min(centre + half, 1.0)


def worst_runs(rows: Sequence[Row], count: int = WORST) -> list[Row]:
    """Return the worst runs: without a result, then first violated, then with least margin."""
    def order(row: Row) -> tuple[Any, ...]:
        margin = row['least_margin']
        return (not row['problem'], row['kept'],
                row['first_violation_s'] if not row['kept'] and not row['problem'] else 0.0,
                math.inf if math.isnan(margin) else margin)
    return sorted(rows, key=order)[:count]


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the figures of a campaign, as plain values for JSON.

    Args:
        rows: Outcomes, at least one.
    """
    kept = sum(bool(row['kept']) for row in rows)
    low, high = wilson_interval(kept, len(rows))
    figures: dict[str, Any] = {
        'runs': len(rows), 'kept': kept, 'refused': sum(bool(row['problem']) for row in rows),
        'kept_share': kept / len(rows), 'kept_share_interval': [low, high]}
    for figure in FIGURES:
        values = np.array([row[figure.column] for row in rows], dtype=float)
        finite = values[np.isfinite(values)]
        figures[figure.column] = {
            'known': int(finite.size),
            'quantiles': dict(zip(map(str, QUANTILES), np.quantile(finite, QUANTILES).tolist()))
            if finite.size else None}
    return figures


def table(rows: Sequence[Row], campaign: Campaign) -> str:
    """Return what a person reads at the end of a campaign."""
    figures = summarise(rows)
    lines = [
        verdict_line(figures, campaign), '',
        f'{"":<27}{"least":>11}{"5 %":>11}{"median":>11}{"95 %":>11}{"largest":>11}']
    for figure in FIGURES:
        known, quantiles = (figures[figure.column][key] for key in ('known', 'quantiles'))
        if quantiles is None:
            lines.append(f'{figure.label:<27}  not known of any run')
            continue
        lines.append(f'{figure.label:<27}' + ''.join(
            f'{figure.factor * value:>11.3g}'
            for value in quantiles.values())
            + (f'   ({known} runs)' if known < len(rows) else ''))
    lines += ['', influence_table(rows, campaign), '',
              'Worst runs, each with the command that repeats it:']
    for row in worst_runs(rows):
        lines += [f'  run {row["run"]}: {verdict(row)}',
                  f'    {varied_text(row["run"], campaign)}',
                  f'    {campaign.command(row["run"])}']
    return '\n'.join(lines)


def verdict_line(figures: Mapping[str, Any], campaign: Campaign) -> str:
    """Return in how many runs the sets were kept, from what `summarise` returned."""
    low, high = figures['kept_share_interval']
    return (f'{figures["kept"]} of {figures["runs"]} runs of {campaign.duration:g} s kept their '
            f'sets: {100.0 * figures["kept_share"]:.1f} % '
            f'(95 %: {100.0 * low:.1f} to {100.0 * high:.1f} %)'
            + (f'; {figures["refused"]} were refused' if figures['refused'] else ''))


def varied_text(run: int, campaign: Campaign) -> str:
    """Return what varied in a run, with a few digits."""
    parts = []
    for name, values in list(campaign.drawn.shown.items())[:MOST_SHOWN]:
        value = values[run]
        parts.append(f'{name.partition(".")[2]} '
                     + (f'{value:.3g}' if isinstance(value, float) else str(value)))
    return ', '.join(parts)


def verdict(row: Row) -> str:
    """Return how a run ended, in words."""
    if row['problem']:
        return f'refused: {row["problem"]}'
    if row['kept']:
        return f'kept, least margin {row["least_margin"]:.3g} rad'
    return f'left at {row["first_violation_s"]:.3f} s, {row["violations"]} samples outside'
