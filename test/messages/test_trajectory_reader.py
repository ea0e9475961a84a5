# SPDX-License-Identifier: Apache-2.0
"""Facts about the decoder of trajectories."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')

from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.trajectory_reader import LARGEST_TRAJECTORY, read_trajectory


def _message(points: int) -> JointTrajectory:
    message = JointTrajectory(joint_names=['a', 'bc'])
    for k in range(points):
        point = JointTrajectoryPoint(positions=[float(k), 0.5], velocities=[1.0, 2.0][:k % 2 * 2])
        point.time_from_start.sec, point.time_from_start.nanosec = k + 1, 7
        message.points.append(point)
    return message


def test_it_reads_what_rclpy_writes() -> None:
    read = read_trajectory(bytes(serialize_message(_message(3))))
    assert read.joint_names == ('a', 'bc')
    assert [point.positions.tolist() for point in read.points] == [[0.0, 0.5], [1.0, 0.5],
                                                                   [2.0, 0.5]]
    assert [len(point.velocities) for point in read.points] == [0, 2, 0]
    assert read.points[2].time_from_start == (3, 7)
    assert not np.any([len(point.accelerations) for point in read.points])


def test_more_points_than_the_limit_are_refused_before_they_are_read() -> None:
    data = bytearray(serialize_message(_message(1)))
    where = data.index(b'bc\0') + 4  # of the count, aligned
    where += -(where - 4) % 4
    data[where:where + 4] = (LARGEST_TRAJECTORY + 1).to_bytes(4, 'little')
    with pytest.raises(BagError, match=f'at most {LARGEST_TRAJECTORY}'):
        read_trajectory(bytes(data) + bytes(24 * (LARGEST_TRAJECTORY + 1)))


def test_a_truncated_message_is_refused_wherever_it_ends() -> None:
    data = bytes(serialize_message(_message(2)))
    whole = data.rindex(b'\x07\0\0\0') + 4  # the last nanoseconds; rclpy's buffer is longer
    assert len(read_trajectory(data[:whole]).points) == 2
    for end in range(whole):
        with pytest.raises(BagError):
            read_trajectory(data[:end])
