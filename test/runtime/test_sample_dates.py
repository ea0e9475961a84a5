# SPDX-License-Identifier: Apache-2.0
"""What has no stamp belongs to the newest state sent before it, in whatever order things come."""

from __future__ import annotations

import pickle

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.runtime.sample_dates import has_sample_time, SampleDates


def test_an_answer_that_overtakes_its_state_waits_for_it() -> None:
    dates = SampleDates()
    dates.state(1000, 1)
    dates.add(1100, 'commands', 'type', b'first')
    dates.add(2100, 'commands', 'type', b'second')  # its state is still on the way
    assert list(dates.take(now_ns=2200)) == []
    dates.state(2000, 2)
    assert [(message.data, message.stamp_ns) for message in dates.take(2300)] == [(b'first', 1)]
    dates.state(3000, 3)
    assert [(message.data, message.stamp_ns) for message in dates.take(3100)] == [(b'second', 2)]


def test_what_waits_is_dated_after_ten_seconds_and_at_the_end() -> None:
    dates = SampleDates()
    dates.add(500, 'events', 'type', b'start-up')
    dates.state(1000, 1)
    dates.add(1100, 'commands', 'type', b'last')
    assert [message.stamp_ns for message in dates.take(1200)] == [1]  # before any: of the first
    assert [message.stamp_ns for message in dates.take(1101 + 10 * 10**9)] == [1]
    dates.add(1300, 'commands', 'type', b'zero torque')
    assert [message.data for message in dates.take()] == [b'zero torque']


def test_what_comes_before_the_first_state_waits_for_it_however_long_that_takes() -> None:
    dates = SampleDates()
    dates.add(500, 'robot_description', 'type', b'an arm')
    assert list(dates.take(60 * 10**9)) == []
    dates.state(61 * 10**9, 7)
    assert [message.stamp_ns for message in dates.take(62 * 10**9)] == [7]


def test_of_several_states_sent_before_a_message_the_newest_is_its_date() -> None:
    dates = SampleDates()
    for k in (1, 2, 3):
        dates.state(1000 * k, k)
    dates.add(2500, 'commands', 'type', b'torque')
    assert [message.stamp_ns for message in dates.take(3100)] == [2]


def test_states_that_nothing_waits_for_are_forgotten() -> None:
    dates, sizes = SampleDates(), []
    for k in range(1, 2001):
        dates.state(1000 * k, k)
        dates.add(1000 * k + 1, 'commands', 'type', b'torque')
        taken = list(dates.take(1000 * k + 2))
        assert [message.stamp_ns for message in taken] == ([k - 1] if k > 1 else [])
        sizes.append(len(pickle.dumps(dates)))
    assert max(sizes[1000:]) < 2 * sizes[10]


def test_a_stamp_is_known_by_the_type() -> None:
    assert has_sample_time(JointState)
    assert has_sample_time(Clock)
    assert not has_sample_time(Float64MultiArray)
