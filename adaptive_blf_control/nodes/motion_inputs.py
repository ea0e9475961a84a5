# SPDX-License-Identifier: Apache-2.0
"""What a controller hears besides states and estimates: points to follow, obstacles, bounds."""

from __future__ import annotations

from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.motion import Motion
from adaptive_blf_control.messages.topics import JOINT_TRAJECTORY, OBSTACLES, PARAMETER_SET
from adaptive_blf_control.nodes.handover import Handover
from adaptive_blf_control.nodes.obstacle_input import ObstacleInput
from adaptive_blf_control.nodes.set_input import SetInput
from adaptive_blf_control.nodes.trajectory_input import TrajectoryInput
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['MotionInputs']

TRAJECTORY_QUEUE_DEPTH = 10
OBSTACLE_QUEUE_DEPTH = 1  # only where they are now matters


class MotionInputs:
    """The topics of one configuration of a controller.

    Attributes:
        trajectories: Takes the points of a planner.
        sets: Takes what the identifier is sure of.
    """

    def __init__(self, node: DataNode[ControllerNodeSettings], motion: Motion,
                 handover: Handover | None) -> None:
        """Listen.

        Args:
            node: The controller.
            motion: That is told what was heard.
            handover: Brings the bounds where the identifier is in the same process.

        Raises:
            ParameterError: the safety filter is to learn, but nothing would tell it anything.
        """
        self._node = node
        self.sets = SetInput(node, motion.arm, motion, handover)
        self.trajectories = TrajectoryInput(node, motion)
        self._served: list[Subscription] = [
            node.create_subscription(JointTrajectory, JOINT_TRAJECTORY, self.trajectories.offer,
                                     TRAJECTORY_QUEUE_DEPTH, raw=True),
            node.create_subscription(MarkerArray, OBSTACLES, ObstacleInput(node, motion).receive,
                                     OBSTACLE_QUEUE_DEPTH, raw=True)]
        self._polled: list[Subscription] = [node.topics.subscribe(
            JointState, PARAMETER_SET, self.sets.receive, wake=False, newest_only=True,
        )] if self.sets.wanted and handover is None else []

    def close(self) -> None:
        """Destroy the topics."""
        for subscription in self._served:
            self._node.destroy_subscription(subscription)
        for subscription in self._polled:
            self._node.topics.unsubscribe(subscription)
