# SPDX-License-Identifier: Apache-2.0
"""Bags of strangers, and a bag that somebody takes away while it is written."""

from __future__ import annotations

import os
import shutil
import struct

import pytest

from adaptive_blf_control.bags.compression import unpack_bounded
from adaptive_blf_control.bags.mcap_file import LARGEST_CHANNELS, LARGEST_CHUNK, McapFile
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import encode_float64

MAGIC = b'\x89MCAP0\r\n'


def _record(opcode: int, body: bytes) -> bytes:
    return struct.pack('<BQ', opcode, len(body)) + body


def _text(text: str) -> bytes:
    return struct.pack('<I', len(text)) + text.encode()


def _channel(number: int, topic: str) -> bytes:
    return _record(4, struct.pack('<HH', number, 0) + _text(topic) + _text('cdr')
                   + struct.pack('<I', 0))


def _message(log_time: int) -> bytes:
    return _record(5, struct.pack('<HIQQ', 1, 0, log_time, 0) + encode_float64(1.0))


def _problem(path, content: bytes) -> str:
    path.write_bytes(MAGIC + content)
    file = McapFile(path)
    list(file.messages())
    return file.problem or ''


def test_a_time_that_no_clock_has_ends_the_reading_with_one_line(tmp_path):
    assert '2**63' in _problem(tmp_path / 'a.mcap', _channel(1, '/a') + _message(2**64 - 1))


def test_a_million_channels_end_the_reading(tmp_path):
    many = b''.join(_channel(k % 65536, f'/{k}') for k in range(LARGEST_CHANNELS + 1))
    assert f'more than {LARGEST_CHANNELS} channels' in _problem(tmp_path / 'a.mcap', many)
    again = _channel(1, '/a') * (LARGEST_CHANNELS + 1)  # as writers repeat them
    assert 'without footer' in _problem(tmp_path / 'b.mcap', again)


def test_a_chunk_that_claims_gigabytes_ends_the_reading(tmp_path):
    body = struct.pack('<QQQI', 0, 0, LARGEST_CHUNK + 1, 0) + _text('zstd') + struct.pack('<Q', 0)
    assert 'at most' in _problem(tmp_path / 'a.mcap', _record(6, body))


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
def test_what_stands_for_more_than_is_allowed_is_not_unpacked(compression):
    if compression == 'zstd':
        packed = pytest.importorskip('zstandard').ZstdCompressor().compress(bytes(10**6))
    else:
        packed = pytest.importorskip('lz4.frame').compress(bytes(10**6))
    assert len(packed) < 10**4
    assert unpack_bounded(packed, compression, 10**6) == bytes(10**6)
    with pytest.raises(BagError, match='more than 999999 bytes'):
        unpack_bounded(packed, compression, 10**6 - 1)


def test_a_pipe_is_no_bag(tmp_path):
    os.mkfifo(tmp_path / 'a.mcap')
    with pytest.raises(BagError, match='not a regular file'):
        read_bag(tmp_path / 'a.mcap')


@pytest.mark.parametrize('take_away', [shutil.rmtree, lambda bag: bag.rename(bag.parent / 'b')])
def test_a_bag_that_is_removed_or_renamed_is_an_error_with_the_next_flush(tmp_path, take_away):
    writer = BagWriter(tmp_path / 'bag')
    writer.add_topic('/a', 'std_msgs/msg/Float64')
    writer.write('/a', encode_float64(1.0), 1, 1)
    writer.flush()
    take_away(tmp_path / 'bag')
    writer.write('/a', encode_float64(2.0), 2, 2)
    with pytest.raises(BagError, match='removed or renamed'):
        writer.flush()
    writer.close()
