# SPDX-License-Identifier: Apache-2.0
"""The clock of a node in lockstep: it shows the time of the sample that is worked on."""

from __future__ import annotations

from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.time import Time

from adaptive_blf_control.messages.stamp import STAMP_LIMIT
from adaptive_blf_control.runtime.rclpy_internals import take_over_clock

__all__ = ['SampleClock']


class SampleClock:
    """Sets the ROS time of a node, within what ROS can represent."""

    def __init__(self, node: Node) -> None:
        """Take the clock of ``node`` over from /clock."""
        self._clock = node.get_clock()
        take_over_clock(node)

    def show(self, stamp_ns: int) -> int:
        """Set the time to a stamp [ns] and return the time that is shown [ns]."""
        shown = min(max(stamp_ns, 0), STAMP_LIMIT - 1)
        if isinstance(self._clock, ROSClock):
            self._clock.set_ros_time_override(
                Time(nanoseconds=shown, clock_type=ClockType.ROS_TIME))
        return shown
