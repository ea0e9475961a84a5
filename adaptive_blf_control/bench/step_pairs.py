# SPDX-License-Identifier: Apache-2.0
"""``bench step_pairs``: the steps of the nodes in turn with those of commit d8177d4.

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

import adaptive_blf_control
from adaptive_blf_control.bench import node_steps, steps_at_d8177d4
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.errors import BlfError

__all__ = ['print_pairs']

COMMIT = 'd8177d4'
# What a scenario is called now and was called then; s of arm time, of which the smooth start is a
# small part.
SCENARIOS = (('two_link', 'two_link', 5.0), ('panda_ideal', 'panda', 8.0))
PAIRS = 5
_NOW = ('import sys; from adaptive_blf_control.bench.step_pairs import print_medians; '
        'print_medians(sys.argv[1], float(sys.argv[2]))')


def print_pairs(config: Path) -> None:
    """Print a table of both; BlfError where the commit is not there.

    Args:
        config: Folder of the present scenarios.
    """
    print('| scenario | node | d8177d4, p50 [µs] | now, p50 [µs] | ratio, median of '
          f'{PAIRS} pairs |\n|---|---|---|---|---|')
    here = Path(adaptive_blf_control.__file__).parents[1]
    then = Path(steps_at_d8177d4.__file__).read_text(encoding='utf-8')
    with _checkout(here) as there:
        for name, former, duration in SCENARIOS:
            scenarios = (config / f'{name}.yaml').resolve(), there / 'config' / f'{former}.yaml'
            _medians(there, then, scenarios[1], 0.1)
            pairs = [(_medians(there, then, scenarios[1], duration),
                      _medians(here, _NOW, scenarios[0], duration)) for _ in range(PAIRS)]
            for node in pairs[0][0]:
                before, now = ([each[k][node] for each in pairs] for k in range(2))
                ratios = [b / a for a, b in zip(before, now)]
                print(f'| {name} | {node} | {_shown(before)} | {_shown(now)} | '
                      f'{statistics.median(ratios):.2f} ({min(ratios):.2f} to '
                      f'{max(ratios):.2f}) |', flush=True)


def print_medians(scenario: str, duration: float) -> None:
    """Print the medians of the present steps as JSON, by node [µs]."""
    times = node_steps.times_of(load_yaml(Path(scenario)), duration)
    print(json.dumps({node: statistics.median(each) for node, each in times.items()}))


def _shown(values: list[float]) -> str:
    return f'{statistics.median(values):.1f} ({min(values):.1f} to {max(values):.1f})'


@contextmanager
def _checkout(repository: Path) -> Iterator[Path]:
    """Check the commit out into a folder that is removed at the end."""
    git = ['git', '-C', str(repository), 'worktree']
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / COMMIT
        try:
            done = subprocess.run([*git, 'add', '--detach', str(place), COMMIT],
                                  capture_output=True, text=True, check=False)
        except FileNotFoundError:
            raise BlfError('bench step_pairs: git is not installed: it is needed to check out '
                           f'{COMMIT}') from None
        if done.returncode:
            raise BlfError(f'bench step_pairs: {COMMIT} cannot be checked out from {repository}: '
                           f'{done.stderr.strip()}')
        try:
            yield place
        finally:
            subprocess.run([*git, 'remove', '--force', str(place)], check=False)


def _medians(checkout: Path, program: str, scenario: Path, duration: float) -> dict[str, float]:
    """Run a program in a checkout; it finds the package there."""
    environment = {**os.environ, 'PYTHONPATH': str(checkout), 'OPENBLAS_NUM_THREADS': '1'}
    done = subprocess.run([sys.executable, '-c', program, str(scenario), str(duration)],
                          cwd=checkout, env=environment, capture_output=True, text=True,
                          check=False)
    if done.returncode:
        raise BlfError(f'bench step_pairs, in {checkout}: {done.stderr.strip()}')
    return dict(json.loads(done.stdout.splitlines()[-1]))
