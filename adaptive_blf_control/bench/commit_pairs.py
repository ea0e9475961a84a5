# SPDX-License-Identifier: Apache-2.0
"""Figures of the present sources in turn with those of commit d8177d4.

That commit is checked out beside the present sources for as long as the runs take, so this needs
the repository with its history. It compiles its laws once, before the first pair.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import json
import os
from pathlib import Path
import statistics
import subprocess
import sys
import tempfile
from typing import NamedTuple

import adaptive_blf_control
from adaptive_blf_control.errors import BlfError

__all__ = ['COMMIT', 'Pairs', 'print_pairs']

COMMIT = 'd8177d4'
PAIRS = 5


class Pairs(NamedTuple):
    """What is measured in both.

    Attributes:
        part: Name of the part of ``bench``.
        what: Heading of what a program tells apart.
        figure: Heading of the figures.
        then: Program for the commit: gets a scenario's file and a duration [s], and prints one
            figure for each of what it tells apart as JSON in its last line.
        now: The same for the present sources.
        scenarios: What each is called now and was called then, and its duration [s].
    """

    part: str
    what: str
    figure: str
    then: str
    now: str
    scenarios: tuple[tuple[str, str, float], ...]


def print_pairs(pairs: Pairs, config: Path) -> None:
    """Print a table of both; BlfError where the commit is not there.

    Args:
        pairs: What is measured.
        config: Folder of the present scenarios.
    """
    print(f'| scenario | {pairs.what} | {COMMIT}, {pairs.figure} | now, {pairs.figure} | ratio, '
          f'median of {PAIRS} pairs |\n|---|---|---|---|---|')
    here = Path(adaptive_blf_control.__file__).parents[1]
    with _checkout(pairs.part, here) as there:
        for name, former, duration in pairs.scenarios:
            scenarios = (config / f'{name}.yaml').resolve(), there / 'config' / f'{former}.yaml'
            _figures(pairs.part, there, pairs.then, scenarios[1], 0.1)
            found = [(_figures(pairs.part, there, pairs.then, scenarios[1], duration),
                      _figures(pairs.part, here, pairs.now, scenarios[0], duration))
                     for _ in range(PAIRS)]
            for each in found[0][0]:
                before, now = ([pair[k][each] for pair in found] for k in range(2))
                ratios = [b / a for a, b in zip(before, now)]
                print(f'| {name} | {each} | {_shown(before)} | {_shown(now)} | '
                      f'{statistics.median(ratios):.2f} ({min(ratios):.2f} to '
                      f'{max(ratios):.2f}) |', flush=True)


def _shown(values: list[float]) -> str:
    return f'{statistics.median(values):.1f} ({min(values):.1f} to {max(values):.1f})'


@contextmanager
def _checkout(part: str, repository: Path) -> Iterator[Path]:
    """Check the commit out into a folder that is removed at the end."""
    git = ['git', '-C', str(repository), 'worktree']
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / COMMIT
        try:
            done = subprocess.run([*git, 'add', '--detach', str(place), COMMIT],
                                  capture_output=True, text=True, check=False)
        except FileNotFoundError:
            raise BlfError(f'bench {part}: git is not installed: it is needed to check out '
                           f'{COMMIT}') from None
        if done.returncode:
            raise BlfError(f'bench {part}: {COMMIT} cannot be checked out from {repository}: '
                           f'{done.stderr.strip()}')
        try:
            yield place
        finally:
            subprocess.run([*git, 'remove', '--force', str(place)], check=False)


def _figures(part: str, checkout: Path, program: str, scenario: Path,
             duration: float) -> dict[str, float]:
    """Run a program in a checkout; it finds the package there."""
    environment = {**os.environ, 'PYTHONPATH': str(checkout), 'OPENBLAS_NUM_THREADS': '1'}
    done = subprocess.run([sys.executable, '-c', program, str(scenario), str(duration)],
                          cwd=checkout, env=environment, capture_output=True, text=True,
                          check=False)
    if done.returncode:
        raise BlfError(f'bench {part}, in {checkout}: {done.stderr.strip()}')
    return dict(json.loads(done.stdout.splitlines()[-1]))
