# SPDX-License-Identifier: Apache-2.0
"""The controller's side of ``controller/joint_trajectory``: points that a motion follows."""

from __future__ import annotations

import threading

from trajectory_msgs.msg import JointTrajectory

from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.motion import Motion
from adaptive_blf_control.control.way import way_through
from adaptive_blf_control.errors import BagError, BlfError
from adaptive_blf_control.messages.trajectory_reader import read_trajectory, Trajectory
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
        self._lock = threading.Lock()
        self._waiting: bytes | None = None
        self._works = False

    @property
    def busy(self) -> bool:
        """Whether points are being checked."""
        return self._works

    def offer(self, data: bytes) -> None:
        """Follow the points of a message as CDR, later and in a thread of its own.

        What serves the requests, deactivation among them, does not wait for that. Of several
        messages that wait the last one counts.
        """
        with self._lock:
            if self._waiting is not None:
                self._node.faults.drop('superseded trajectory', 'a later one came before its turn')
            self._waiting = data
            if self._works:
                return
            self._works = True
        threading.Thread(target=self._work, daemon=True).start()

    def _work(self) -> None:
        while True:
            with self._lock:
                data, self._waiting = self._waiting, None
                if data is None or not self._node.up:
                    self._works = False
                    return
            try:
                self.receive(read_trajectory(data))
            except BagError as error:
                self._node.faults.drop('unusable trajectory', str(error))
            except Exception as error:  # the topic goes on after a bad message
                self._node.faults.drop('failed trajectory', f'{type(error).__name__}: {error}')

    def receive(self, message: JointTrajectory | Trajectory) -> None:
        """Follow the points instead of the reference so far.

        The path is computed beside the loop, for a moment that is still to come: where computing
        takes longer than that, for a later moment.
        """
        head_start, done = HEAD_START, False
        while not done and self._node.up:
            done = self._follow(message, head_start)
            head_start *= LATER

    def _follow(self, message: JointTrajectory | Trajectory, head_start: float) -> bool:
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
