# SPDX-License-Identifier: Apache-2.0
"""``demo``: four processes over DDS drive an unknown arm inside its bounds; then the verdict."""

from __future__ import annotations

import argparse
from importlib import util
import json
from pathlib import Path
import sys
import time

from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.configuration.parameter_file import load_yaml, node_settings
from adaptive_blf_control.configuration.shipped import found, scenario
from adaptive_blf_control.errors import BlfError, MissingExtra
from adaptive_blf_control.report.plot import plot_run
from adaptive_blf_control.runs.bag_run import rates, run_of_bag
from adaptive_blf_control.runs.summary import summarise, table
from adaptive_blf_control.runtime.processes import COMPOSED, NodeProcesses, NODES
from adaptive_blf_control.tools.report import write_page

__all__ = ['main']

SHORTEST = 1.0  # of a motion whose rates say anything [s]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='demo', description=__doc__)
    parser.add_argument('--config', type=Path, default=None,
                        help='parameter file (default: the 2-DoF task)')
    parser.add_argument('--duration', type=float, default=20.0, metavar='S')
    parser.add_argument('--output', type=Path, default=None, metavar='DIR',
                        help='folder for bag and picture (default: runs/TIME)')
    parser.add_argument('--composed', action='store_true',
                        help='controller and identifier in one process, arm_control')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON, too')
    return parser


def _progress(nodes: NodeProcesses, duration: float) -> list[str]:
    """Show a progress bar until the driver ends; return the nodes that failed meanwhile."""
    show = sys.stderr.isatty()

    def look(moving: float | None) -> None:
        if show:
            done = min((moving or 0.0) / duration, 1.0)
            label = ('nodes are starting ' if moving is None else
                     f'{done * duration:5.1f} s of {duration:g} s')
            bar = '#' * int(40 * done)
            print(f'\r[{bar:<40}] {label:<22}', end='', file=sys.stderr, flush=True)

    failed = nodes.until_done(look, 0.2)
    if show:
        print(file=sys.stderr)
    return failed


def _run(config: Path, options: argparse.Namespace, output: Path) -> list[str]:
    """Run the nodes; return those that did not end well, after printing their output."""
    duration = options.duration
    with NodeProcesses(config, duration, output, composed=options.composed) as nodes:
        print(f'on this host only; to look inside: ROS_DOMAIN_ID={nodes.domain}', flush=True)
        bad = _progress(nodes, duration)
        bad = list(dict.fromkeys(bad + nodes.end()))
        for name in bad:
            print(f'\n{name} did not end well:\n{nodes.text(name)}', file=sys.stderr)
    return bad


def main(args: list[str] | None = None) -> int:
    """Run the demo; 0 only if both sets were kept and every node ended well."""
    options = _parser().parse_args(args)
    if util.find_spec('rclpy') is None:
        print('demo: rclpy is not installed: source ROS 2 Jazzy, or pip install '
              '"adaptive_blf_control[ros]"', file=sys.stderr)
        return 2
    output = options.output or Path('runs') / time.strftime('%Y%m%d_%H%M%S')
    try:
        config = found(options.config or scenario('two_link.yaml'))
        # A clear error before anything starts.
        node_settings(load_yaml(config), ControllerNodeSettings)
        if output.exists():
            raise BlfError(f'{output} exists already: name another folder with --output')
        output.mkdir(parents=True)
    except (BlfError, OSError) as error:
        print(f'demo: {error}', file=sys.stderr)
        return 2
    names = COMPOSED if options.composed else NODES
    print(f'{len(names)} processes over DDS: {", ".join(names)}; {config}, '
          f'{options.duration:g} s', flush=True)
    try:
        bad = _run(config.resolve(), options, output.resolve())
        return _report(output, options, bad)
    except BlfError as error:
        print(f'demo: {error}', file=sys.stderr)
        return 1


def _report(output: Path, options: argparse.Namespace, bad: list[str]) -> int:
    bag = read_bag(output / 'bag')
    run = run_of_bag(bag)
    figures = summarise(run)
    held = rates(bag, run)
    figures['rates_hz'] = held
    kept = figures['set_violations'] == 0
    print(f'\n{table(figures, run, options.duration)}')
    if figures['duration_s'] >= SHORTEST:
        print('rates held           ' + ', '.join(f'{k} {v:.0f} Hz' for k, v in held.items()))
    picture = output / 'run.png'
    plot_run(run, picture, 'Four nodes, 2-DoF arm with unknown parameters: sets '
             + ('kept' if kept else 'LEFT') if options.config is None else str(options.config))
    print(f'bag                  {output / "bag"}\npicture              {picture}')
    try:
        print(f'report               {write_page([output / "bag"], output / "report.html")}')
    except MissingExtra as error:  # the run itself does not depend on it
        print(f'report               none: {error}')
    if options.json:
        print(json.dumps(figures, indent=2))
    if bad:
        print(f'nodes that did not end well: {", ".join(bad)}')
    return 0 if kept and not bad else 1


if __name__ == '__main__':
    sys.exit(main())
