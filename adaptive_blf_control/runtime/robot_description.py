# SPDX-License-Identifier: Apache-2.0
"""The arm of a node from its parameters, with the URDF from a file or from a topic."""

from __future__ import annotations

import time

from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.settings import ArmSettings
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.errors import ArmError, BagError
from adaptive_blf_control.messages.cdr import decode_string
from adaptive_blf_control.runtime.channels import DirectChannel
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['arm_from', 'arm_of', 'is_topic']

TOPIC = 'topic:'  # what the parameter urdf begins with where a topic brings the text
URDF_TIMEOUT = 10.0  # s
POLL_PERIOD = 0.01  # s


def is_topic(settings: ArmSettings) -> bool:
    """Return whether the URDF comes from a topic."""
    return settings.arm == 'urdf' and settings.urdf.startswith(TOPIC)


def arm_of(node: DataNode, settings: ArmSettings) -> Arm:
    """Build the arm that a node's settings describe.

    With ``urdf: topic:NAME`` the text is received from that (transient local) topic; ArmError
    where none arrives within ``URDF_TIMEOUT``.
    """
    if not is_topic(settings):
        return build_arm(settings)
    topic = settings.urdf.removeprefix(TOPIC)
    received: bytes | None = None
    qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    # Polled here: a lifecycle request that configures the node occupies its executor.
    channel = DirectChannel(node, String, topic, qos)
    give_up = time.monotonic() + URDF_TIMEOUT
    while time.monotonic() < give_up and node.up:
        if messages := channel.messages():
            received = messages[-1][0]
            break
        time.sleep(POLL_PERIOD)
    node.destroy_subscription(channel.subscription)
    if received is None and not node.up:
        raise ArmError(f'asked to stop before a URDF arrived on topic {topic!r}')
    if received is None:
        raise ArmError(f'no URDF arrived on topic {topic!r} within {URDF_TIMEOUT:g} s')
    return arm_from(received, topic, settings)


def arm_from(data: bytes, topic: str, settings: ArmSettings) -> Arm:
    """Build the arm from a std_msgs/String as CDR; ArmError where it holds no usable URDF."""
    try:
        text = decode_string(data)
    except BagError as error:
        raise ArmError(f'topic {topic!r}: {error}') from None
    return build_arm(settings, text)
