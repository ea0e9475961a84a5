# SPDX-License-Identifier: Apache-2.0
"""Which files of a folder are one bag, and what a file is that is none."""

from __future__ import annotations

from pathlib import Path
import shutil

import pytest

from adaptive_blf_control.bags.metadata import BagMetadata, FileInformation, save_metadata
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bags.recovery import recover_bag
from adaptive_blf_control.bags.storage_files import storage_files
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import encode_int32


def put(folder: Path, *names: str, apart: float = 0.0) -> Path:
    """Write a bag of one message under each name, some seconds apart, without metadata.yaml."""
    folder.mkdir()
    for number, name in enumerate(names):
        with BagWriter(folder / 'made') as writer:
            writer.add_topic('/n', 'std_msgs/msg/Int32')
            writer.write('/n', encode_int32(1), 10**12 + round(number * apart * 1e9))
        shutil.move(folder / 'made/made_0.mcap', folder / name)
        shutil.rmtree(folder / 'made')
    return folder


@pytest.mark.parametrize('names', [
    ('monday_0.mcap', 'tuesday_0.mcap'), ('run1.mcap', 'run2.mcap'),
    ('rosbag2_2026_01_01-10_00_00_0.mcap', 'rosbag2_2026_01_01-11_00_00_0.mcap'),
    ('run_0.mcap', 'run_0.db3')])
def test_recordings_of_different_names_are_not_joined(tmp_path, names):
    folder = put(tmp_path / 'logs', *names)
    for use in (read_bag, recover_bag):
        with pytest.raises(BagError, match='several recordings') as caught:
            use(folder)
        assert all(name in str(caught.value) for name in names)
    assert sorted(file.name for file in folder.iterdir()) == sorted(names)


def test_metadata_joins_files_of_any_name(tmp_path):
    folder = put(tmp_path / 'logs', 'b.mcap', 'a.mcap')
    save_metadata(folder, BagMetadata((FileInformation('b.mcap', 1, 0, 1),
                                       FileInformation('a.mcap', 1, 0, 1))))
    assert read_bag(folder).topics['/n'].count == 2
    assert [file.name for file in storage_files(folder)] == ['a.mcap', 'b.mcap']


def test_parts_of_one_recording_are_ordered_by_number(tmp_path):
    folder = put(tmp_path / 'logs', 'run_10.mcap', 'run_9.mcap', 'run_0.mcap')
    assert [file.name for file in storage_files(folder)] == [
        'run_0.mcap', 'run_9.mcap', 'run_10.mcap']


@pytest.mark.parametrize(('apart', 'one'), [
    (0.01, True), (50.0, True), (-0.5, True), (70.0, False), (-2.0, False), (86400.0, False)])
def test_files_are_parts_of_one_recording_where_their_times_follow(tmp_path, apart, one):
    folder = put(tmp_path / 'logs', 'run_1.mcap', 'run_2.mcap', apart=apart)
    if one:
        assert read_bag(folder).topics['/n'].count == 2
        assert recover_bag(folder).messages == 2
        return
    for use in (read_bag, recover_bag):
        with pytest.raises(BagError, match=rf'run_2.mcap begins {apart:g} s after the end of run'):
            use(folder)
    assert not (folder / 'metadata.yaml').exists()


def test_metadata_says_that_a_pause_between_two_files_is_one(tmp_path):
    folder = put(tmp_path / 'logs', 'run_0.mcap', 'run_1.mcap', apart=500.0)
    save_metadata(folder, BagMetadata(tuple(
        FileInformation(f'run_{i}.mcap', 10**12 + i * 500 * 10**9, 0, 1) for i in range(2))))
    assert read_bag(folder).topics['/n'].count == 2
    assert recover_bag(folder).messages == 2


@pytest.mark.parametrize(('content', 'words'), [
    (b'', 'empty file'), (b'\x1f\x8b\x08\x00', 'gzip: unpack it with "gunzip"'),
    (b'#ROSBAG V2.0', 'ROS 1 bag'), (b'hello', 'not a ROS 2 bag'),
    (b'version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n', 'git lfs pull')])
def test_a_file_that_is_no_bag_is_named_with_what_it_is(tmp_path, content, words):
    path = tmp_path / 'x_0.mcap'
    path.write_bytes(content)
    with pytest.raises(BagError, match=words):
        read_bag(path)
