# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes on this host, in a DDS domain of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import TypeVar

from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.domain import own_domain

__all__ = ['COMPOSED', 'FAST_DISCOVERY', 'NODES', 'NodeProcesses', 'Processes', 'nodes_in']

NODES = ('recorder', 'identifier', 'controller', 'arm_driver')
COMPOSED = ('recorder', 'arm_control', 'arm_driver')  # the same nodes in three processes
Self = TypeVar('Self', bound='Processes')
END_TIMEOUT = 15.0  # s for an interrupted node to end
MOTION_TIMEOUT = 90.0  # s until the arm has to move: the first run compiles the laws

# Announce endpoints often at the start, so that four nodes meet within half a second.
FAST_DISCOVERY = """<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com">
  <participant profile_name="local" is_default_profile="true">
    <rtps><builtin><discovery_config>
      <leaseAnnouncement><sec>0</sec><nanosec>200000000</nanosec></leaseAnnouncement>
      <initialAnnouncements>
        <count>20</count><period><sec>0</sec><nanosec>200000000</nanosec></period>
      </initialAnnouncements>
    </discovery_config></builtin></rtps>
  </participant>
</profiles>
"""


def _wanted_domain() -> int | None:
    """Return ROS_DOMAIN_ID, None where it is not set; BlfError where it is not a domain id."""
    text = os.environ.get('ROS_DOMAIN_ID', '')
    if not text:
        return None
    if not text.isdecimal() or int(text) > 232:
        raise BlfError(f'ROS_DOMAIN_ID is {text!r}: expected 0 to 232')
    return int(text)


def _leave(number: int, _: object) -> None:
    raise SystemExit(128 + number)


class Processes:
    """Some processes; leaving the context ends all of them.

    The last one ends by itself when its work is done, the others when they are interrupted.

    Attributes:
        domain: Their DDS domain: ROS_DOMAIN_ID, or another if that is not set or another run
            uses it.
        processes: The processes by name, in the order of their start.
        started: When they were started, monotonic [s].
    """

    def __init__(self, commands: Mapping[str, Sequence[str]], output: Path) -> None:
        """Start them.

        Args:
            commands: Arguments for this Python by the name of the process.
            output: Folder for what they print; absolute.

        Raises:
            BlfError: no DDS domain is free.
        """
        self._stack = ExitStack()
        wanted = _wanted_domain()
        self.domain = self._stack.enter_context(own_domain(wanted))
        if self.domain != wanted:  # a free one, in which nobody else is
            commands = {name: self._alone(command) for name, command in commands.items()}
        environment = self._environment(output)
        self.started = time.monotonic()
        # In append mode: reading a log moves the position that its process shares.
        self.logs = {name: (output / f'{name}.txt').open('a+b') for name in commands}
        self.processes = {
            name: subprocess.Popen([sys.executable, *command], env=environment,
                                   stdout=self.logs[name], stderr=subprocess.STDOUT)
            for name, command in commands.items()}

    def _alone(self, command: Sequence[str]) -> Sequence[str]:
        """Return the command of a process that is the only one of its kind in the domain."""
        return command

    def _environment(self, output: Path) -> dict[str, str]:
        """Keep the nodes on this host, in their domain, with quick discovery."""
        profile = output / 'fast_discovery.xml'
        profile.write_text(FAST_DISCOVERY, encoding='utf-8')
        return {**os.environ,
                'ROS_DOMAIN_ID': str(self.domain),
                'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile),
                'ROS_LOG_DIR': str(output / 'log')}

    def __enter__(self: Self) -> Self:
        """Return the running processes; from here on SIGTERM ends them, too."""
        self._before = signal.signal(signal.SIGTERM, _leave)
        return self

    def __exit__(self, *_: object) -> None:
        """End what still runs, in reverse order of the start, and release the domain."""
        signal.signal(signal.SIGTERM, self._before)
        leader = list(self.processes.values())[-1]
        if leader.poll() is None:
            leader.send_signal(signal.SIGINT)
        self.end()
        for process in self.processes.values():
            if process.poll() is None:
                process.kill()
                process.wait()
        for log in self.logs.values():
            log.close()
        self._stack.close()

    def failed(self) -> list[str]:
        """Return the names of the processes that ended with an error."""
        return [name for name, process in self.processes.items() if process.poll()]

    def text(self, name: str) -> str:
        """Return what a process has printed."""
        self.logs[name].seek(0)
        return self.logs[name].read().decode(errors='replace')

    def end(self) -> list[str]:
        """Interrupt all but the last, in reverse order; return those that ended with an error."""
        for process in list(self.processes.values())[-2::-1]:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                try:
                    process.wait(END_TIMEOUT)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
        return [name for name, process in self.processes.items() if process.returncode != 0]


def nodes_in(process: str) -> tuple[str, ...]:
    """Return the names of the nodes in a process of this name."""
    return ('identifier', 'controller') if process == 'arm_control' else (process,)


class NodeProcesses(Processes):
    """The four nodes; the driver ends by itself, the recorder is interrupted last.

    Attributes:
        herald: The process that prints when the motion begins.
    """

    def __init__(self, config: Path, duration: float, output: Path,
                 settings: Mapping[str, Sequence[str]] | None = None, *,
                 composed: bool = False) -> None:
        """Start recorder, identifier, controller and driver.

        Args:
            config: Parameter file for all of them.
            duration: How long the arm moves [s].
            output: Folder for the bag and the nodes' output; absolute.
            settings: More parameters by node, each as ``NAME:=VALUE``.
            composed: Run identifier and controller in one process, ``arm_control``.

        Raises:
            BlfError: no DDS domain is free.
        """
        processes = COMPOSED if composed else NODES
        self.herald = 'arm_control' if composed else 'controller'
        extra = {'recorder': [f'bag:={output / "bag"}'],
                 'identifier': [f'estimate_file:={output / "theta_hat.yaml"}'],
                 'arm_driver': [f'duration:={duration}',
                                f'wait_for_subscribers:={len(processes) - 1}']}
        commands: dict[str, list[str]] = {}
        for process in processes:
            commands[process] = ['-m', 'adaptive_blf_control', process, '--ros-args',
                                 '--params-file', str(config)]
            for name in nodes_in(process):
                for setting in [*extra.get(name, []), *(settings or {}).get(name, [])]:
                    # With the node's name: a plain -p goes to /**, which its section beats.
                    commands[process] += ['-p', f'{name}:{setting}']
        self.duration = duration
        super().__init__(commands, output)

    def _alone(self, command: Sequence[str]) -> Sequence[str]:
        own = [word for name in nodes_in(command[2])
               for word in ('-p', f'{name}:discovery_time:=0.0')]
        # Before what is asked for, which then counts, and behind the file: ROS sorts the names of
        # nodes by first appearance, and a section of the file would beat every later -p.
        begin = command.index('--params-file') + 2
        return [*command[:begin], *own, *command[begin:]]

    def until_done(self, look: Callable[[float | None], None], period: float) -> list[str]:
        """Wait until the driver has ended; return the nodes that failed meanwhile.

        Args:
            look: Called with the time for which the arm has moved [s], None before it moves.
            period: Longest time between two calls [s].
        """
        driver = self.processes['arm_driver']
        begin = time.monotonic()
        moving: float | None = None
        while driver.poll() is None:
            bad, now = self.failed(), time.monotonic()
            if bad or now - begin > MOTION_TIMEOUT + 1.5 * self.duration:
                return bad or ['arm_driver']
            if moving is None and 'motion begins' in self.text(self.herald):
                moving = now
            look(None if moving is None else now - moving)
            with suppress(subprocess.TimeoutExpired):
                driver.wait(period)
        return self.failed()
