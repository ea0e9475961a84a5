# SPDX-License-Identifier: Apache-2.0
"""Decoder for trajectory_msgs/msg/JointTrajectory of bounded length.

rclpy's own conversion of a long message holds the interpreter, and with it the control loop, until
it is done; this one does not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr_cursor import Cursor

__all__ = ['LARGEST_TRAJECTORY', 'Trajectory', 'TrajectoryPoint', 'read_trajectory']

LARGEST_TRAJECTORY = 10_000  # points
_SMALLEST_POINT = 24  # bytes: four counts and a time
_WHAT = 'JointTrajectory'


class TrajectoryTime(NamedTuple):
    """builtin_interfaces/Duration."""

    sec: int
    nanosec: int


class TrajectoryPoint(NamedTuple):
    """A point; arrays of any length, [rad], [rad/s], [rad/s²]."""

    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray
    time_from_start: TrajectoryTime


class Trajectory(NamedTuple):
    """The message without its header, with the names of its type."""

    joint_names: tuple[str, ...]
    points: tuple[TrajectoryPoint, ...]


def read_trajectory(data: bytes) -> Trajectory:
    """Decode a trajectory.

    Raises:
        BagError: truncated or garbage input, with the offset, or more points than
            ``LARGEST_TRAJECTORY``.
    """
    cursor = Cursor(bytes(data), _WHAT)
    cursor.int32('header.stamp.sec')
    cursor.uint32('header.stamp.nanosec')
    cursor.string('header.frame_id')
    names = tuple(cursor.string(f'joint_names[{i}]')
                  for i in range(cursor.count(4, 'joint_names')))
    count = cursor.count(_SMALLEST_POINT, 'points')
    if count > LARGEST_TRAJECTORY:
        raise BagError(f'{_WHAT} has {count} points: expected at most {LARGEST_TRAJECTORY}')
    return Trajectory(names, tuple(_point(cursor, i) for i in range(count)))


def _point(cursor: Cursor, number: int) -> TrajectoryPoint:
    positions, velocities, accelerations, _ = (
        cursor.doubles(f'points[{number}]') for _ in range(4))
    time = TrajectoryTime(cursor.int32('time_from_start.sec'),
                          cursor.uint32('time_from_start.nanosec'))
    return TrajectoryPoint(positions, velocities, accelerations, time)
