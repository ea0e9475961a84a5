# SPDX-License-Identifier: Apache-2.0
"""Three nodes that only wait, take and publish CDR bytes: the round trip that rclpy leaves.

``driver`` sends joint states on a grid, ``echo`` answers each with a command, ``listener`` takes
both, as a recorder does. They wait and publish as the nodes of this package do
(``runtime/data_topics.py``), decode nothing but the stamp, and have no services of their own, no
diagnostics and no second thread. What the nodes of this package need beyond that is their own.
Run by ``bench rates``, as ``python -m adaptive_blf_control.bench.nodes.raw_echo NODE``.
"""

from __future__ import annotations

import argparse
from array import array
from collections.abc import Callable
import gc
import signal
import sys
import time
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.bench.nodes.plain_options import plain_options
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec
from adaptive_blf_control.messages.command import answered_stamp
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.stamp import stamp_of
from adaptive_blf_control.messages.topics import COMMANDS, JOINT_STATES
from adaptive_blf_control.runtime.channels import DirectChannel, LONGEST_WAIT
from adaptive_blf_control.runtime.data_topics import QUEUE_DEPTH
from adaptive_blf_control.runtime.rclpy_internals import DirectWait
from adaptive_blf_control.runtime.stop_flag import StopFlag
from adaptive_blf_control.simulation.state_grid import StateGrid

__all__ = ['NODES', 'main']

LABEL = '/raw_echo#00000000'  # of the commands, as long as that of a controller


class _Loop:
    """What the three share. A state's stamp is its number plus 1; times are monotonic [ns]."""

    def __init__(self, name: str, options: argparse.Namespace, stop: StopFlag) -> None:
        self.node = Node(name, start_parameter_services=False, enable_rosout=False)
        self.options, self.stop = options, stop
        self.channels: list[tuple[DirectChannel, Callable[[bytes], None]]] = []
        self.times: dict[str, array[int]] = {'served': array('q')}

    def hear(self, kind: type, topic: str, handle: Callable[[bytes], None]) -> None:
        """Give the bytes of each message of a topic to ``handle``."""
        self.channels.append((
            DirectChannel(self.node, kind, topic, QoSProfile(depth=QUEUE_DEPTH)), handle))

    def ready(self) -> DirectWait:
        """Return the wait for all that is heard."""
        return DirectWait([channel.subscription for channel, _ in self.channels],
                          self.node.context)

    def take(self) -> None:
        """Handle what has arrived."""
        for channel, handle in self.channels:
            for data, _ in channel.messages():
                handle(data)

    def run(self) -> None:
        """Take until asked to stop."""
        wait = self.ready()
        while not self.stop.is_set():
            wait.wait(LONGEST_WAIT)
            self.take()


class Driver(_Loop):
    """Sends a state each period. Keeps when it was due, when it went out and came back."""

    def __init__(self, options: argparse.Namespace, stop: StopFlag) -> None:
        """Make the node; the grid is laid by :meth:`run`."""
        super().__init__('raw_driver', options, stop)
        joints = options.joints
        self._codec = JointStateCodec([f'joint{k + 1}' for k in range(joints)], 'base_link')
        self._values = [np.zeros(joints)] * 3
        self._states = self.node.create_publisher(JointState, JOINT_STATES, QUEUE_DEPTH)
        self.times.update({name: array('q') for name in ('trips', 'due', 'out')})
        self.hear(Float64MultiArray, COMMANDS, self._on_command)

    def run(self) -> None:
        """Wait for the other two, then send for as long as was asked for."""
        while not self.stop.is_set() and (self._states.get_subscription_count() < 2
                                          or not self.node.count_publishers(COMMANDS)):
            self.stop.wait(0.02)
        print('motion begins', flush=True)
        wait, grid, begin = self.ready(), StateGrid(self.options.rate), time.monotonic_ns()
        grid.begin(begin)
        while not self.stop.is_set():
            wait.wait(grid.left(time.monotonic_ns()))
            self.take()
            due = grid.take(time.monotonic_ns())
            if due is not None:
                self._send(due)
                if due - begin > self.options.seconds * 1e9:
                    break

    def _send(self, due: int) -> None:
        times = self.times
        times['due'].append(due)
        times['trips'].append(0)
        times['served'].append(time.monotonic_ns())
        self._states.publish(self._codec.encode(len(times['served']), *self._values))
        times['out'].append(time.monotonic_ns())

    def _on_command(self, data: bytes) -> None:
        number = (answered_stamp(data) or 0) - 1
        if number >= 0:
            self.times['trips'][number] = time.monotonic_ns() - self.times['served'][number]


class Echo(_Loop):
    """Answers each state. Keeps which it was, when it was taken and when the answer was out."""

    def __init__(self, options: argparse.Namespace, stop: StopFlag) -> None:
        """Make the node."""
        super().__init__('raw_echo', options, stop)
        self._codec, self._torque = Float64MultiArrayCodec(options.joints, LABEL), np.zeros(
            options.joints)
        self._commands = self.node.create_publisher(Float64MultiArray, COMMANDS, QUEUE_DEPTH)
        self.times.update({name: array('q') for name in ('stamp', 'sent', 'out')})
        self.hear(JointState, JOINT_STATES, self._on_state)

    def _on_state(self, data: bytes) -> None:
        self.times['served'].append(time.monotonic_ns())
        stamp = stamp_of(data) or 0
        self.times['stamp'].append(stamp)
        command = self._codec.encode(self._torque, stamp)
        self.times['sent'].append(time.monotonic_ns())
        self._commands.publish(command)
        self.times['out'].append(time.monotonic_ns())


class Listener(_Loop):
    """Takes states and commands."""

    def __init__(self, options: argparse.Namespace, stop: StopFlag) -> None:
        """Make the node."""
        super().__init__('raw_listener', options, stop)
        self.hear(JointState, JOINT_STATES,
                  lambda _: self.times['served'].append(time.monotonic_ns()))
        self.hear(Float64MultiArray, COMMANDS, lambda _: None)


NODES: dict[str, type[Driver] | type[Echo] | type[Listener]] = {
    'listener': Listener, 'echo': Echo, 'driver': Driver}


def main(args: list[str] | None = None) -> int:
    """Run one node until the driver's time is over, or an interrupt; then save its times."""
    options = plain_options(args, 'raw_echo', __doc__, NODES)
    stop = StopFlag()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    node = NODES[options.node](options, stop)
    gc.collect()
    gc.freeze()
    node.run()
    kept: dict[str, Any] = {name: np.array(times) for name, times in node.times.items()}
    np.savez(options.output, **kept)
    try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
