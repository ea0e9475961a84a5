# SPDX-License-Identifier: Apache-2.0
"""``bench rates``: the rate that the nodes hold, beside three nodes without control work."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import util
import math
from pathlib import Path
import tempfile
import time
from typing import NamedTuple

from adaptive_blf_control.bench.rate_figures import (
    Loop,
    median,
    of_bag,
    of_bare,
    RateFigures,
    Row,
    Seen,
    stolen_time,
    Usage,
    usage_of,
)
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import load_yaml, node_settings
from adaptive_blf_control.errors import BlfError, MissingExtra, ParameterError
from adaptive_blf_control.runtime.loop_statistics import START_UP
from adaptive_blf_control.runtime.processes import NodeProcesses, Processes

__all__ = ['add_options', 'run']

RATES = (250.0, 500.0, 1000.0)  # Hz
OURS = ('arm_driver', 'controller', 'identifier', 'recorder')
BARE = ('listener', 'echo', 'driver')  # in the order of their start
FOUR, COMPOSED, RAW, ECHO = 'four nodes', 'composed', 'raw echo', 'bare echo'
PLAIN = {RAW: 'raw', ECHO: 'bare'}  # how the names of their processes begin in the tables
MOTION_TIMEOUT = 90.0  # s until the arm has to move; the first run compiles the laws
POLL_PERIOD = 0.1  # s
NOTES = """\
Left out: the first {start_up:g} s of motion, and the last 0.1 s. Missed: periods of the driver's
grid without a state, without its answer or without its estimate, also where the recorder lost the
message that shows it; for the recorder, messages of the whole run that did not reach the bag.
Met: periods whose state was answered, even if late; in time: before the next state was due. One
callback of the recorder handles what arrived within 10 ms. Composed: controller and identifier in
one process, with its processor time and memory in the line of the controller; what the identifier
has missed then follows from the rate in its diagnostics. Bare echo: typed messages, `rclpy.spin`,
no control and no recorder. CPU: % of a core. Start: from the start of the processes until the arm
moves, within 0.1 s. Stolen: processor time that the host of a virtual
machine gave to others meanwhile; periods due in that time are missed. Ratios: below 1 our nodes
are better, in the periods above 1. Raw echo: bytes, taken and published as our nodes do, without
any work. The way: from the stamps and the times of publication in the bag; what is left of the
round trip is the way back.
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the part `rates`."""
    group = parser.add_argument_group('rates')
    group.add_argument('--seconds', type=float, default=30.0, metavar='S',
                       help='duration of the motion at each rate (default: 30)')
    group.add_argument('--rates', type=float, nargs='+', default=list(RATES), metavar='HZ',
                       help='rates of the driver (default: 250 500 1000)')
    group.add_argument('--composed', action='store_true',
                       help='measure controller and identifier in one process, too')
    group.add_argument('--floor', action='store_true',
                       help='measure nodes that only take and publish bytes, too: the round trip '
                            'that rclpy leaves')
    group.add_argument('--scenario', default='two_link.yaml', metavar='FILE',
                       help='what moves, a file of --config or a path (default: two_link.yaml)')
    group.add_argument('--repeats', type=int, default=1, metavar='N',
                       help='runs at each rate, alternating with the bare echo; medians are '
                            'printed')
    group.add_argument('--executor', choices=('direct', 'plain'), default='direct',
                       help='how the nodes wait for data (default: direct)')
    group.add_argument('--realtime', type=int, default=0, metavar='PRIORITY',
                       help='SCHED_FIFO priority of the driver, one less each for controller, '
                            'identifier and recorder, and locked memory; 0: no priority')


def run(options: argparse.Namespace) -> None:
    """Measure and print; BlfError with the output of the node where one fails."""
    _check(options)
    print(NOTES.format(start_up=_start_up(options.seconds)))
    for rate in options.rates:
        measures: dict[str, Callable[[], RateFigures]] = {FOUR: partial(_ours, options, rate)}
        if options.composed:
            measures[COMPOSED] = partial(_ours, options, rate, composed=True)
        if options.floor:
            measures[RAW] = partial(_plain, options, rate, 'raw_echo')
        measures[ECHO] = partial(_plain, options, rate, 'bare_echo')
        runs: dict[str, list[RateFigures]] = {name: [] for name in measures}
        for _ in range(options.repeats):
            for name, measure in measures.items():
                runs[name].append(measure())
        print(_tables(rate, {name: median(found) for name, found in runs.items()}), flush=True)


def _scenario(options: argparse.Namespace) -> Path:
    named = Path(options.scenario)
    path: Path = named if named.is_file() else options.config / named
    return path.resolve()


def _check(options: argparse.Namespace) -> None:
    if util.find_spec('rclpy') is None:
        raise MissingExtra('rclpy', 'ros', 'the four nodes')
    if not 1.0 <= options.seconds <= 1e5:
        raise ParameterError('--seconds', options.seconds, '1 to 1e5')
    if options.repeats < 1:
        raise ParameterError('--repeats', options.repeats, '1 or more')
    if options.realtime and not len(OURS) <= options.realtime <= 99:
        raise ParameterError('--realtime', options.realtime,
                             f'{len(OURS)} to 99, or 0 for none')
    for rate in options.rates:
        if not 1.0 <= rate <= 10_000.0:
            raise ParameterError('--rates', rate, '1 to 10000')


def _start_up(seconds: float) -> float:
    """Return the time left out at the start [s]; 0 for a run that is hardly longer."""
    return START_UP if seconds >= 2.0 * START_UP else 0.0


def _settings(options: argparse.Namespace, rate: float) -> dict[str, list[str]]:
    settings = {name: [f'executor:={options.executor}'] for name in OURS}
    settings['arm_driver'].append(f'rate:={rate!r}')
    if options.realtime:
        for lower, name in enumerate(OURS):
            settings[name] += [f'realtime.priority:={options.realtime - lower}',
                               'realtime.lock_memory:=true']
    return settings


def _ours(options: argparse.Namespace, rate: float, *, composed: bool = False) -> RateFigures:
    start_up = _start_up(options.seconds)
    with tempfile.TemporaryDirectory(prefix='rates_') as folder:
        output = Path(folder)
        with NodeProcesses(_scenario(options), options.seconds, output, _settings(options, rate),
                           composed=composed) as nodes:
            usage, seen = _watch(nodes, nodes.herald, options.seconds, start_up)
            _refusals(nodes)
            log = nodes.text('recorder')
        return of_bag(output / 'bag', log, usage, rate, start_up, seen)


def _plain(options: argparse.Namespace, rate: float, module: str) -> RateFigures:
    """Measure the three nodes of a module of `bench.nodes`."""
    seconds, start_up = options.seconds, _start_up(options.seconds)
    arm = build_arm(node_settings(load_yaml(_scenario(options)), ControllerNodeSettings))
    with tempfile.TemporaryDirectory(prefix='rates_') as folder:
        files = {name: Path(folder) / f'{name}.npz' for name in BARE}
        commands = {name: ['-m', f'adaptive_blf_control.bench.nodes.{module}', name, '--output',
                           str(file), '--rate', str(rate), '--seconds', str(seconds),
                           '--joints', str(arm.n), '--parameters', str(arm.m)]
                    for name, file in files.items()}
        with Processes(commands, Path(folder)) as nodes:
            usage, seen = _watch(nodes, 'driver', seconds, start_up)
        return of_bare(files, usage, rate, start_up, seen)


def _watch(nodes: Processes, herald: str, seconds: float,
           start_up: float) -> tuple[dict[str, Usage], Seen]:
    """Wait until the run is over; return what each process used while the arm moved.

    Args:
        nodes: The processes, started.
        herald: The process that prints when the motion begins.
        seconds: Duration of the motion [s].
        start_up: Time left out at its start [s].

    Returns:
        Usage by process, and what else was seen.

    Raises:
        BlfError: a process failed, or took too long; with what it printed.
    """
    *_, leader = nodes.processes
    started = nodes.started
    moving = math.inf
    looks: list[_Look] = []
    while nodes.processes[leader].poll() is None:
        now = time.monotonic()
        bad = nodes.failed()
        if bad:
            raise BlfError(_with_output(nodes, bad, 'did not end well'))
        if math.isinf(moving) and 'motion begins' in nodes.text(herald):
            moving = now
        if now - min(moving, started + MOTION_TIMEOUT) > 1.5 * seconds + 10.0:
            raise BlfError(_with_output(nodes, [herald, leader], 'took too long'))
        if moving + start_up <= now <= moving + seconds:
            look = {name: usage_of(process.pid) for name, process in nodes.processes.items()}
            looks.append(_Look(now, {name: one for name, one in look.items() if one},
                               *stolen_time()))
        time.sleep(POLL_PERIOD)
    bad = list(dict.fromkeys(nodes.failed() + nodes.end()))
    if bad:
        raise BlfError(_with_output(nodes, bad, 'did not end well'))
    return _usage(nodes, looks, moving - started)


class _Look(NamedTuple):
    """Processor time [s] and memory [MB] by process, stolen and all time [ticks], at ``t`` [s]."""

    t: float
    usage: dict[str, tuple[float, float]]
    stolen: float
    all: float


def _usage(nodes: Processes, looks: Sequence[_Look],
           start: float) -> tuple[dict[str, Usage], Seen]:
    whole = [look for look in looks if len(look.usage) == len(nodes.processes)]
    if len(whole) < 2:
        raise BlfError(_with_output(nodes, list(nodes.processes),
                                    'ended before it could be measured'))
    before, after = whole[0], whole[-1]
    used = {name: Usage(100.0 * (after.usage[name][0] - before.usage[name][0])
                        / (after.t - before.t), after.usage[name][1]) for name in nodes.processes}
    ticks = after.all - before.all
    stolen = 100.0 * (after.stolen - before.stolen) / ticks if ticks else math.nan
    return used, Seen(stolen, start)


def _with_output(nodes: Processes, names: Sequence[str], what: str) -> str:
    return '\n'.join(f'{name} {what}, it printed:\n{nodes.text(name).rstrip()}'
                     for name in dict.fromkeys(names))


def _refusals(nodes: Processes) -> None:
    """Print which node did not get the priority or the locked memory that it asked for."""
    for name in nodes.processes:
        for line in nodes.text(name).splitlines():
            if 'running as usual' in line or 'no wait sets to use' in line:
                print(f'{name}: {line.rpartition("]: ")[2]}\n')


def _tables(rate: float, runs: Mapping[str, RateFigures]) -> str:
    bare = runs[ECHO]
    lines = [f'### {rate:g} Hz\n',
             '| process | rate [Hz] | missed | missed [%] | callback p50 [ms] | p99 | largest | '
             'CPU [%] | memory [MB] |',
             '|---|---|---|---|---|---|---|---|---|']
    lines += [_line(name if loop == FOUR else f'{name}, {loop}', run.rows[name])
              for loop, run in runs.items() if loop not in PLAIN for name in OURS]
    lines += [_line(f'{PLAIN[loop]}_{name}', run.rows[name])
              for loop, run in runs.items() if loop in PLAIN for name in reversed(BARE)]
    lines += ['', '| loop | round trip p50 [ms] | p99 | p99.9 | largest | periods met [%] | '
                  'in time [%] | cores | stolen [%] | start [s] |',
              '|---|---|---|---|---|---|---|---|---|---|']
    for name, run in runs.items():
        loop = run.loop
        lines.append(f'| {name} | ' + ' | '.join(_text(value, 3) for value in loop[:4])
                     + f' | {_text(loop.met, 3)} | {_text(loop.in_time, 3)} | '
                     f'{_text(loop.cores, 2)} | {_text(loop.stolen, 2)} | '
                     f'{_text(loop.start, 1)} |')
    lines += [f'| {name} / {ECHO} | ' + ' | '.join(_ratios(run.loop, bare.loop)) + ' |'
              for name, run in runs.items() if name != ECHO]
    lines += ['', '| loop | state sent after it was due p50 [ms] | p99 | over half a period [%] | '
                  'from there until its command is sent p50 [ms] | p99 | back p50 [ms] |',
              '|---|---|---|---|---|---|---|']
    lines += [f'| way, {name} | ' + ' | '.join(_text(value, 3) for value in run.way) + ' |'
              for name, run in runs.items() if name != ECHO]
    return '\n'.join(lines) + '\n'


def _line(name: str, row: Row) -> str:
    percent = 100.0 * row.missed / row.due if row.due else math.nan
    return (f'| {name} | {_text(row.rate, 1)} | {row.missed:g} | {_text(percent, 3)} | '
            f'{_text(row.p50, 3)} | {_text(row.p99, 3)} | {_text(row.largest, 3)} | '
            f'{_text(row.cpu, 1)} | {_text(row.memory, 1)} |')


def _text(value: float, digits: int) -> str:
    return '–' if math.isnan(value) else f'{value:.{digits}f}'


def _ratios(ours: Loop, bare: Loop) -> list[str]:
    return [_text(mine / other if other and name not in Seen._fields else math.nan,
                  3 if name in ('met', 'in_time') else 2)
            for name, mine, other in zip(Loop._fields, ours, bare)]
