# SPDX-License-Identifier: Apache-2.0
"""The stamp of a message without the rest of it."""

from __future__ import annotations

import struct

import pytest

from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.stamp import STAMP_LIMIT, stamp_of


@pytest.mark.parametrize('stamp', [0, 1, 10**9 - 1, 1_700_000_000_123_456_789, STAMP_LIMIT - 1])
def test_the_stamp_that_was_encoded_is_read(stamp: int) -> None:
    assert stamp_of(JointStateCodec(['a'], fields=()).encode(stamp)) == stamp


def test_a_stamp_in_big_endian_order_is_read() -> None:
    assert stamp_of(b'\0\0\0\0' + struct.pack('>iI', 3, 5)) == 3 * 10**9 + 5


@pytest.mark.parametrize('data', [
    b'', b'\0\1\0\0', b'\0\1\0\0' + bytes(7), b'\0\3\0\0' + bytes(8)])
def test_bytes_without_a_stamp_have_none(data: bytes) -> None:
    assert stamp_of(data) is None
