# SPDX-License-Identifier: Apache-2.0
"""Diagnostics as bytes: what ROS reads in them, and nothing between the lines."""

from __future__ import annotations

import struct

import pytest

from adaptive_blf_control.messages.diagnostics import decode_diagnostics, encode_diagnostics

VALUES = {'rank': 5, 'V': '1e-3', 'last fault': "joint 'a' is 3° off", '': ''}
ARGUMENTS = (2 * 10**9 + 7, b'\x02', 'arm_driver: arm_driver', 'läuft', 'arm')


def test_what_was_encoded_is_decoded() -> None:
    data = encode_diagnostics(*ARGUMENTS, VALUES)
    assert decode_diagnostics(data) == {
        'arm_driver: arm_driver': {key: str(value) for key, value in VALUES.items()}}
    assert struct.unpack_from('<iI', data, 4) == (2, 7)


def test_ros_reads_the_same() -> None:
    pytest.importorskip('rclpy', reason='no ROS 2 here')
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.serialization import deserialize_message
    array = deserialize_message(encode_diagnostics(*ARGUMENTS, VALUES), DiagnosticArray)
    header = array.header
    assert (header.stamp.sec, header.stamp.nanosec, header.frame_id) == (2, 7, '')
    status, = array.status
    assert (status.level, status.name, status.message, status.hardware_id) == ARGUMENTS[1:]
    assert {pair.key: pair.value for pair in status.values} == {
        key: str(value) for key, value in VALUES.items()}


def test_texts_that_no_message_can_hold_are_reported_all_the_same() -> None:
    odd = encode_diagnostics(*ARGUMENTS[:3], 'a\0b', 'arm', {'fault': 'joint \udcff'})
    assert decode_diagnostics(odd) == {'arm_driver: arm_driver': {'fault': 'joint \\udcff'}}
