# SPDX-License-Identifier: Apache-2.0
"""``bench``: measure the figures of docs/benchmarks.md on this machine, printed as Markdown."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import json
import os
from pathlib import Path
import platform
import statistics
import subprocess
import sys
import tempfile
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.bench import (
    arms,
    campaigns,
    coverage,
    excitation_figures,
    identifier_steps,
    limits,
    log_memory,
    node_steps,
    payload,
    rates,
    robots,
    startup,
)
from adaptive_blf_control.bench.c_reference import against_c, compiler
from adaptive_blf_control.bench.commit_pairs import print_pairs
from adaptive_blf_control.bench.loop_pairs import LOOP_PAIRS
from adaptive_blf_control.bench.read_back import mujoco_errors
from adaptive_blf_control.bench.step_pairs import STEP_PAIRS
from adaptive_blf_control.compilation_notice import announce_compilation
from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import load_yaml
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runs.summary import run_of_trace, summarise

__all__ = ['main']

SCENARIOS = (('two_link_paper', 50.0), ('two_link_paper', 100.0), ('two_link', 20.0),
             ('two_link_payload_step', 100.0), ('three_link', 143.0), ('three_link_paper', 143.0),
             ('three_link_encoder', 120.0), ('panda_ideal', 20.0))
REPEATS = 3
NODE_DURATION = 5.0  # s of arm time, for the steps of the nodes
# Held-out RMSE [N·m] of batch least squares with the same torque filter (0.1 s), joint by joint.
MEASURED = {
    'panda': ('panda_gaz2019/panda_exciting_traj.csv', 'panda_gaz2019/panda_gaz2019.urdf',
              (0.165, 0.211, 0.141, 0.127, 0.059, 0.052, 0.042)),
    'ur10': ('ur10_unisa2025/ur10_exciting_trajectory.db3', 'ur10_unisa2025/ur10_dh.urdf',
             (2.109, 3.101, 1.233, 0.389, 0.452, 1.769)),
}


def _machine() -> None:
    print(f'\nPython {platform.python_version()}, numpy {np.__version__}, '
          f'{"numba" if COMPILED else "no numba"}, {os.cpu_count()} cores, '
          f'{platform.machine()}, load {os.getloadavg()[0]:.1f}\n')


def _scenarios(options: argparse.Namespace) -> None:
    print('| scenario | samples outside | largest error [rad] | converged after [s] | '
          'parameter error | of | rank | x real time, median |')
    print('|---|---|---|---|---|---|---|---|')
    for name, duration in SCENARIOS:
        data = load_yaml(options.config / f'{name}.yaml')
        speeds: list[float] = []
        figures: dict[str, Any] = {}
        for _ in range(REPEATS if duration <= 20.0 else 1):
            loop = build_closed_loop(data)
            loop.warm_up()
            trace = loop.run(duration)
            speeds.append(float(trace.t[-1] / trace.wall_s))
            figures = summarise(run_of_trace(loop, trace))
        converged = ', '.join('no' if time is None else f'{time:.2f}'
                              for time in figures['theta_settling_times_s'])
        print(f'| {name}, {duration:g} s | {figures["set_violations"]} | '
              f'{max(figures["max_abs_error"]):.4f} | '
              f'{converged} | {figures["theta_error_norm"]:.2g} | '
              f'{figures["theta_true_norm"]:.3g} | '
              f'{figures["history_rank"]} | {statistics.median(speeds):.1f} |', flush=True)


def _against_c(options: argparse.Namespace) -> None:
    if options.c_reference is None:
        print('Skipped: --c-reference FILE names a program in C to compare with.')
        return
    if not options.c_reference.is_file():
        print(f'Skipped: --c-reference {options.c_reference} is no file.')
        return
    if compiler() is None:
        print('Skipped: there is no C compiler here.')
        return
    measured = against_c(options.c_reference, options.config / 'two_link.yaml')
    print('| ours, us per step | the program in C, -O2 | ratio |')
    print('|---|---|---|')
    print(f'| {measured.ours:.2f} | {measured.c:.2f} | {measured.ratio:.2f} |', flush=True)


def _steps(options: argparse.Namespace) -> None:
    print('panda, 20 s: 50 parameters, 60 pairs; candidates after the history has full rank.\n')
    times = identifier_steps.times_of(load_yaml(options.config / 'panda.yaml'), 20.0)
    print(identifier_steps.table(times), flush=True)
    for scenario in ('two_link', 'panda_ideal'):
        print(f'\n{scenario}: what a node computes for a sample, message in to messages out.\n')
        data = load_yaml(options.config / f'{scenario}.yaml')
        print(identifier_steps.table(node_steps.times_of(data, NODE_DURATION)), flush=True)


def _step_pairs(options: argparse.Namespace) -> None:
    print_pairs(STEP_PAIRS, options.config)


def _loop_pairs(options: argparse.Namespace) -> None:
    print_pairs(LOOP_PAIRS, options.config)


def _run_json(arguments: list[str]) -> dict[str, Any]:
    done = subprocess.run([sys.executable, '-m', 'adaptive_blf_control', *arguments, '--json'],
                          capture_output=True, text=True, check=False)
    start = done.stdout.find('{')
    if start < 0:
        raise RuntimeError(f'{arguments[0]} printed no figures:\n{done.stdout}{done.stderr}')
    return dict(json.loads(done.stdout[start:]))


def _processes(options: argparse.Namespace) -> None:
    print('| run | samples outside | largest error [rad] | converged after [s] | '
          'parameter error | driver, controller, identifier [Hz] |')
    print('|---|---|---|---|---|---|')
    for number in range(REPEATS):
        with tempfile.TemporaryDirectory() as folder:
            figures = _run_json(['demo', '--config', str(options.config / 'two_link.yaml'),
                                 '--output', str(Path(folder) / 'run')])
        held = figures['rates_hz']
        converged = figures['theta_settling_time_s']
        print(f'| two_link, 20 s, run {number + 1} | {figures["set_violations"]} | '
              f'{max(figures["max_abs_error"]):.4f} | '
              f'{"no" if converged is None else format(converged, ".2f")} | '
              f'{figures["theta_error_norm"]:.2g} | '
              f'{held["arm_driver"]:.0f}, {held["controller"]:.0f}, {held["identifier"]:.0f} |',
              flush=True)


def _has_logs(options: argparse.Namespace) -> bool:
    """Say what is done with the measured logs; return whether they are there."""
    if options.logs is None:
        print('Skipped: --logs DIR names the folder of measured logs.')
        return False
    needed = [name for log, urdf, _ in MEASURED.values() for name in (log, urdf)]
    missing = [name for name in needed if not (options.logs / name).exists()]
    if missing:
        print(f'Skipped: --logs {options.logs} has no {", ".join(missing)}.')
        return False
    print('Learned on the first half, tested on the second: RMSE of the filtered torque [N·m].\n')
    return True


def _measured(options: argparse.Namespace) -> None:
    if not _has_logs(options):
        return
    print('| robot | ours, joint by joint | mean | batch (given), mean | ratio | rank of '
          'columns | insertions | us per sample |')
    print('|---|---|---|---|---|---|---|---|')
    for robot, (log, urdf, batch) in MEASURED.items():
        with tempfile.TemporaryDirectory() as folder:
            figures = _run_json([
                'identify', str(options.logs / log), '--urdf', str(options.logs / urdf),
                '--config', str(options.config / f'{robot}_identification.yaml'),
                '--output', str(Path(folder) / 'theta_hat.yaml')])
        ours = figures['test_rmse']
        ours = list(ours.values()) if isinstance(ours, dict) else ours
        mean, reference = statistics.mean(ours), statistics.mean(batch)
        print(f'| {robot} | {" ".join(f"{value:.3f}" for value in ours)} | {mean:.4f} | '
              f'{reference:.4f} | {mean / reference:.3f} | {figures["history_rank"]} of '
              f'{figures["columns"]} | {figures["insertions"]} | '
              f'{figures["us_per_sample"]:.0f} |', flush=True)


def _models(options: argparse.Namespace) -> None:
    if not _has_logs(options):
        return
    print('| robot | M > 0, θ̂ | M > 0, consistent | θ̂, mean | consistent, mean | ratio | '
          'found in [ms] | 95 % intervals held | worst joint | MuJoCo on the URDF less '
          'Pinocchio [N·m] | with the inertias of the file |')
    print('|---|---|---|---|---|---|---|---|---|---|---|')
    for robot, (log, urdf, _) in MEASURED.items():
        with tempfile.TemporaryDirectory() as folder:
            figures = _run_json([
                'identify', str(options.logs / log), '--urdf', str(options.logs / urdf),
                '--urdf-out', str(Path(folder) / 'identified.urdf'),
                '--output', str(Path(folder) / 'theta_hat.yaml')])
            read_back = mujoco_errors(Path(folder) / 'identified.urdf')
        positive, model = figures['positive_mass'], figures['consistent']
        free, possible = (statistics.mean(each['test_rmse']) for each in (figures, model))
        print(f'| {robot} | {positive["theta_hat"]} of {positive["postures"]} | '
              f'{positive["consistent"]} | {free:.4f} | {possible:.4f} | {possible / free:.3f} | '
              f'{model["ms"]:.0f} | {statistics.mean(figures["test_coverage"]):.1%} | '
              f'{min(figures["test_coverage"]):.1%} | '
              + (' | '.join(f'{error:.1e}' for error in read_back) if read_back else '– | –')
              + ' |', flush=True)


class Part(NamedTuple):
    """A part of the benchmarks.

    Attributes:
        title: Heading of what it prints.
        run: Measures and prints.
        add_options: Adds options of its own to the command; None where it has none.
        by_name_only: Whether it runs only where it is named, as it takes hours or the history of
            the repository.
    """

    title: str
    run: Callable[[argparse.Namespace], None]
    add_options: Callable[[argparse.ArgumentParser], None] | None = None
    by_name_only: bool = False


PARTS = {
    'scenarios': Part('Closed loop offline (`simulate`)', _scenarios),
    'steps': Part('Steps of identifier and controller', _steps),
    'step_pairs': Part('Steps of the nodes beside those of d8177d4', _step_pairs,
                       by_name_only=True),
    'loop_pairs': Part('Closed loop offline beside that of d8177d4', _loop_pairs,
                       by_name_only=True),
    'against_c': Part('Against C (`two_link`, one thread)', _against_c),
    'startup': Part('Start-up, warm', startup.run, startup.add_options),
    'processes': Part('Four processes, real time (`demo`)', _processes),
    'measured': Part('Measured robots (`identify`)', _measured),
    'models': Part('Models of measured robots (`identify`)', _models),
    'coverage': Part('Coverage of 95 % intervals', coverage.run, coverage.add_options),
    'excite': Part('Motions to record', excitation_figures.run, excitation_figures.add_options),
    'payload': Part('The load', payload.run, payload.add_options),
    'arms': Part('Arms as `configure` leaves them', arms.run, arms.add_options),
    'robots': Part('Six robots in MuJoCo', robots.run, robots.add_options, by_name_only=True),
    'campaigns': Part('Campaigns', campaigns.run, campaigns.add_options),
    'rates': Part('Rate and latency', rates.run, rates.add_options),
    'limits': Part('The safety filter', limits.run, limits.add_options),
    'log_memory': Part('Memory beside the size of a log', log_memory.run,
                       log_memory.add_options, by_name_only=True),
}


def main(args: list[str] | None = None) -> int:
    """Run the parts that are named, or all; 1 where one fails."""
    parser = argparse.ArgumentParser(prog='bench', description=__doc__)
    parser.add_argument('parts', nargs='*',
                        help=f'one or more of {", ".join(PARTS)}; default: all but robots, which '
                        'takes hours, step_pairs and loop_pairs, which take the history of the '
                        'repository, and log_memory, which takes much of the disk')
    parser.add_argument('--config', type=Path, default=Path('config'), metavar='DIR',
                        help='folder of the scenarios')
    parser.add_argument('--logs', type=Path, metavar='DIR',
                        help='folder of the measured logs, for measured and models: '
                        'docs/benchmarks.md says which')
    parser.add_argument('--c-reference', type=Path, metavar='FILE',
                        help='source of a program in C that does the work of two_link, for '
                        'against_c')
    for part in PARTS.values():
        if part.add_options is not None:
            part.add_options(parser)
    options = parser.parse_args(args)
    announce_compilation()
    unknown = [part for part in options.parts if part not in PARTS]
    if unknown:
        parser.error(f'no part {unknown[0]!r}: expected {", ".join(PARTS)}')
    try:
        for name in options.parts or [name for name in PARTS if not PARTS[name].by_name_only]:
            print(f'\n## {PARTS[name].title} (`bench {name}`)')
            _machine()
            PARTS[name].run(options)
    except BlfError as error:
        print(f'bench: {error}', file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
