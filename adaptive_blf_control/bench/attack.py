# SPDX-License-Identifier: Apache-2.0
"""``attack``: strangers attack the four processes while an observer judges the commands.

Each round makes every attack once; between two of them the motion has to go on. The memory of each
process is compared between the time after the second round and the end: in ten minutes it may grow
by 1 %. The first two are left out because what an attack makes a process hold at once, e.g. the
lists of a million values in the buffers of DDS, is kept for the next one and grows once or twice.

Exit status: 0 nothing was broken, 1 something was, 2 it could not be run.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
import os
from pathlib import Path
import sys
import tempfile
import time

from adaptive_blf_control.bench.command_observer import CommandObserver
from adaptive_blf_control.bench.nodes.stranger import Stranger, TELLS
from adaptive_blf_control.bench.rate_figures import usage_of
from adaptive_blf_control.bench.soak_figures import growth_of
from adaptive_blf_control.configuration.shipped import scenario
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.processes import NodeProcesses

__all__ = ['main']

LIMIT, RATE = 200.0, 5000.0  # N·m, N·m/s
OLDEST = 0.1  # s after its stamp, at which a state may still be answered
RECOVERY = 60.0  # s within which the motion has to go on
FIRST_ROUNDS, LEAST_ROUNDS = 2, 6  # before figures of the memory, and for them
MOST_GROWTH = 1.0  # %
SETTINGS = {'controller': [f'torque_limit:=[{LIMIT}]', f'torque_rate_limit:=[{RATE}]',
                           # A state is sent a quarter of command_timeout (0.1 s) after its stamp
                           # at the latest, and its age counts from then on.
                           'state_timeout:=0.075',
                           # A stalled machine must not end the attack: the motion may begin
                           # again wherever the arm has coasted.
                           'safety.lower:=[-50.0]', 'safety.upper:=[50.0]'],
            'recorder': [], 'identifier': [],
            # Braked while nobody commands, it does not coast out of its safety set.
            'arm_driver': ['rate:=250.0', 'timeout_action:=damping']}


def main(args: Sequence[str] | None = None) -> int:
    """Attack for a while and print the verdict of each attack."""
    parser = argparse.ArgumentParser(prog='attack', description=__doc__.partition('\n')[0])
    parser.add_argument('--minutes', type=float, default=10.0, help='how long (default 10)')
    options = parser.parse_args(args)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    observer = CommandObserver(LIMIT, RATE, OLDEST, TELLS)
    with tempfile.TemporaryDirectory(prefix='attack_') as folder, NodeProcesses(
            scenario('two_link.yaml').resolve(), 1e6, Path(folder), SETTINGS) as nodes:
        stranger = Stranger(nodes.domain, nodes.processes, observer.command, observer.state)
        try:
            _goes_on(observer, nodes)
            watch = _Memory(nodes)
            broken = _rounds(stranger, observer, nodes, watch,
                             time.monotonic() + 60.0 * options.minutes)
            broken = watch.report() or broken
            print(f'{stranger.answered} of {stranger.asked} requests for the state answered')
        except BlfError as error:
            print(error, file=sys.stderr)
            broken = True
        stranger.close()
    print('broken' if broken else f'nothing was broken in {observer.commands} commands')
    return int(broken)


class _Memory:
    """Resident memory of each process, round by round."""

    def __init__(self, nodes: NodeProcesses) -> None:
        self._nodes = nodes
        self._rounds: list[int] = []
        self._sizes: dict[str, list[float]] = {name: [] for name in nodes.processes}  # MB

    def look(self, before: int) -> None:
        """Take a sample where ``before`` rounds are over."""
        self._rounds.append(before)
        for name, process in self._nodes.processes.items():
            usage = usage_of(process.pid)
            self._sizes[name].append(float('nan') if usage is None else usage[1])

    def report(self) -> bool:
        """Print the memory after the first rounds and at the end; whether one grew too much."""
        if self._rounds[-1] < LEAST_ROUNDS:
            print(f'no figures of the memory in less than {LEAST_ROUNDS} rounds')
            return False
        growths = {name: growth_of(self._rounds, sizes, FIRST_ROUNDS)
                   for name, sizes in self._sizes.items()}
        for name, growth in growths.items():
            print(f'{name:<12}{growth.first:8.1f} MB after {FIRST_ROUNDS} rounds '
                  f'{growth.last:8.1f} MB at the end {growth.percent:+7.2f} %')
        return any(growth.percent > MOST_GROWTH for growth in growths.values())


def _rounds(stranger: Stranger, observer: CommandObserver, nodes: NodeProcesses, watch: _Memory,
            end: float) -> bool:
    attacks: tuple[Callable[[], None], ...] = (
        stranger.shout_commands, stranger.shout_estimates, stranger.shout_states,
        stranger.long_trajectory, stranger.long_lists, stranger.pause_controller,
        stranger.pause_driver, stranger.second_graph, stranger.ask)
    rounds = 0
    while not rounds or time.monotonic() < end:
        for attack in attacks:
            before = observer.count
            attack()
            _goes_on(observer, nodes)
            watch.look(rounds)
            found = observer.count - before
            print(f'{attack.__name__:<18}{"held" if not found else f"{found} faults"}', flush=True)
            for fault in observer.faults[before:]:
                print(f'  {fault}', flush=True)
        rounds += 1
    return observer.count > 0


def _goes_on(observer: CommandObserver, nodes: NodeProcesses) -> None:
    """Wait until the controller answers again; BlfError where it does not, or a node ended."""
    seen, give_up = observer.commands, time.monotonic() + RECOVERY
    while observer.commands < seen + 100:
        if ended := [name for name, each in nodes.processes.items() if each.poll() is not None]:
            raise BlfError(f'{", ".join(ended)} ended: {nodes.text(ended[0])[-600:]}')
        if time.monotonic() > give_up:
            raise BlfError(f'no motion within {RECOVERY:g} s: {nodes.text("controller")[-600:]}')
        time.sleep(0.01)
