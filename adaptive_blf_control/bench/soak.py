# SPDX-License-Identifier: Apache-2.0
"""``soak``: run the four processes for an hour; check memory, latency and every message.

Each minute it prints a line and writes the figures so far to ``soak.json`` in the run's folder.

Exit status: 0 every check holds, 1 a check fails, 2 it could not be run.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from importlib import util
import json
import os
from pathlib import Path
import shutil
import sys
import time
from typing import Any, NamedTuple

from adaptive_blf_control.bench.rate_figures import usage_of
from adaptive_blf_control.bench.soak_bag import read_run, RunFigures
from adaptive_blf_control.bench.soak_figures import (
    Account,
    account_of,
    Growth,
    growth_of,
    Latency,
    latency_of,
)
from adaptive_blf_control.configuration.shipped import scenario
from adaptive_blf_control.errors import BlfError, MissingExtra
from adaptive_blf_control.runtime.processes import COMPOSED, NodeProcesses, NODES, nodes_in

__all__ = ['main']

PERIOD = 1.0  # s between two samples of the memory
MINUTE = 60.0  # s between two lines
START_UP = 60.0  # s that are left out, at most half of the run
BYTES_PER_SECOND = 1_500_000  # a two-joint run at 1 kHz with everything recorded
MEMORY_LIMIT = 1.0  # percent
FIGURES = 'soak.json'
TRIP = 'round trip p50, p99, p99.9, largest so far [ms]'


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='soak', description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('--minutes', type=float, default=60.0, metavar='M')
    parser.add_argument('--config', type=Path, default=None,
                        help='parameter file (default: the 2-DoF task at 1 kHz)')
    parser.add_argument('--output', type=Path, default=None, metavar='DIR',
                        help='new folder for the run (default: runs/soak_TIME)')
    parser.add_argument('--composed', action='store_true',
                        help='controller and identifier in one process, arm_control')
    parser.add_argument('--keep', action='store_true',
                        help='keep the bag (4 GB an hour with two_link); without this it is '
                             'deleted\nat the end if every check holds')
    return parser


class _Watch:
    """Memory and processor time of each process over the time in which the arm moves."""

    def __init__(self, nodes: NodeProcesses, output: Path) -> None:
        self._nodes, self._output = nodes, output
        self._minutes: list[dict[str, Any]] = []
        self.names = tuple(nodes.processes)
        self.t: dict[str, list[float]] = {name: [] for name in self.names}
        self.memory: dict[str, list[float]] = {name: [] for name in self.names}  # MB
        self.used: dict[str, list[float]] = {name: [] for name in self.names}

    def look(self, moving: float | None) -> None:
        """Take a sample; every minute print and store the figures so far."""
        if moving is None:
            return
        for name, process in self._nodes.processes.items():
            usage = usage_of(process.pid)
            if usage is not None:
                self.t[name].append(moving)
                self.used[name].append(usage[0])
                self.memory[name].append(usage[1])
        if moving >= MINUTE * (len(self._minutes) + 1):
            self._report(moving)

    def share(self, name: str) -> float:
        """Return the part of one core that a node used while the arm moved; NaN if unknown."""
        t, used = self.t[name], self.used[name]
        return (used[-1] - used[0]) / (t[-1] - t[0]) if len(t) > 1 else float('nan')

    def _report(self, moving: float) -> None:
        memory = {name: round(self.memory[name][-1], 2) for name in self.names
                  if self.memory[name]}
        self._minutes.append({'t_s': round(moving, 1), 'memory_mb': memory,
                              'cores': {name: round(self.share(name), 3) for name in self.names}})
        print(f'{moving / 60.0:.0f} min: ' + ', '.join(
            f'{name} {size:.1f} MB' for name, size in memory.items()) + '; together '
            f'{sum(self.share(name) for name in self.names):.2f} cores', flush=True)
        self.write({})

    def write(self, figures: Mapping[str, Any]) -> None:
        """Replace ``soak.json`` atomically."""
        file = self._output / FIGURES
        text = json.dumps({**figures, 'minutes': self._minutes}, indent=1)
        file.with_suffix('.part').write_text(text + '\n', encoding='utf-8')
        file.with_suffix('.part').replace(file)


class _Figures(NamedTuple):
    """Everything that is checked."""

    growths: dict[str, Growth]
    cores: dict[str, float]
    missed: dict[str, int]
    trip: str
    latency: Latency
    account: list[Account]
    start_up: float

    def table(self) -> str:
        """Return the figures as Markdown."""
        lines = [f'\n| process | memory after {self.start_up:g} s [MB] | at the end [MB] | growth '
                 '| processor [cores] | missed periods |', '|---|---|---|---|---|---|']
        lines += [f'| {name} | {growth.first:.1f} | {growth.last:.1f} | '
                  f'{growth.percent:+.2f} % | {self.cores[name]:.2f} | '
                  f'{self._missed(name)} |' for name, growth in self.growths.items()]
        lines += ['', '| state to answer, as sent [ms] | p50 | p99 | largest | answered |',
                  '|---|---|---|---|---|']
        lines += [f'| {name} | {part.p50:.3f} | {part.p99:.3f} | {part.largest:.3f} | '
                  f'{part.answers} |' for name, part in (('first third', self.latency.first),
                                                         ('last third', self.latency.last))]
        lines += [f'\nthe driver: {TRIP}: {self.trip}\n',
                  '| topic | received | written | in the bag | dropped | lost on the way |',
                  '|---|---|---|---|---|---|']
        lines += [f'| {row.topic} | {row.received} | {row.written} | {row.in_bag} | '
                  f'{row.dropped} | {row.lost} |' for row in self.account]
        return '\n'.join(lines)

    def _missed(self, process: str) -> str:
        return ', '.join(str(self.missed.get(name, '-')) for name in nodes_in(process))

    def wrong(self) -> list[str]:
        """Return the checks that fail, one line each."""
        first, last = self.latency
        wrong = [f'{name} grew by {growth.percent:.2f} %: expected under {MEMORY_LIMIT:g} %'
                 for name, growth in self.growths.items() if growth.percent >= MEMORY_LIMIT]
        if self.latency.drifts:
            wrong.append(f'latency drifts: median {first.p50:.3f} ms in the first third, '
                         f'{last.p50:.3f} ms in the last')
        wrong += [f'{row.topic}: received {row.received}, written {row.written}, dropped '
                  f'{row.dropped}, in the bag {row.in_bag}' for row in self.account
                  if not row.complete]
        return wrong

    def plain(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            'start_up_s': self.start_up,
            'memory_mb': {name: {**growth._asdict(), 'percent': growth.percent}
                             for name, growth in self.growths.items()},
            'cores': self.cores, 'missed_periods': self.missed,
            'driver_' + TRIP: self.trip,
            'latency_ms': {name: part._asdict() for name, part in self.latency._asdict().items()},
            'topics': {row.topic: {**row._asdict(), 'complete': row.complete}
                       for row in self.account}}


def _figures(watch: _Watch, run: RunFigures, log: str, start_up: float) -> _Figures:
    reported = {name: run.diagnostics.get(name, {}) for name in NODES}
    missed = {name: int(reported[name]['missed periods']) for name in NODES
              if name != 'recorder' and 'missed periods' in reported[name]}
    return _Figures(
        {name: growth_of(watch.t[name], watch.memory[name], start_up) for name in watch.names},
        {name: watch.share(name) for name in watch.names}, missed,
        reported['arm_driver'].get(TRIP, 'not reported'),
        latency_of(run.sent, run.latency, start_up), account_of(log, run.counts), start_up)


def _check_space(output: Path, duration: float) -> None:
    """Refuse a run that the disk cannot hold, before anything is created."""
    folder = next(path for path in (output, *output.resolve().parents) if path.exists())
    free, needed = shutil.disk_usage(folder).free, duration * BYTES_PER_SECOND
    if free < needed:
        raise BlfError(f'{output}: {free / 1e9:.1f} GB are free: expected {needed / 1e9:.1f} GB '
                       f'for {duration / 60.0:g} min')


def _run(options: argparse.Namespace) -> int:
    duration = 60.0 * options.minutes
    if not 0.0 < duration < 1e7:
        raise BlfError(f'--minutes is {options.minutes:g}: expected more than 0')
    if util.find_spec('rclpy') is None:
        raise MissingExtra('rclpy', 'ros', 'the four nodes')
    output: Path = options.output or Path('runs') / time.strftime('soak_%Y%m%d_%H%M%S')
    _check_space(output, duration)
    output.mkdir(parents=True)
    config = options.config or scenario('two_link.yaml')
    count = len(COMPOSED if options.composed else NODES)
    print(f'{count} processes, {config}, {options.minutes:g} min, {os.cpu_count()} cores, load '
          f'{os.getloadavg()[0]:.1f}', flush=True)
    watch, log, bad = _drive(config, duration, output, options.composed)
    if not (output / 'bag').exists():
        raise BlfError(f'nothing was recorded: {", ".join(bad)} did not end well')
    wrong = [f'{name} did not end well' for name in bad]
    wrong += _judge(output, watch, log, min(START_UP, 0.5 * duration))
    print('\n' + ('\n'.join(f'FAILED {text}' for text in wrong) or 'every check holds'))
    if not (options.keep or wrong):
        shutil.rmtree(output / 'bag')
    else:
        print(f'the bag is kept: {output / "bag"}')
    return 1 if wrong else 0


def _drive(config: Path, duration: float, output: Path,
           composed: bool) -> tuple[_Watch, str, list[str]]:
    """Run the nodes; return the samples, the recorder's output and which nodes failed."""
    with NodeProcesses(config.resolve(), duration, output.resolve(),
                       composed=composed) as nodes:
        print(f'on this host only; to look inside: ROS_DOMAIN_ID={nodes.domain}', flush=True)
        watch = _Watch(nodes, output)
        bad = nodes.until_done(watch.look, min(PERIOD, duration / 60.0))
        bad = list(dict.fromkeys(bad + nodes.end()))
        for name in bad:
            print(f'{name} did not end well:\n{nodes.text(name)}', file=sys.stderr)
        return watch, nodes.text('recorder'), bad


def _judge(output: Path, watch: _Watch, log: str, start_up: float) -> list[str]:
    """Print the table, write the figures and return the checks that fail."""
    begin = time.monotonic()
    run = read_run(output / 'bag')
    size = sum(file.stat().st_size for file in (output / 'bag').iterdir())
    figures = _figures(watch, run, log, start_up)
    print(figures.table())
    print(f'\n{size / 1e6:.0f} MB, {sum(run.counts.values())} messages, read in '
          f'{time.monotonic() - begin:.1f} s')
    wrong = figures.wrong()
    watch.write({**figures.plain(), 'bag_bytes': size, 'failed': wrong})
    return wrong


def main(args: Sequence[str] | None = None) -> int:
    """Run the command; see the module for the exit status."""
    options = _parser().parse_args(args)
    try:
        return _run(options)
    except (BlfError, OSError) as error:
        print(f'soak: {error}', file=sys.stderr)
        return 2


if __name__ == '__main__':
    sys.exit(main())
