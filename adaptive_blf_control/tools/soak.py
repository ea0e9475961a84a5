# SPDX-License-Identifier: Apache-2.0
"""``soak``: the four processes for an hour; does memory grow, latency drift, a message vanish?

Exit status: 0 every check holds, 1 one does not, 2 it could not be run.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from importlib import util
import os
from pathlib import Path
import shutil
import sys
import time

from adaptive_blf_control.errors import BlfError, MissingExtra
from adaptive_blf_control.tools.processes import NodeProcesses, NODES, scenario
from adaptive_blf_control.tools.soak_figures import (
    Account,
    account_of,
    Growth,
    growth_of,
    Latency,
    latency_of,
    read_run,
)

__all__ = ['main']

PERIOD = 1.0  # s between looks at the memory
PATIENCE = 90.0  # s until the arm has to move: the first run compiles the laws
SETTLE = 60.0  # s that are not judged, at most half of the run
BYTES_PER_SECOND = 1_500_000  # a two-joint run at 1 kHz with everything recorded
MEMORY_LIMIT = 1.0  # percent


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='soak', description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('--minutes', type=float, default=60.0, metavar='M')
    parser.add_argument('--config', type=Path, default=None,
                        help='parameter file (default: the 2-DoF task at 1 kHz)')
    parser.add_argument('--output', type=Path, default=None, metavar='DIR',
                        help='new folder for the run (default: runs/soak_TIME)')
    parser.add_argument('--keep', action='store_true',
                        help='keep the bag: two_link writes about 4 GB an hour')
    return parser


def _resident(pid: int) -> int | None:
    """Return the resident memory of a process [bytes], None where it has ended."""
    try:
        pages = Path(f'/proc/{pid}/statm').read_text(encoding='ascii').split()[1]
    except (OSError, IndexError):
        return None
    return int(pages) * os.sysconf('SC_PAGE_SIZE')


class _Samples:
    """Resident memory of each process over the time in which the arm moves."""

    def __init__(self) -> None:
        self.t: dict[str, list[float]] = {name: [] for name in NODES}
        self.rss: dict[str, list[int]] = {name: [] for name in NODES}

    def take(self, nodes: NodeProcesses, t: float) -> None:
        for name, process in nodes.processes.items():
            size = _resident(process.pid)
            if size:  # a process that has just ended has none
                self.t[name].append(t)
                self.rss[name].append(size)


def _drive(nodes: NodeProcesses, duration: float) -> tuple[_Samples, list[str]]:
    """Sample until the driver has ended; return the samples and the nodes that failed."""
    samples = _Samples()
    driver = nodes.processes['arm_driver']
    begin = time.monotonic()
    moving: float | None = None
    while driver.poll() is None:
        now = time.monotonic()
        bad = nodes.failed()
        if bad or now - begin > PATIENCE + 1.1 * duration:
            return samples, bad or ['arm_driver']
        if moving is None and 'motion begins' in nodes.text('controller'):
            moving = now
        if moving is not None:
            samples.take(nodes, now - moving)
        time.sleep(min(PERIOD, duration / 60.0))
    return samples, nodes.failed()


def _table(growths: Mapping[str, Growth], latency: Latency, account: Sequence[Account],
           settle: float) -> str:
    lines = [f'| process | memory after {settle:g} s [MB] | at the end [MB] | growth |',
             '|---|---|---|---|']
    lines += [f'| {name} | {growth.first / 1e6:.1f} | {growth.last / 1e6:.1f} | '
              f'{growth.percent:+.2f} % |' for name, growth in growths.items()]
    lines += ['', '| state to answer, as sent [ms] | p50 | p99 | largest | answered |',
              '|---|---|---|---|---|']
    lines += [f'| {name} | {part.p50:.3f} | {part.p99:.3f} | {part.largest:.3f} | {part.answers} |'
              for name, part in (('first third', latency.first), ('last third', latency.last))]
    lines += ['', '| topic | received | written | in the bag | dropped | lost on the way |',
              '|---|---|---|---|---|---|']
    lines += [f'| {row.topic} | {row.received} | {row.written} | {row.in_bag} | {row.dropped} | '
              f'{row.lost} |' for row in account]
    return '\n'.join(lines)


def _verdict(growths: Mapping[str, Growth], latency: Latency,
             account: Sequence[Account]) -> list[str]:
    """Return what does not hold."""
    wrong = [f'{name} grew by {growth.percent:.2f} %: expected under {MEMORY_LIMIT:g} %'
             for name, growth in growths.items() if growth.percent >= MEMORY_LIMIT]
    if latency.drifts:
        wrong.append(f'latency drifts: median {latency.first.p50:.3f} ms in the first third, '
                     f'{latency.last.p50:.3f} ms in the last')
    wrong += [f'{row.topic}: received {row.received}, written {row.written}, dropped '
              f'{row.dropped}, in the bag {row.in_bag}' for row in account if not row.complete]
    return wrong


def _judge(output: Path, samples: _Samples, log: str, settle: float) -> list[str]:
    """Print the table and return what does not hold."""
    growths = {name: growth_of(samples.t[name], samples.rss[name], settle) for name in NODES}
    run = read_run(output / 'bag')
    latency = latency_of(run.sent, run.latency, settle)
    account = account_of(log, run.counts)
    print(_table(growths, latency, account, settle))
    return _verdict(growths, latency, account)


def _run(options: argparse.Namespace) -> int:
    duration = 60.0 * options.minutes
    if not 0.0 < duration < 1e7:
        raise BlfError(f'--minutes is {options.minutes:g}: expected more than 0')
    if util.find_spec('rclpy') is None:
        raise MissingExtra('rclpy', 'ros', 'the four nodes')
    output = options.output or Path('runs') / time.strftime('soak_%Y%m%d_%H%M%S')
    output.mkdir(parents=True)
    free = shutil.disk_usage(output).free
    if free < duration * BYTES_PER_SECOND:
        raise BlfError(f'{output}: {free / 1e9:.1f} GB are free: expected '
                       f'{duration * BYTES_PER_SECOND / 1e9:.1f} GB for {options.minutes:g} min')
    config = options.config or scenario('two_link.yaml')
    print(f'four processes, {config}, {options.minutes:g} min, {os.cpu_count()} cores, load '
          f'{os.getloadavg()[0]:.1f}\n', flush=True)
    with NodeProcesses(config.resolve(), duration, output.resolve()) as nodes:
        samples, bad = _drive(nodes, duration)
        bad = list(dict.fromkeys(bad + nodes.end()))
        for name in bad:
            print(f'{name} did not end well:\n{nodes.text(name)}', file=sys.stderr)
        log = nodes.text('recorder')
    wrong = [f'{name} did not end well' for name in bad]
    wrong += _judge(output, samples, log, min(SETTLE, 0.5 * duration))
    if not (options.keep or wrong):
        shutil.rmtree(output / 'bag')
    print('\n' + ('\n'.join(f'FAILED {text}' for text in wrong) or 'every check holds'))
    return 1 if wrong else 0


def main(args: list[str] | None = None) -> int:
    """Run the command; see the module for the exit status."""
    options = _parser().parse_args(args)
    try:
        return _run(options)
    except (BlfError, OSError) as error:
        print(f'soak: {error}', file=sys.stderr)
        return 2


if __name__ == '__main__':
    sys.exit(main())
