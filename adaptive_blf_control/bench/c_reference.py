# SPDX-License-Identifier: Apache-2.0
"""The closed loop of the 2-DoF arm against a program in C that does the same work.

The program is called with a duration in seconds and prints its time per step in µs first. Both
run in turn on one thread, so that what disturbs the machine disturbs both; medians count.
"""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
import shutil
import statistics
import subprocess
import tempfile
from typing import NamedTuple

from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.errors import BlfError

__all__ = ['PerStep', 'against_c', 'compiler']

REPEATS = 7
DURATION = 20.0  # s of arm time


class PerStep(NamedTuple):
    """Medians of the time per step [µs]."""

    ours: float
    c: float

    @property
    def ratio(self) -> float:
        """Ours as a part of the program in C."""
        return self.ours / self.c


def compiler() -> str | None:
    """Return the C compiler of this machine, None where there is none."""
    return next(filter(None, map(shutil.which, filter(None, (
        os.environ.get('CC'), 'cc', 'gcc', 'clang')))), None)


def against_c(source: Path, scenario: Path, duration: float = DURATION,
              repeats: int = REPEATS) -> PerStep:
    """Run a scenario of the 2-DoF arm and the program in turn.

    Args:
        source: The program's source.
        scenario: Parameter file.
        duration: Arm time of each run [s].
        repeats: Runs of each.

    Raises:
        BlfError: there is no compiler, or the program cannot be built or run.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / 'reference'
        _run([compiler() or 'cc', '-O2', '-o', str(program), str(source), '-lm'])
        pairs = list(_in_turn(program, scenario, duration, repeats))
    return PerStep(*(statistics.median(times) for times in zip(*pairs)))


def _in_turn(program: Path, scenario: Path, duration: float,
             repeats: int) -> Iterator[tuple[float, float]]:
    data = load_yaml(scenario)
    build_closed_loop(data).warm_up()
    for _ in range(repeats):
        trace = build_closed_loop(data).run(duration)
        printed = _run([str(program), f'{duration:g}'])
        try:
            c = float(printed.split()[0])
        except (IndexError, ValueError):
            raise BlfError(f'{program.name} printed {printed[:40]!r}: expected its time per step '
                           'in µs first') from None
        yield 1e6 * trace.wall_s / trace.t.size, c


def _run(command: list[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except OSError as error:
        raise BlfError(f'{command[0]}: {error.strerror}') from error
    except subprocess.CalledProcessError as error:
        raise BlfError(f'{" ".join(command)}: {error.stderr.strip()}') from error
    return done.stdout
