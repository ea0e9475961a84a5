# SPDX-License-Identifier: Apache-2.0
"""The controller's side of ``controller/joint_trajectory``: points that a motion follows."""

from __future__ import annotations

from trajectory_msgs.msg import JointTrajectory

from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.motion import Motion
from adaptive_blf_control.control.way import way_through
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.nodes.joint_trajectory import points_of
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['TrajectoryInput']

HEAD_START = 0.1  # s from the arrival of a message to the beginning of its motion
LATER = 4.0  # by which the head start grows where computing took longer


class TrajectoryInput:
    """Lets a motion follow the points of messages, each of them as a whole or not at all."""

    def __init__(self, node: DataNode[ControllerNodeSettings], motion: Motion) -> None:
        """Take the node, for its loop and its faults, and the motion."""
        self._node = node
        self._motion = motion

    def receive(self, message: JointTrajectory) -> None:
        """Follow the points instead of the reference so far.

        The path is computed beside the loop, for a moment that is still to come: where computing
        takes longer than that, for a later moment.
        """
        head_start, done = HEAD_START, False
        while not done and self._node.up:
            done = self._follow(message, head_start)
            head_start *= LATER

    def _follow(self, message: JointTrajectory, head_start: float) -> bool:
        """Try to follow the points from ``head_start`` [s] on; False where that has passed."""
        node, motion = self._node, self._motion
        with node.between_samples:
            plan = motion.plan(head_start)
        if plan is None:
            node.faults.drop('trajectory before the motion has begun', 'send it again then')
            return True
        try:
            way = way_through(points_of(message, motion.arm.joints), plan.controller, plan.t)
            with node.between_samples:
                return motion.follow(plan, way)
        except BlfError as error:
            node.faults.drop('unusable trajectory', str(error))
            return True
