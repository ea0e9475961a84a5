# SPDX-License-Identifier: Apache-2.0
"""Facts about the decoder of markers."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')

from geometry_msgs.msg import Point
from rclpy.serialization import serialize_message
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.marker_reader import LARGEST_ARRAY, read_markers


def _message(count: int) -> MarkerArray:
    message = MarkerArray()
    for k in range(count):
        marker = Marker(ns='cart' * k, id=k, type=Marker.SPHERE, text='x' * (k % 3))
        marker.header.frame_id = 'base_link'
        marker.header.stamp.sec, marker.header.stamp.nanosec = 3, k
        marker.pose.position.x, marker.pose.orientation.w = 0.1 * k, 1.0
        marker.scale.x, marker.scale.y, marker.scale.z = 0.2, 0.3, 0.4
        marker.points = [Point(x=1.0)] * k
        marker.colors = [ColorRGBA(r=1.0)] * k
        marker.mesh_file.data = [1] * k
        message.markers.append(marker)
    return message


def test_it_reads_what_rclpy_writes() -> None:
    read = read_markers(bytes(serialize_message(_message(4))))
    assert [each.id for each in read] == [0, 1, 2, 3]
    last = read[3]
    assert (last.stamp_ns, last.frame, last.ns) == (3_000_000_003, 'base_link', 'cart' * 3)
    assert (last.type, last.action) == (Marker.SPHERE, Marker.ADD)
    assert last.position == pytest.approx((0.3, 0.0, 0.0))
    assert last.orientation == (0.0, 0.0, 0.0, 1.0)
    assert last.scale == (0.2, 0.3, 0.4)
    assert read_markers(bytes(serialize_message(MarkerArray()))) == ()


def test_more_markers_than_the_limit_are_refused() -> None:
    with pytest.raises(BagError, match=f'at most {LARGEST_ARRAY}'):
        read_markers(bytes(serialize_message(_message(2)))[:4]
                     + (LARGEST_ARRAY + 1).to_bytes(4, 'little') + bytes(200 * 1000))


def test_a_truncated_message_is_refused_wherever_it_ends() -> None:
    data = bytes(serialize_message(_message(2)))
    whole = next(end for end in range(len(data) + 1) if _reads(data[:end]))
    assert whole > len(data) - 8  # rclpy's buffer is padded
    for end in range(0, whole, 7):
        with pytest.raises(BagError):
            read_markers(data[:end])


def _reads(data: bytes) -> bool:
    try:
        return len(read_markers(data)) == 2
    except BagError:
        return False
