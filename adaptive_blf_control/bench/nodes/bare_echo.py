# SPDX-License-Identifier: Apache-2.0
"""Three plain nodes without any control work: the rate that rclpy's default executor reaches.

``driver`` publishes a JointState from a timer, ``echo`` answers each with a Float64MultiArray,
``listener`` hears the states and publishes a vector as an estimator would. Typed messages, a
callback each, ``rclpy.spin``: what the nodes of this package are compared with.
Run by ``bench rates``, as ``python -m adaptive_blf_control.bench.nodes.bare_echo NODE``.
"""

from __future__ import annotations

import argparse
from array import array
import sys
import time

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import try_shutdown
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.bench.nodes.plain_options import plain_options
from adaptive_blf_control.messages.topics import COMMANDS, JOINT_STATES, THETA_HAT

__all__ = ['NODES', 'main']

QUEUE_DEPTH = 10


class _DoneError(Exception):
    """The driver has published for as long as it was asked to."""


class Driver(Node):
    """Timer to states; commands end the round trip.

    Attributes:
        served: When each state was published, monotonic [ns].
        trips: How long its answer took, 0 where none came [ns].
    """

    def __init__(self, options: argparse.Namespace) -> None:
        """Make the node; the timer starts with :meth:`begin`."""
        super().__init__('bare_driver')
        self._joints = [f'joint{k + 1}' for k in range(options.joints)]
        self._rest = [0.0] * (options.joints - 1)
        self.served, self.trips = array('q'), array('q')
        self._options = options
        self._states = self.create_publisher(JointState, JOINT_STATES, QUEUE_DEPTH)
        self.create_subscription(Float64MultiArray, COMMANDS, self._on_command, QUEUE_DEPTH)

    def begin(self) -> None:
        """Wait for the other two, then start the timer."""
        while self._states.get_subscription_count() < 2 or not self.count_publishers(COMMANDS):
            rclpy.spin_once(self, timeout_sec=0.02)
        print('motion begins', flush=True)
        self.create_timer(1.0 / self._options.rate, self._on_timer)

    def _on_timer(self) -> None:
        now = time.monotonic_ns()
        if self.served and now - self.served[0] > self._options.seconds * 1e9:
            raise _DoneError
        state = JointState()
        state.header.stamp = self.get_clock().now().to_msg()
        state.name = self._joints
        state.position = [float(len(self.served)), *self._rest]
        state.velocity = [0.0, *self._rest]
        state.effort = [0.0, *self._rest]
        self.trips.append(0)
        self.served.append(time.monotonic_ns())
        self._states.publish(state)

    def _on_command(self, command: Float64MultiArray) -> None:
        number = int(command.data[0])
        self.trips[number] = time.monotonic_ns() - self.served[number]


class Echo(Node):
    """Answers each state with a command that holds its positions."""

    def __init__(self, _: argparse.Namespace) -> None:
        """Make the node."""
        super().__init__('bare_echo')
        self.served, self.trips = array('q'), array('q')
        self._commands = self.create_publisher(Float64MultiArray, COMMANDS, QUEUE_DEPTH)
        self.create_subscription(JointState, JOINT_STATES, self._on_state, QUEUE_DEPTH)

    def _on_state(self, state: JointState) -> None:
        self.served.append(time.monotonic_ns())
        self._commands.publish(Float64MultiArray(data=state.position))


class Listener(Node):
    """Hears each state and publishes a vector with its stamp."""

    def __init__(self, options: argparse.Namespace) -> None:
        """Make the node."""
        super().__init__('bare_listener')
        self._names = [f'p{k + 1}' for k in range(options.parameters)]
        self._rest = [0.0] * (options.parameters - 1)
        self.served, self.trips = array('q'), array('q')
        self._estimates = self.create_publisher(JointState, THETA_HAT, QUEUE_DEPTH)
        self.create_subscription(JointState, JOINT_STATES, self._on_state, QUEUE_DEPTH)

    def _on_state(self, state: JointState) -> None:
        self.served.append(time.monotonic_ns())
        self._estimates.publish(JointState(header=state.header, name=self._names,
                                           position=[state.position[0], *self._rest]))


NODES: dict[str, type[Driver] | type[Echo] | type[Listener]] = {
    'listener': Listener, 'echo': Echo, 'driver': Driver}


def main(args: list[str] | None = None) -> int:
    """Run one node until the driver's time is over, or an interrupt; then save its times."""
    options = plain_options(args, 'bare_echo', __doc__, NODES)
    rclpy.init(args=[])
    node = NODES[options.node](options)
    try:
        if isinstance(node, Driver):
            node.begin()
        rclpy.spin(node)
    except (_DoneError, KeyboardInterrupt, ExternalShutdownException):
        pass
    np.savez(options.output, served=np.array(node.served), trips=np.array(node.trips))
    try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
