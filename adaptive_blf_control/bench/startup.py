# SPDX-License-Identifier: Apache-2.0
"""``bench startup``: processor time until `simulate` is done and until each node has begun.

And how long the four nodes take together until the arm moves, on the clock; with ``--cold`` also
what they use of the processors where nothing is compiled yet.

A node has begun when the controller says that the motion begins: then driver and identifier have
sent what it waits for, and the recorder has been found by the driver.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import os
from pathlib import Path
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

from adaptive_blf_control.configuration.node_settings import RuntimeSettings
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.processes import NodeProcesses, NODES

__all__ = ['ALL', 'add_options', 'begun', 'nothing_compiled', 'run', 'simulated', 'table']

SIMULATE = 'simulate --duration 0.001'
ALL = 'four nodes until the motion, on the clock'
LOOKING = f'{ALL}, looking for others'
COLD = 'four nodes together, nothing compiled'
DURATION = 0.5  # s of motion: what was used until its begin is looked at meanwhile


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this part."""
    parser.add_argument('--starts', type=int, default=3, metavar='N',
                        help='how often each is started after a first time (default: 3)')
    parser.add_argument('--cold', action='store_true',
                        help='start the four nodes once where nothing is compiled, too')


def run(options: argparse.Namespace) -> None:
    """Print medians; the first start of each, which may compile, does not count."""
    config = (options.config / 'two_link.yaml').resolve()
    times: dict[str, list[float]] = {}
    if options.cold:
        with nothing_compiled():
            used = begun(config)
        print(table({COLD: [sum(used[name] for name in NODES)]}) + '\n', flush=True)
    for _ in range(options.starts + 1):
        found = {SIMULATE: simulated(config), **begun(config),
                 LOOKING: begun(config, looking=True)[ALL]}
        for name, seconds in found.items():
            times.setdefault(name, []).append(seconds)
    print(table({name: seconds[1:] for name, seconds in times.items()}), flush=True)


def simulated(config: Path) -> float:
    """Return the processor time of a whole `simulate` of one period [s].

    Raises:
        BlfError: it fails.
    """
    before = _of_children()
    done = subprocess.run([sys.executable, '-m', 'adaptive_blf_control', 'simulate', str(config),
                           *SIMULATE.split()[1:]], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BlfError(f'simulate {config}: {done.stderr.strip()}')
    return _of_children() - before


def begun(config: Path, *, looking: bool = False) -> dict[str, float]:
    """Start the four nodes and return the processor time of each when the motion begins [s].

    With the time on the clock until then, from the start of the first, under `ALL`. In a DDS
    domain of their own they do not look for others of their kind, unless they are to be
    ``looking`` for as long as they do by default.

    Raises:
        BlfError: a node fails before.
    """
    found: dict[str, float] = {}
    look_for = [f'discovery_time:={RuntimeSettings().discovery_time}']
    settings = dict.fromkeys(NODES, look_for) if looking else None
    with tempfile.TemporaryDirectory() as folder, \
            NodeProcesses(config, DURATION, Path(folder), settings) as nodes:

        def look(moving: float | None) -> None:
            if moving is not None and not found:
                found.update((name, _of_process(nodes.processes[name].pid)) for name in NODES)
                found[ALL] = time.monotonic() - moving - nodes.started

        bad = nodes.until_done(look, 0.02)
        if bad or not found:
            raise BlfError(f'{", ".join(bad) or "arm_driver"} failed: '
                           + nodes.text((bad or ['arm_driver'])[0])[-400:])
    return found


@contextmanager
def nothing_compiled() -> Iterator[None]:
    """Return a context whose processes run a copy of the package that has no machine code.

    It is in their working folder, where ``python -m`` looks first.
    """
    before, package = Path.cwd(), Path(__file__).resolve().parents[1]
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(package, Path(folder) / package.name,
                        ignore=shutil.ignore_patterns('__pycache__'))
        os.chdir(folder)
        try:
            yield
        finally:
            os.chdir(before)


def _of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _of_process(pid: int) -> float:
    fields = Path(f'/proc/{pid}/stat').read_text(encoding='ascii').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def table(times: Mapping[str, list[float]]) -> str:
    """Return the medians as Markdown."""
    lines = ['| what | time, median [s] | least | most |', '|---|---|---|---|']
    for name, seconds in times.items():
        lines.append(f'| {name} | {statistics.median(seconds):.2f} | {min(seconds):.2f} | '
                     f'{max(seconds):.2f} |')
    return '\n'.join(lines)
