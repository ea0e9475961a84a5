# SPDX-License-Identifier: Apache-2.0
"""Facts about messages with points: which of several counts."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')

from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from adaptive_blf_control.nodes.trajectory_input import TrajectoryInput
from patience import PATIENCE


class Slow(TrajectoryInput):
    """Checks the first points until it is told that it is done with them."""

    def __init__(self, node: object) -> None:
        super().__init__(node, None)
        self.first, self.last, self.go_on = threading.Event(), threading.Event(), threading.Event()
        self.received: list[float] = []

    def receive(self, message) -> None:
        self.received.append(message.points[0].positions[0])
        self.first.set()
        assert self.go_on.wait(PATIENCE)
        if len(self.received) > 1:
            self.last.set()


def points(position: float) -> bytes:
    return serialize_message(JointTrajectory(joint_names=['joint1'], points=[
        JointTrajectoryPoint(positions=[position])]))


def test_of_several_that_wait_the_last_one_counts() -> None:
    dropped: list[str] = []
    inputs = Slow(SimpleNamespace(up=True, faults=SimpleNamespace(
        drop=lambda what, why: dropped.append(what))))
    inputs.offer(points(1.0))
    assert inputs.first.wait(PATIENCE)
    inputs.offer(points(2.0))
    inputs.offer(points(3.0))
    assert dropped == ['superseded trajectory']
    inputs.go_on.set()
    assert inputs.last.wait(PATIENCE)
    assert inputs.received == [1.0, 3.0]
