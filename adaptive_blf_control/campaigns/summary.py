# SPDX-License-Identifier: Apache-2.0
"""What a campaign showed: how many runs kept their sets, how sure that is, and the worst runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from typing import Any

import numpy as np

from adaptive_blf_control.campaigns.campaign import Campaign

__all__ = ['FIGURES', 'Figure', 'shown_per_unit', 'summarise', 'table', 'wilson_interval',
           'worst_runs']

QUANTILES = (0.0, 0.05, 0.5, 0.95, 1.0)
WORST = 10
Row = Mapping[str, Any]
Figure = tuple[str, str, str]

FIGURES: tuple[Figure, ...] = (
    ('least_margin', 'least margin', 'rad'),
    ('largest_error', 'largest |e1|', 'rad'),
    ('rms_error_end', 'RMS e1, last quarter', 'rad'),
    ('convergence_time_s', 'convergence time', 's'),
    ('parameter_error', 'parameter error', '%'),
    ('torque_error', 'predicted torque error', '%'))
"""Column, name and unit of what is shown as a distribution."""


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
    for column, _, _ in FIGURES:
        values = np.array([row[column] for row in rows], dtype=float)
        finite = values[np.isfinite(values)]
        figures[column] = {
            'known': int(finite.size),
            'quantiles': dict(zip(map(str, QUANTILES), np.quantile(finite, QUANTILES).tolist()))
            if finite.size else None}
    return figures


def table(rows: Sequence[Row], campaign: Campaign) -> str:
    """Return what a person reads at the end of a campaign."""
    figures = summarise(rows)
    low, high = figures['kept_share_interval']
    lines = [
        f'{figures["kept"]} of {figures["runs"]} runs of {campaign.duration:g} s kept their sets: '
        f'{100.0 * figures["kept_share"]:.1f} % (95 %: {100.0 * low:.1f} to {100.0 * high:.1f} %)'
        + (f'; {figures["refused"]} were refused' if figures['refused'] else ''), '',
        f'{"":<24}{"least":>11}{"5 %":>11}{"median":>11}{"95 %":>11}{"largest":>11}']
    for column, name, unit in FIGURES:
        spread = figures[column]
        label = f'{name} [{unit}]' if unit else name
        if spread['quantiles'] is None:
            lines.append(f'{label:<24}  not known of any run')
            continue
        known = spread['known']
        scale = shown_per_unit(unit)
        lines.append(f'{label:<28}'.rstrip().ljust(24) + ''.join(
            f'{scale * value:>11.3g}' for value in spread['quantiles'].values())
            + (f'   ({known} runs)' if known < len(rows) else ''))
    lines += ['', 'Worst runs, each with the command that repeats it:']
    for row in worst_runs(rows):
        lines.append(f'  run {row["run"]}: {_verdict(row)}\n    {campaign.command(row["run"])}')
    return '\n'.join(lines)


def _verdict(row: Row) -> str:
    if row['problem']:
        return f'refused: {row["problem"]}'
    if row['kept']:
        return f'kept, least margin {row["least_margin"]:.3g} rad'
    return f'left at {row["first_violation_s"]:.3f} s, {row["violations"]} samples outside'
