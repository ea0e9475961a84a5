# SPDX-License-Identifier: Apache-2.0
"""``attack``: strangers attack the four processes while an observer judges the commands.

Each round makes every attack once; between two of them the motion has to go on.

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
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.nodes.stranger import Stranger, TELLS
from adaptive_blf_control.runtime.processes import NodeProcesses, scenario

__all__ = ['main']

LIMIT, RATE, TIMEOUT = 200.0, 5000.0, 0.1  # N·m, N·m/s, s
RECOVERY = 60.0  # s within which the motion has to go on
SETTINGS = {'controller': [f'torque_limit:=[{LIMIT}]', f'torque_rate_limit:=[{RATE}]',
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
    observer = CommandObserver(LIMIT, RATE, TIMEOUT, TELLS)
    with tempfile.TemporaryDirectory(prefix='attack_') as folder, NodeProcesses(
            scenario('two_link.yaml').resolve(), 1e6, Path(folder), SETTINGS) as nodes:
        stranger = Stranger(nodes.domain, nodes.processes, observer.command, observer.state)
        try:
            _goes_on(observer, nodes)
            broken = _rounds(stranger, observer, nodes, time.monotonic() + 60.0 * options.minutes)
        except BlfError as error:
            print(error, file=sys.stderr)
            broken = True
        stranger.close()
    print('broken' if broken else f'nothing was broken in {observer.commands} commands')
    return int(broken)


def _rounds(stranger: Stranger, observer: CommandObserver, nodes: NodeProcesses,
            end: float) -> bool:
    attacks: tuple[Callable[[], None], ...] = (
        stranger.shout_commands, stranger.shout_estimates, stranger.shout_states,
        stranger.long_trajectory, stranger.long_list, stranger.pause_controller,
        stranger.pause_driver, stranger.second_driver, stranger.ask)
    rounds = 0
    while not rounds or time.monotonic() < end:
        rounds += 1
        for attack in attacks:
            before = observer.count
            attack()
            _goes_on(observer, nodes)
            found = observer.count - before
            print(f'{attack.__name__:<18}{"held" if not found else f"{found} faults"}', flush=True)
    for fault in observer.faults:
        print(fault)
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
