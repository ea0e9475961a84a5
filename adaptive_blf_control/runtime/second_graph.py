# SPDX-License-Identifier: Apache-2.0
"""One graph per arm: a node does not start beside another one that does the same for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.topics import JOINT_STATES, THETA_HAT
from adaptive_blf_control.runtime.channels import DirectChannel
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.status_report import PERIOD

__all__ = ['joined_early', 'refuse_beside_another']

DIAGNOSTICS = '/diagnostics'
TIMEOUT = 4.0 * PERIOD  # s within which a running node publishes its diagnostics
POLL_PERIOD = 0.01  # s
# Kinds of which one at a time may speak on a topic, whatever its name. Two controllers may be
# there, one of them inactive: they are told apart where one is activated.
ONE_AT_A_TIME = {'arm_driver': JOINT_STATES, 'identifier': THETA_HAT}


@contextmanager
def joined_early() -> Iterator[float]:
    """Return a context in which this process is in its DDS domain; since when, monotonic [s].

    DDS then finds the others while a node is made, which loads and may compile the laws. Nodes of
    a context share its DDS participant, so one without a purpose of its own is enough.
    """
    node = Node(f'_starting_{os.getpid()}', use_global_arguments=False, enable_rosout=False,
                start_parameter_services=False)
    try:
        yield time.monotonic()
    finally:
        node.destroy_node()


def refuse_beside_another(node: DataNode) -> None:
    """Raise BlfError where a node of the same name and kind, or of the same task, is alive.

    The graph may still show one that was killed. So one that it shows is listened for, in its
    diagnostics; a node that is alone does not wait.
    """
    if node.lockstep or node.settings.discovery_time == 0.0 or not _has_company(node):
        return
    channel = DirectChannel(node, DiagnosticArray, DIAGNOSTICS, QoSProfile(depth=100))
    heard: list[str] = []

    give_up = time.monotonic() + TIMEOUT
    while not heard and node.up and time.monotonic() < give_up:
        for data, _ in channel.messages():
            heard.extend(_names_beside(node, data))
        node.wait_to_start(POLL_PERIOD)
    node.destroy_subscription(channel.subscription)
    if heard:
        raise BlfError(f'{heard[0]} is running already: one {node.kind} for an arm; end it, or '
                       'choose another namespace or ROS_DOMAIN_ID')


def _has_company(node: DataNode) -> bool:
    """Look for another until discovery has had its time, which making a node mostly takes."""
    give_up = node.joined_at + node.settings.discovery_time
    while not _may_have_company(node):
        if time.monotonic() >= give_up or not node.up:
            return False
        node.wait_to_start(POLL_PERIOD)
    return True


def _may_have_company(node: DataNode) -> bool:
    names = [f'{space.rstrip("/")}/{name}' for name, space in node.get_node_names_and_namespaces()]
    topic = ONE_AT_A_TIME.get(node.kind)
    return (names.count(node.get_fully_qualified_name()) > 1
            or topic is not None and node.count_publishers(topic) > 1)


def _names_beside(node: DataNode, data: bytes) -> list[str]:
    """Return the names of nodes of this kind and namespace that a diagnostic message is of."""
    space = node.get_namespace().rstrip('/')
    found = []
    for status in deserialize_message(data, DiagnosticArray).status:
        name, _, kind = status.name.partition(': ')
        same = name == node.get_name() or node.kind in ONE_AT_A_TIME
        if kind == node.kind and same and status.hardware_id == (space.strip('/') or 'arm'):
            found.append(f'{space}/{name}')
    return found
