# SPDX-License-Identifier: Apache-2.0
"""Bags that rosbag2 compressed, as files or message by message, read as if they were not."""

from __future__ import annotations

from pathlib import Path
import sqlite3

import pytest
import yaml

from adaptive_blf_control.bags.metadata import BagMetadata, FileInformation, save_metadata
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bags.recovery import recover_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import encode_int32

zstandard = pytest.importorskip('zstandard')
lz4_frame = pytest.importorskip('lz4.frame')

INT = 'std_msgs/msg/Int32'
PACK = {'zstd': zstandard.ZstdCompressor().compress, 'lz4': lz4_frame.compress}
NUMBERS = list(range(300))


def write_bag(folder: Path, pack=bytes, numbers=NUMBERS) -> Path:
    """Write numbers, each message packed; return the storage file."""
    with BagWriter(folder) as writer:
        writer.add_topic('/n', INT)
        for number in numbers:
            writer.write('/n', pack(encode_int32(number)), 10**9 + number)
    return folder / f'{folder.name}_0.mcap'


def state(folder: Path, mode: str, file: str, kind: str = 'zstd') -> None:
    """Write a metadata.yaml that states the compression."""
    save_metadata(folder, BagMetadata(
        (FileInformation(file, 10**9, 299, len(NUMBERS)),), compression_mode=mode,
        compression_format=kind))


def numbers(path: Path) -> list[float]:
    bag = read_bag(path)
    assert bag.complete
    return bag.doubles('/n')[1].tolist()


@pytest.mark.parametrize('kind', PACK)
def test_a_bag_compressed_as_a_file_is_read(tmp_path, kind):
    file = write_bag(tmp_path / 'run')
    packed = file.with_name(f'{file.name}.{kind}')
    packed.write_bytes(PACK[kind](file.read_bytes()))
    file.unlink()
    state(file.parent, 'file', packed.name, kind)
    assert numbers(file.parent) == numbers(packed) == NUMBERS
    (file.parent / 'metadata.yaml').unlink()
    assert numbers(file.parent) == NUMBERS
    assert list(tmp_path.rglob('*.mcap')) == []  # nothing is unpacked beside it


def test_a_file_unpacked_beside_the_packed_one_is_read_once(tmp_path):
    file = write_bag(tmp_path / 'run')
    packed = file.with_name(file.name + '.zstd')
    packed.write_bytes(b'not looked at')
    state(file.parent, 'FILE', packed.name)
    assert numbers(file.parent) == NUMBERS
    (file.parent / 'metadata.yaml').unlink()
    assert numbers(file.parent) == NUMBERS


def test_a_file_that_was_packed_afterwards_is_found_by_the_name_it_had(tmp_path):
    file = write_bag(tmp_path / 'run')
    file.with_name(file.name + '.zst').write_bytes(PACK['zstd'](file.read_bytes()))
    file.unlink()
    assert numbers(file.parent) == NUMBERS


@pytest.mark.parametrize('kind', PACK)
def test_a_packed_file_that_breaks_off_is_read_up_to_the_break(tmp_path, kind):
    file = write_bag(tmp_path / 'run', numbers=range(60_000))
    data = PACK[kind](file.read_bytes())
    packed = tmp_path / f'cut.mcap.{kind}'
    packed.write_bytes(data[:len(data) * 2 // 3])
    bag = read_bag(packed)
    assert 'truncated' in bag.problem
    assert str(packed) in bag.problem
    found = bag.doubles('/n')[1].tolist()
    assert 0 < len(found) < 60_000
    assert found == list(range(len(found)))


@pytest.mark.parametrize('kind', PACK)
def test_messages_compressed_one_by_one_are_read(tmp_path, kind):
    file = write_bag(tmp_path / 'run', PACK[kind])
    state(file.parent, 'message', file.name, kind)
    assert numbers(file.parent) == numbers(file) == NUMBERS


def test_compressed_messages_of_a_lone_db3_file_are_read(tmp_path):
    path = tmp_path / 'lone.db3'
    with sqlite3.connect(path) as db:
        db.execute('CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, '
                   'serialization_format TEXT)')
        db.execute('CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, '
                   'timestamp INTEGER, data BLOB)')
        db.execute('INSERT INTO topics VALUES(1, "/n", ?, "cdr")', (INT,))
        db.executemany('INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)', [
            (i, PACK['zstd'](encode_int32(i))) for i in NUMBERS])
    db.close()
    assert numbers(path) == NUMBERS


def test_a_damaged_message_is_named_as_such(tmp_path):
    file = write_bag(tmp_path / 'run', lambda data: PACK['zstd'](data)[:-3])
    with pytest.raises(BagError, match='cannot be decompressed'):
        read_bag(file).doubles('/n')


def test_a_compressed_bag_is_recovered_as_an_unpacked_copy(tmp_path):
    file = write_bag(tmp_path / 'messages', PACK['zstd'])
    state(file.parent, 'message', file.name)
    before = (file.parent / 'metadata.yaml').read_bytes()
    done = recover_bag(file.parent)
    assert (done.what, done.path, done.problem) == (
        'copy', tmp_path / 'messages_recovered', None)
    assert (file.parent / 'metadata.yaml').read_bytes() == before
    stated = yaml.safe_load((done.path / 'metadata.yaml').read_text())
    assert not stated['rosbag2_bagfile_information']['compression_mode']
    copied = [message for _, _, message in
              read_bag(done.path)._files[0].messages()]  # what the file itself holds
    assert copied == [encode_int32(number) for number in NUMBERS]

    file = write_bag(tmp_path / 'file')
    packed = file.with_name(file.name + '.zstd')
    packed.write_bytes(PACK['zstd'](file.read_bytes()))
    file.unlink()
    state(file.parent, 'file', packed.name)
    assert numbers(recover_bag(file.parent).path) == NUMBERS
    assert [path.name for path in file.parent.glob('*.mcap*')] == [packed.name]
