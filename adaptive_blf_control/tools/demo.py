# SPDX-License-Identifier: Apache-2.0
"""``demo``: four processes over DDS drive an unknown arm inside its bounds; then the verdict."""

from __future__ import annotations

import argparse
from importlib import util
import json
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import time

from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.errors import BlfError, MissingExtra
from adaptive_blf_control.parameters.yaml_file import load_yaml, node_values
from adaptive_blf_control.tools.bag_run import rates, run_of_bag
from adaptive_blf_control.tools.plot import plot_run
from adaptive_blf_control.tools.report import write_page
from adaptive_blf_control.tools.summary import summarise, table

__all__ = ['main']

NODES = ('recorder', 'identifier', 'controller', 'arm_driver')
PATIENCE = 90.0  # s until the arm has to move: the first run compiles the laws
GRACE = 15.0  # s for a node to end

# Announce endpoints often at the start, so that four nodes meet within half a second.
FAST_DISCOVERY = """<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com">
  <participant profile_name="demo" is_default_profile="true">
    <rtps><builtin><discovery_config>
      <leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
      <initialAnnouncements>
        <count>20</count><period><sec>0</sec><nanosec>200000000</nanosec></period>
      </initialAnnouncements>
    </discovery_config></builtin></rtps>
  </participant>
</profiles>
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='demo', description=__doc__)
    parser.add_argument('--config', type=Path, default=None,
                        help='parameter file (default: the 2-DoF task)')
    parser.add_argument('--duration', type=float, default=20.0, metavar='S')
    parser.add_argument('--output', type=Path, default=None, metavar='DIR',
                        help='folder for bag and picture (default: runs/TIME)')
    parser.add_argument('--json', action='store_true', help='print the figures as JSON too')
    return parser


def _default_config() -> Path:
    """Find config/two_link.yaml in the source tree or in an installed share folder."""
    package = Path(__file__).resolve().parents[1]
    for folder in (package.parent / 'config',
                   Path(sys.prefix) / 'share/adaptive_blf_control/config',
                   *(Path(prefix) / 'share/adaptive_blf_control/config'
                     for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(':') if prefix)):
        if (folder / 'two_link.yaml').is_file():
            return folder / 'two_link.yaml'
    return Path('config/two_link.yaml')


def _environment(output: Path) -> dict[str, str]:
    """Keep the demo on this host, in a domain of its own, with quick discovery."""
    profile = output / 'fast_discovery.xml'
    profile.write_text(FAST_DISCOVERY, encoding='utf-8')
    return {**os.environ,
            'ROS_DOMAIN_ID': os.environ.get('ROS_DOMAIN_ID', str(random.randint(1, 101))),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile),
            'ROS_LOG_DIR': str(output / 'log')}


class _Nodes:
    """The four processes; leaving the context ends every one of them."""

    def __init__(self, config: Path, duration: float, output: Path) -> None:
        extra = {'recorder': [f'bag:={output / "bag"}'],
                 'arm_driver': [f'duration:={duration}',
                                f'wait_for_subscribers:={len(NODES) - 1}']}
        environment = _environment(output)
        self.logs = {name: (output / f'{name}.txt').open('w+b') for name in NODES}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        for name in NODES:
            command = [sys.executable, '-m', 'adaptive_blf_control', name, '--ros-args',
                       '--params-file', str(config)]
            for setting in extra.get(name, []):
                command += ['-p', setting]
            self.processes[name] = subprocess.Popen(
                command, env=environment, stdout=self.logs[name], stderr=subprocess.STDOUT)

    def __enter__(self) -> _Nodes:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes.values():
            if process.poll() is None:
                process.kill()
                process.wait()
        for log in self.logs.values():
            log.close()

    def failed(self) -> list[str]:
        """Names of the nodes that ended with an error."""
        return [name for name, process in self.processes.items() if process.poll()]

    def text(self, name: str) -> str:
        """What a node printed."""
        self.logs[name].seek(0)
        return self.logs[name].read().decode(errors='replace')

    def end(self) -> list[str]:
        """Interrupt one after the other, the recorder last; return those that ended badly."""
        for name in ('controller', 'identifier', 'recorder'):
            process = self.processes[name]
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                try:
                    process.wait(GRACE)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
        return [name for name, process in self.processes.items() if process.returncode != 0]


def _progress(nodes: _Nodes, duration: float) -> list[str]:
    """Show a bar until the driver has ended; return the nodes that failed meanwhile."""
    driver = nodes.processes['arm_driver']
    moving: float | None = None
    begin = time.monotonic()
    show = sys.stderr.isatty()
    while driver.poll() is None:
        bad = nodes.failed()
        now = time.monotonic()
        if bad or now - begin > PATIENCE + 1.5 * duration:
            return bad or ['arm_driver']
        if moving is None and (nodes.text('controller').find('motion begins') >= 0):
            moving = now
        done = 0.0 if moving is None else min((now - moving) / duration, 1.0)
        if show:
            label = 'nodes are starting ' if moving is None else f'{done * duration:5.1f} s of ' \
                f'{duration:g} s'
            bar = '#' * int(40 * done)
            print(f'\r[{bar:<40}] {label:<22}', end='', file=sys.stderr, flush=True)
        time.sleep(0.2)
    if show:
        print(file=sys.stderr)
    return nodes.failed()


def main(args: list[str] | None = None) -> int:
    """Run the demo; 0 only if no set was left and every node ended well."""
    options = _parser().parse_args(args)
    if util.find_spec('rclpy') is None:
        print('demo: rclpy is not installed: source ROS 2 Jazzy, or pip install '
              '"adaptive_blf_control[ros]"', file=sys.stderr)
        return 2
    output = options.output or Path('runs') / time.strftime('%Y%m%d_%H%M%S')
    try:
        config = options.config or _default_config()
        node_values(load_yaml(config), 'controller')  # a clear error before anything starts
        if output.exists():
            raise BlfError(f'{output} exists already: name another folder with --output')
        output.mkdir(parents=True)
    except (BlfError, OSError) as error:
        print(f'demo: {error}', file=sys.stderr)
        return 2
    print(f'four processes over DDS: {", ".join(NODES)}; {config}, {options.duration:g} s',
          flush=True)
    with _Nodes(config.resolve(), options.duration, output.resolve()) as nodes:
        bad = _progress(nodes, options.duration)
        bad = list(dict.fromkeys(bad + nodes.end()))
        for name in bad:
            print(f'\n{name} did not end well:\n{nodes.text(name)}', file=sys.stderr)
    try:
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
    print(f'\n{table(figures, run)}')
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
