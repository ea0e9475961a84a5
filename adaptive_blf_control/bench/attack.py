# SPDX-License-Identifier: Apache-2.0
"""``attack``: strangers attack the four processes while an observer judges the commands.

Each round makes every attack once; between two of them the motion has to go on.

Exit status: 0 nothing was broken, 1 something was, 2 it could not be run.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from contextlib import suppress
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import threading
import time

from lifecycle_msgs.srv import GetState
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.bench.command_observer import CommandObserver
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.topics import (
    COMMANDS,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    THETA_HAT,
)
from adaptive_blf_control.runtime.processes import NodeProcesses, scenario

__all__ = ['main']

LIMIT, RATE, TIMEOUT, TELLS = 200.0, 5000.0, 0.1, 77.0
LENGTH = 3.0  # s of one attack
RECOVERY = 60.0  # s within which the motion has to go on
STEP = 1e-3  # s between the messages of a stranger
SETTINGS = {'controller': [f'torque_limit:=[{LIMIT}]', f'torque_rate_limit:=[{RATE}]',
                           # A stalled machine must not end the attack: the motion may begin
                           # again wherever the arm has coasted.
                           'safety.lower:=[-50.0]', 'safety.upper:=[50.0]'],
            'recorder': [], 'identifier': [],
            # Braked while nobody commands, it does not coast out of its safety set.
            'arm_driver': ['rate:=250.0', 'timeout_action:=damping']}


class _Stranger(Node):
    """A node that attacks, and hears what the observer judges."""

    def __init__(self, observer: CommandObserver, nodes: NodeProcesses) -> None:
        super().__init__('stranger', start_parameter_services=False)
        self.nodes = nodes
        self.create_subscription(Float64MultiArray, COMMANDS, lambda data, info: observer.command(
            data, info['source_timestamp']), 1000, raw=True)  # type: ignore[arg-type,misc]
        self.create_subscription(JointState, JOINT_STATES, observer.state, 1000, raw=True)

    def shout_commands(self) -> None:
        """A second publisher of commands, four times as fast."""
        self._shout(Float64MultiArray, COMMANDS, Float64MultiArray(data=[TELLS, TELLS]))

    def shout_estimates(self) -> None:
        """A second identifier, within the limits of an estimate."""
        names = list(TwoLinkArm().parameters)
        self._shout(JointState, THETA_HAT, JointState(name=names, position=[900.0] * len(names)))

    def shout_states(self) -> None:
        """A second driver, 40 ms ahead."""
        message = JointState(name=['joint1', 'joint2'], position=[0.4, 0.4], velocity=[0.0, 0.0])
        message.header.frame_id = 'base_link'
        self._shout(JointState, JOINT_STATES, message)

    def long_trajectory(self) -> None:
        """More points than any motion has."""
        message = JointTrajectory(joint_names=['joint1', 'joint2'])
        message.points = [JointTrajectoryPoint(positions=[0.0, 0.0])] * 100_000
        self._shout(JointTrajectory, JOINT_TRAJECTORY, message, once=True)

    def long_list(self) -> None:
        """A million gains."""
        client = AsyncParameterClient(self, 'controller')
        if client.wait_for_services(10.0):
            client.set_parameters([Parameter('k2', value=[1.0] * 10**6)])
        time.sleep(LENGTH)

    def pause_controller(self) -> None:
        """The controller is stopped and goes on, for 0.15 s and for 1 s."""
        self._pause('controller')

    def pause_driver(self) -> None:
        """The driver likewise."""
        self._pause('arm_driver')

    def second_driver(self) -> None:
        """Another driver for the same arm does not start."""
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(self.nodes.domain)}
        second = subprocess.run([sys.executable, '-m', 'adaptive_blf_control', 'arm_driver'],
                                env=environment, capture_output=True, timeout=60.0, check=False)
        if second.returncode != 2:
            raise BlfError(f'a second driver ended with {second.returncode}: expected 2')

    def ask(self) -> None:
        """Ask for the state of the controller, 300 times."""
        client = self.create_client(GetState, 'controller/get_state')
        for _ in range(300):
            client.call_async(GetState.Request())
            time.sleep(LENGTH / 300)

    def _pause(self, name: str) -> None:
        for seconds in (0.15, 1.0):
            self.nodes.processes[name].send_signal(signal.SIGSTOP)
            time.sleep(seconds)
            self.nodes.processes[name].send_signal(signal.SIGCONT)
            time.sleep(1.0)

    def _shout(self, kind: type, topic: str, message: object, *, once: bool = False) -> None:
        publisher: Publisher = self.create_publisher(kind, topic, 10)
        end = time.monotonic() + LENGTH
        while time.monotonic() < end:
            if isinstance(message, JointState):
                stamp = divmod(time.time_ns() + 40_000_000, 10**9)
                message.header.stamp.sec, message.header.stamp.nanosec = stamp
            if publisher.get_subscription_count():
                publisher.publish(message)
                if once:
                    break
            time.sleep(STEP)
        self.destroy_publisher(publisher)


def main(args: Sequence[str] | None = None) -> int:
    """Attack for a while and print the verdict of each attack."""
    parser = argparse.ArgumentParser(prog='attack', description=__doc__.partition('\n')[0])
    parser.add_argument('--minutes', type=float, default=10.0, help='how long (default 10)')
    options = parser.parse_args(args)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    observer = CommandObserver(LIMIT, RATE, TIMEOUT, TELLS)
    with tempfile.TemporaryDirectory(prefix='attack_') as folder, NodeProcesses(
            scenario('two_link.yaml').resolve(), 1e6, Path(folder), SETTINGS) as nodes:
        rclpy.init(domain_id=nodes.domain, args=[])
        stranger = _Stranger(observer, nodes)
        executor = SingleThreadedExecutor()
        executor.add_node(stranger)
        threading.Thread(target=_spin, args=(executor,), daemon=True).start()
        try:
            _goes_on(observer, nodes)
            broken = _rounds(stranger, observer, nodes, time.monotonic() + 60.0 * options.minutes)
        except BlfError as error:
            print(error, file=sys.stderr)
            broken = True
        rclpy.shutdown()
    print('broken' if broken else f'nothing was broken in {observer.commands} commands')
    return int(broken)


def _spin(executor: SingleThreadedExecutor) -> None:
    with suppress(ExternalShutdownException):
        executor.spin()


def _rounds(stranger: _Stranger, observer: CommandObserver, nodes: NodeProcesses,
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
