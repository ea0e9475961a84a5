# SPDX-License-Identifier: Apache-2.0
"""A node that does to a running graph what accidents and strangers do; for ``attack``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
import os
import signal
import subprocess
from subprocess import Popen
import sys
import tempfile
import threading
import time

from lifecycle_msgs.srv import GetState
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.topics import (
    COMMANDS,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    THETA_HAT,
)

__all__ = ['TELLS', 'Stranger']

TELLS = 77.0  # N·m that only strangers send
LENGTH = 3.0  # s of one attack
STEP = 1e-3  # s between the messages of a stranger
START_TIMEOUT = 90.0  # s within which a second node has to have ended


class Stranger(Node):
    """A node that attacks, and hears what the observer judges.

    Attributes:
        asked: Requests that were made of the controller's lifecycle.
        answered: How many of them were answered.
    """

    def __init__(self, domain: int, processes: Mapping[str, Popen[bytes]],
                 command: Callable[[bytes, int], None], state: Callable[[bytes], None]) -> None:
        """Begin to hear.

        Args:
            domain: That of the nodes.
            processes: Of the nodes, by name.
            command: Called with each command as CDR and when it was published [ns].
            state: Called with each joint state as CDR.
        """
        self._own_context = Context()
        self._own_context.init(domain_id=domain)
        super().__init__('stranger', context=self._own_context, start_parameter_services=False)
        self._domain, self._processes = domain, processes
        self._parameter_client = AsyncParameterClient(self, 'controller')
        self.asked = self.answered = 0

        def hear(data: bytes, info: dict[str, int]) -> None:
            command(data, info['source_timestamp'])

        # rclpy hands over the info to callbacks with two arguments; its types know one.
        callback: Callable[..., None] = hear
        self.create_subscription(Float64MultiArray, COMMANDS, callback, 1000, raw=True)
        self.create_subscription(JointState, JOINT_STATES, state, 1000, raw=True)
        self._executor = SingleThreadedExecutor(context=self._own_context)
        self._executor.add_node(self)
        threading.Thread(target=self._spin, daemon=True).start()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def close(self) -> None:
        """End hearing."""
        self._own_context.try_shutdown()

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

    def long_lists(self) -> None:
        """A million gains, and a hundred thousand sinusoids."""
        client = self._parameter_client
        if client.wait_for_services(10.0):
            client.set_parameters([Parameter('k2', value=[1.0] * 10**6)])
            client.set_parameters([Parameter(f'reference.joint1.{name}', value=[1.0] * 10**5)
                                   for name in ('amplitude', 'frequency', 'phase')])
        time.sleep(LENGTH)

    def pause_controller(self) -> None:
        """The controller is stopped and goes on, for 0.15 s and for 1 s."""
        self._pause('controller')

    def pause_driver(self) -> None:
        """The driver likewise."""
        self._pause('arm_driver')

    def second_graph(self) -> None:
        """The whole graph is started a second time: none of its nodes may stay."""
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(self._domain)}
        with ExitStack() as stack:
            # Its recorder may begin a bag before it is refused.
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix='second_graph_'))
            bag = ['--ros-args', '-p', f'recorder:bag:={folder}/bag']
            seconds = {name: stack.enter_context(subprocess.Popen(
                [sys.executable, '-m', 'adaptive_blf_control', name,
                 *(bag if name == 'recorder' else ())], env=environment,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
                for name in self._processes}
            try:
                ended = {name: second.wait(START_TIMEOUT) for name, second in seconds.items()}
            except subprocess.TimeoutExpired:
                stay = ', '.join(name for name, second in seconds.items()
                                 if second.poll() is None)
                raise BlfError(f'{stay} of a second graph stays beside the first') from None
            finally:
                for second in seconds.values():
                    second.kill()
        if wrong := {name: status for name, status in ended.items() if status != 2}:
            raise BlfError(f'of a second graph ended: {wrong}: expected 2 for each')

    def ask(self) -> None:
        """Ask for the state of the controller, by three clients 50 times a second each."""
        clients = [self.create_client(GetState, 'controller/get_state') for _ in range(3)]
        answers = []
        for _ in range(round(50 * LENGTH)):
            answers += [client.call_async(GetState.Request()) for client in clients]
            time.sleep(0.02)
        give_up = time.monotonic() + LENGTH
        while time.monotonic() < give_up and not all(answer.done() for answer in answers):
            time.sleep(0.02)
        self.asked += len(answers)
        self.answered += sum(answer.done() for answer in answers)
        for client in clients:
            self.destroy_client(client)

    def _pause(self, name: str) -> None:
        for seconds in (0.15, 1.0):
            self._processes[name].send_signal(signal.SIGSTOP)
            time.sleep(seconds)
            self._processes[name].send_signal(signal.SIGCONT)
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
