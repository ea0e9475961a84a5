# SPDX-License-Identifier: Apache-2.0
"""The arm of a node: from its parameters, the URDF from a file or from a topic."""

from __future__ import annotations

import time

from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.errors import ArmError
from adaptive_blf_control.nodes.data_node import DataNode
from adaptive_blf_control.parameters.build import build_arm

__all__ = ['arm_of']

PATIENCE = 10.0  # s


def arm_of(node: DataNode) -> Arm:
    """Build the arm a node's parameters describe.

    With ``urdf: topic:NAME`` the text is received from that (transient local) topic; ArmError
    where none arrives within ``PATIENCE``.
    """
    source = str(node.values['urdf'])
    if node.values['arm'] != 'urdf' or not source.startswith('topic:'):
        return build_arm(node.values)
    topic = source.removeprefix('topic:')
    received: list[str] = []
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    subscription = node.create_subscription(String, topic,
                                            lambda message: received.append(message.data), qos)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    give_up = time.monotonic() + PATIENCE
    while not received and time.monotonic() < give_up and node.context.ok():
        executor.spin_once(timeout_sec=0.1)
    executor.remove_node(node)
    executor.shutdown()
    node.destroy_subscription(subscription)
    if not received:
        raise ArmError(f'no URDF arrived on topic {topic!r} within {PATIENCE:g} s')
    return build_arm(node.values, received[0])
