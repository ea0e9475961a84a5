# SPDX-License-Identifier: Apache-2.0
"""``bench limits``: arms at their limits and beside obstacles, with and without the filter."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import json
from pathlib import Path

import numpy as np

from adaptive_blf_control.bench import limits_picture
from adaptive_blf_control.bench.limits_cases import Case, cases, DURATION
from adaptive_blf_control.bench.limits_runs import run_of, RunFigures
from adaptive_blf_control.configuration.parameter_file import load_yaml

__all__ = ['add_options', 'row', 'run', 'runs_of', 'TITLES']

TITLES = ('arm, plant', 'case', 'law', 'runs',
          'samples outside: position / velocity / e1 / obstacle',
          'worst margin [rad, rad/s, rad, m]', 'progress', 'from the path: mean, most [rad]',
          'let through / filtered / braking / softened',
          'processor time p50, p99 [µs]: let through; else; governor')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare ``--limits-*``."""
    parser.add_argument('--limits-seconds', type=float, metavar='S',
                        help='limits: length of a run [s] (default: 8, 10 of random scenes)')
    parser.add_argument('--limits-only', default='', metavar='TEXT',
                        help='limits: rows whose arm, plant or case contains it')
    parser.add_argument('--limits-seeds', type=int, default=5, metavar='N',
                        help='limits: runs of a row in which something is random '
                        '(default %(default)d)')
    parser.add_argument('--limits-png', type=Path, metavar='FILE',
                        help='limits: draw the picture of docs/limits.md instead of the table')
    parser.add_argument('--limits-scenes', type=int, default=200, metavar='N',
                        help='limits: random scenes of a row (default %(default)d)')
    parser.add_argument('--limits-runs', type=Path, metavar='FILE',
                        help='limits: keep each run as a line of JSON, and take those that are '
                        'there instead of running them again')


def run(options: argparse.Namespace) -> None:
    """Print the table, row by row, or draw the picture."""
    if options.limits_png is not None:
        least = limits_picture.draw(options.limits_png, load_yaml(
            options.config / 'panda_obstacles.yaml'), options.limits_seconds or DURATION)
        print(f'{options.limits_png}: closest {least[0]:.3f} m alone, {least[1]:.3f} m filtered')
        return
    print('| ' + ' | '.join(TITLES) + ' |\n' + '|---' * len(TITLES) + '|')
    seeds = tuple(range(options.limits_seeds))
    for case in cases(options.config, seeds, options.limits_scenes):
        if case.seeds and options.limits_only in _title(case):
            duration = options.limits_seconds or case.duration
            print(row(case, list(runs_of(case, options.config, duration, options.limits_runs))),
                  flush=True)


def _title(case: Case) -> str:
    return f'{case.arm}, {case.plant}, {case.name}, {case.law}'


def runs_of(case: Case, config: Path, duration: float,
            kept: Path | None = None) -> Iterator[RunFigures]:
    """Yield the runs of a case, one for each seed.

    Args:
        case: The case.
        config: Folder of the scenarios.
        duration: Of a run [s].
        kept: File with a run in each line; who wants them run again takes another one.
    """
    known = {}
    if kept is not None and kept.exists():
        for line in kept.read_text(encoding='utf-8').splitlines():
            title, seconds, seed, figures = json.loads(line)
            known[title, seconds, seed] = RunFigures(**figures)
    for seed in case.seeds:
        found = known.get((_title(case), duration, seed))
        if found is None:
            found = run_of(case, config, duration, seed)
            if kept is not None:
                with kept.open('a', encoding='utf-8') as file:
                    file.write(json.dumps([_title(case), duration, seed, found._asdict()]) + '\n')
        yield found


def row(case: Case, runs: Sequence[RunFigures]) -> str:
    """Return a row of the table: sums, least margins, medians of progress and times."""
    done = [each for each in runs if not each.refused]
    head = f'| {case.arm}, {case.plant} | {case.name} | {case.law} | {len(done)} | '
    if not done:
        return head + f'refused: {runs[0].refused} |' + ' |' * 5
    least = np.min([each.worst for each in done], axis=0)
    there = np.isfinite(least)
    outside = ' / '.join(str(count) if is_there else '–' for count, is_there in zip(
        np.sum([each.outside for each in done], axis=0), there))
    worst = ', '.join(f'{value:.3f}' for value in least[there])
    progress = np.array([each.progress for each in done])
    shown = f'{np.median(progress):.2f}' + (
        f' ({progress.min():.2f} to {progress.max():.2f})' if progress.size > 1 else '')
    refused = f' ({len(runs) - len(done)} refused)' if len(done) < len(runs) else ''
    off = [each.off for each in done if each.off]
    away = f'{np.mean(off, axis=0)[0]:.2f}, {np.max(off, axis=0)[1]:.2f}' if off else ''
    filtered = [each for each in done if each.counts]
    counts = ' / '.join(map(str, np.sum([each.counts for each in filtered], axis=0))
                        ) if filtered else ''
    spent = '; '.join(_times([each.times[k] for each in filtered if each.times[k]])
                      for k in range(3)) if filtered else ''
    return f'{head}{outside} | {worst} | {shown}{refused} | {away} | {counts} | {spent} |'


def _times(parts: list[list[float]]) -> str:
    return ', '.join(f'{value:.0f}' for value in np.median(parts, axis=0)) if parts else '–'
