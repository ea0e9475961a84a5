# SPDX-License-Identifier: Apache-2.0
"""A robot driver as others write it: plain rclpy, nothing of the package.

Joints in alphabetical order with a gripper among them, effort as it is at the sample, best effort
with a depth of one, commands that act half a period after the sample. Simulated time: the next
state is sent once the command for the last one has arrived, however long that takes.
"""

from __future__ import annotations

import threading

import numpy as np
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

__all__ = ['ForeignDriver']

NAMES = ['a_gripper', 'elbow', 'shoulder']
ELBOW, SHOULDER = 1, 2
P1, P2, P3 = 3.473, 0.196, 0.242  # kg·m²
FRICTION = np.array([5.3, 1.1])  # N·m·s/rad
SUBSTEPS = 4


def _rate(state: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Two links in a horizontal plane, shoulder first: d/dt of (q1, q2, q̇1, q̇2)."""
    _, q2, v1, v2 = state
    c, s = np.cos(q2), np.sin(q2)
    inertia = np.array([[P1 + 2.0 * P3 * c, P2 + P3 * c], [P2 + P3 * c, P2]])
    coriolis = np.array([-P3 * s * v2 * (2.0 * v1 + v2), P3 * s * v1 * v1])
    return np.concatenate([state[2:], np.linalg.solve(
        inertia, torque - coriolis - FRICTION * state[2:])])


class ForeignDriver(Node):
    """The driver; `run` moves the arm.

    Attributes:
        state: (q1, q2, q̇1, q̇2) of shoulder and elbow [rad, rad/s].
        sent: How many states were published.
    """

    def __init__(self, context: Context, period: float) -> None:
        """Make the node; ``period`` [s]."""
        super().__init__('some_robot', context=context, start_parameter_services=False)
        self.state, self.sent = np.array([0.0, 2.0, 0.5, 0.0]), 0
        self._period, self._acting, self._commands = period, np.zeros(2), 0
        self._command = np.zeros(2)
        self._arrived = threading.Condition()
        self._states = self.create_publisher(JointState, 'joint_states', QoSProfile(
            depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
        self.create_subscription(Float64MultiArray, 'effort_controller/commands', self._on_command,
                                 QoSProfile(depth=1))

    def _on_command(self, message: Float64MultiArray) -> None:
        with self._arrived:
            self._command, self._commands = np.array(message.data), self._commands + 1
            self._arrived.notify()

    def send(self) -> None:
        """Publish the present state."""
        self.sent += 1
        nanoseconds = round(self.sent * self._period * 1e9)
        message = JointState(name=NAMES)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, 10**9)
        position, velocity, effort = np.full((3, len(NAMES)), 0.01)
        for joint, place in enumerate((SHOULDER, ELBOW)):
            position[place], velocity[place] = self.state[joint], self.state[2 + joint]
            effort[place] = self._acting[joint]
        message.position, message.velocity, message.effort = (
            values.tolist() for values in (position, velocity, effort))
        self._states.publish(message)

    def step(self, patience: float) -> bool:
        """Publish a state, wait for the command that answers it, and move on.

        Without one it returns False, and the next step publishes the same state again.
        """
        with self._arrived:
            before = self._commands
            self.send()
            if not self._arrived.wait_for(lambda: self._commands > before, patience):
                self.sent -= 1
                return False
            command = self._command
        self._move(0.5 * self._period)
        self._acting = command
        self._move(0.5 * self._period)
        return True

    def _move(self, span: float) -> None:
        for _ in range(SUBSTEPS):
            h, x, u = span / SUBSTEPS, self.state, self._acting
            k1 = _rate(x, u)
            k2 = _rate(x + 0.5 * h * k1, u)
            k3 = _rate(x + 0.5 * h * k2, u)
            self.state = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + _rate(x + h * k3, u))
