# SPDX-License-Identifier: Apache-2.0
"""Reading bags that are whole, truncated, damaged, foreign or no bags at all."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3

import numpy as np
import pytest

from adaptive_blf_control.bags.metadata import (
    BagMetadata,
    dump_yaml,
    FileInformation,
    save_metadata,
)
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import (
    encode_float64,
    encode_int32,
    Float64MultiArrayCodec,
    JointStateCodec,
)

JOINT_STATE = 'sensor_msgs/msg/JointState'


def write_bag(path, count=60, flush_every=20):
    """Write a small bag of several chunks and return its messages."""
    codec, sent = JointStateCodec(['a', 'b']), []
    with BagWriter(path, custom_data={'k': 'v'}) as writer:
        writer.add_topic('/joint_states', JOINT_STATE)
        writer.add_topic('/rank', 'std_msgs/msg/Int32')
        for i in range(count):
            row = np.array([i, -i], dtype=float)
            sent.append(('/joint_states', codec.encode(5 * i, row, 2 * row, 3 * row), 7 * i))
            sent.append(('/rank', encode_int32(i), 7 * i + 1))
            for message in sent[-2:]:
                writer.write(*message)
            if i % flush_every == flush_every - 1:
                writer.flush()
    return sent


def attempt(path):
    """Return the bag, or None, and the message of the BagError, or ''."""
    try:
        return read_bag(path), ''
    except BagError as exc:
        return None, str(exc)


def content(bag):
    """Return a bag's messages as `write_bag` does."""
    return [(topic, data, now) for topic, _, now, data in bag]


def test_folder_file_and_metadata_path_give_the_same(tmp_path):
    sent = write_bag(tmp_path / 'run')
    for path in ('run', 'run/run_0.mcap', 'run/metadata.yaml'):
        bag = read_bag(tmp_path / path)
        assert content(bag) == sent
        assert (bag.complete, bag.problem, bag.custom_data) == (True, None, {'k': 'v'})
        assert [(t.name, t.type_name, t.count) for t in bag.topics.values()] == [
            ('/joint_states', JOINT_STATE, 60), ('/rank', 'std_msgs/msg/Int32', 60)]


def test_folder_without_metadata_is_read_in_order_of_file_numbers(tmp_path):
    folder, sent = tmp_path / 'split', []
    folder.mkdir()
    for number, count in ((2, 3), (10, 4)):
        sent += write_bag(tmp_path / f'part{number}', count)
        shutil.move(tmp_path / f'part{number}/part{number}_0.mcap', folder / f's_{number}.mcap')
    assert content(read_bag(folder)) == sent


def test_messages_come_in_time_order_whatever_their_order_in_the_file(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        for topic in ('/a', '/b'):
            writer.add_topic(topic, 'std_msgs/msg/Int32')
        for first in range(0, 3000, 12):  # fetched topic by topic, 12 ms at a time
            for topic in ('/a', '/b'):
                for k in range(first, first + 12):
                    writer.write(topic, encode_int32(k), 10**9 + k * 10**6)
                if (first, topic) == (600, '/a'):  # one wild time does not disturb the others
                    writer.write('/a', encode_int32(-1), 2**62)
        writer.write('/b', encode_int32(-2), 10**9)  # 3 s behind its place: late
    bag = read_bag(tmp_path / 'bag')
    ordered = [(m.log_time_ns, m.topic) for m in bag.in_time_order()]
    expected = [(10**9 + k * 10**6, topic) for k in range(3000) for topic in ('/a', '/b')]
    assert [m for m in ordered if m[0] != 2**62 and m not in expected[:2]] == expected[2:]
    assert ordered[-1] == (2**62, '/a')
    assert ordered.index((10**9, '/b')) == 1
    assert ordered.count((10**9, '/b')) == 2
    assert [m.topic for m in bag.in_time_order(['/b'])] == ['/b'] * 3001


def test_every_truncation_reads_a_prefix_and_says_so(tmp_path):
    sent = write_bag(tmp_path / 'run', 30, 10)
    data = (tmp_path / 'run/run_0.mcap').read_bytes()
    cut, best = tmp_path / 'cut.mcap', 0
    for size in [*range(0, len(data), 23), *range(len(data) - 40, len(data) - 8)]:
        cut.write_bytes(data[:size])
        bag, error = attempt(cut)
        if bag is None:
            assert 'cut.mcap' in error
            assert best == 0
            continue
        assert not bag.complete
        assert 'truncated' in bag.problem
        found = content(bag)
        assert found == sent[:len(found)]
        assert len(found) >= best
        best = len(found)
    assert best == len(sent)


def test_cut_chunk_is_read_to_its_last_whole_message(tmp_path):
    sent = write_bag(tmp_path / 'run', 50, 1000)
    data = (tmp_path / 'run/run_0.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(data[:data.index(sent[71][1]) + 3])
    assert content(read_bag(tmp_path / 'cut.mcap')) == sent[:71]


@pytest.mark.parametrize('name', ['ZSTD', 'LZ4'])
def test_compressed_chunks_are_read(tmp_path, name):
    mcap_writer = pytest.importorskip('mcap.writer')
    path = tmp_path / 'packed.mcap'
    with path.open('wb') as stream:
        writer = mcap_writer.Writer(stream, chunk_size=1000,
                                    compression=mcap_writer.CompressionType[name])
        writer.start('ros2', 'test')
        schema = writer.register_schema('std_msgs/msg/Int32', 'ros2msg', b'int32 data\n')
        channel = writer.register_channel('/n', 'cdr', schema)
        for i in range(500):
            writer.add_message(channel, i, encode_int32(i), i)
        writer.finish()
    whole = read_bag(path)
    assert whole.complete
    assert whole.doubles('n')[1].tolist() == list(range(500))
    path.write_bytes(path.read_bytes()[:3000])
    cut = read_bag(path)
    assert not cut.complete
    assert cut.doubles('/n')[1].tolist() == list(range(cut.topics['/n'].count))


def test_flipped_bits_raise_nothing_but_bag_errors(tmp_path):
    sent = write_bag(tmp_path / 'run', 8, 4)
    data = (tmp_path / 'run/run_0.mcap').read_bytes()
    path, rng = tmp_path / 'bad.mcap', np.random.default_rng(5)
    for _ in range(400):
        bad = bytearray(data)
        for position in rng.integers(0, len(bad), 3):
            bad[position] ^= 1 << rng.integers(8)
        path.write_bytes(bad)
        bag, error = attempt(path)
        if bag is None:
            assert str(path) in error
            continue
        assert len(content(bag)) <= len(sent)
        with contextlib.suppress(BagError):
            bag.joint_states('/joint_states')


def test_damaged_chunk_ends_the_bag_where_it_stands(tmp_path):
    sent = write_bag(tmp_path / 'run')
    data = bytearray((tmp_path / 'run/run_0.mcap').read_bytes())
    data[data.index(sent[90][1]) + 30] ^= 4
    (tmp_path / 'run/run_0.mcap').write_bytes(data)
    bag = read_bag(tmp_path / 'run')
    assert 'damaged' in bag.problem
    assert content(bag) == sent[:80]


def test_tail_of_zeros_is_a_damaged_file(tmp_path):
    sent = write_bag(tmp_path / 'run')
    data = (tmp_path / 'run/run_0.mcap').read_bytes()
    end = data.index(sent[-1][1])
    (tmp_path / 'zeros.mcap').write_bytes(data[:end] + bytes(len(data) - end))
    bag = read_bag(tmp_path / 'zeros.mcap')
    assert not bag.complete
    assert content(bag) == sent[:80]


def write_db3(path, rows, topics=((1, '/n', 'std_msgs/msg/Int32'),)):
    """Write rosbag2's SQLite tables."""
    with sqlite3.connect(path) as db:
        db.execute('CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT '
                   'NOT NULL, serialization_format TEXT NOT NULL, offered_qos_profiles TEXT)')
        db.execute('CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, '
                   'timestamp INTEGER NOT NULL, data BLOB NOT NULL)')
        db.executemany("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", topics)
        db.executemany('INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)', rows)
    db.close()


def test_sqlite_bag_with_and_without_metadata(tmp_path):
    folder = tmp_path / 'old bag %?'
    folder.mkdir()
    write_db3(folder / 'old_0.db3', [(1, 10 + i, encode_int32(i)) for i in range(300)])
    assert read_bag(folder / 'old_0.db3').doubles('/n')[1].tolist() == list(range(300))
    save_metadata(folder, BagMetadata((FileInformation('old_0.db3', 10, 299, 300),),
                                      storage='sqlite3', custom_data={'a': 'b'}))
    bag = read_bag(folder)
    assert (bag.complete, bag.custom_data) == (True, {'a': 'b'})
    data = (folder / 'old_0.db3').read_bytes()
    for size in (len(data) // 2, 4096, 600, 90):
        (folder / 'old_0.db3').write_bytes(data[:size])
        bag, error = attempt(folder)
        if bag is None:
            assert 'old_0.db3' in error
        else:
            assert not bag.complete
            count = bag.topics['/n'].count
            assert bag.doubles('/n')[1].tolist() == list(range(count))


def test_sqlite_row_that_is_no_message_ends_the_bag(tmp_path):
    rows = [(1, 10, encode_int32(0)), (1, 'late', encode_int32(1))]
    write_db3(tmp_path / 'a.db3', rows)
    bag = read_bag(tmp_path / 'a.db3')
    assert not bag.complete
    assert 'not a message' in bag.problem
    write_db3(tmp_path / 'b.db3', [(9, 10, encode_int32(0))])
    with pytest.raises(BagError, match='not a message'):
        read_bag(tmp_path / 'b.db3')


def test_real_db3_equals_the_csv_beside_it(realdata):
    bag = read_bag(realdata / 'ur10_unisa2025/ur10_exciting_trajectory.db3')
    assert bag.topics['/joint_states'].count == 3441
    series = bag.joint_states('/joint_states')
    table = np.loadtxt(realdata / 'ur10_unisa2025/ur10_exciting.csv', delimiter=',', skiprows=1)
    values = np.hstack((series.position, series.velocity, series.effort))
    # The file has seven significant digits.
    np.testing.assert_allclose(values, table[:, 1:], rtol=5.1e-7, atol=0)
    np.testing.assert_allclose((series.stamp_ns - series.stamp_ns[0]) * 1e-9, table[:, 0],
                               atol=2e-9)


def test_joint_states_follow_the_names_not_the_order(tmp_path):
    with BagWriter(tmp_path / 'run') as writer:
        writer.add_topic('/js', JOINT_STATE)
        for i, names in enumerate((['a', 'b'], ['b', 'a'], ['c', 'b', 'a'], ['g'])):
            row = [float(ord(name)) for name in names]
            writer.write('/js', JointStateCodec(names, fields=['effort']).encode(i, effort=row), i)
        writer.add_topic('/silent', JOINT_STATE)
    bag = read_bag(tmp_path / 'run')
    with pytest.raises(BagError, match=r"/js message 3: JointState lacks joint 'a', 'b'"):
        bag.joint_states('js')
    series = bag.joint_states('js', ['b', 'a'], skip_foreign=True)
    assert series.names == ('b', 'a')
    assert series.effort.tolist() == [[98.0, 97.0]] * 3
    assert np.isnan(series.position).all()
    assert (series.stamp_ns.tolist(), series.skipped) == ([0, 1, 2], 1)
    with pytest.raises(BagError, match='/silent has no message'):
        bag.joint_states('/silent')


def test_doubles_of_arrays_and_scalars(tmp_path):
    with BagWriter(tmp_path / 'run') as writer:
        writer.add_topic('/tau', 'std_msgs/msg/Float64MultiArray')
        writer.add_topic('/v', 'std_msgs/msg/Float64')
        for i in range(3):
            writer.write('/tau', Float64MultiArrayCodec(2).encode([i, i + 0.5]), 10 + i)
            writer.write('/v', encode_float64(i / 4), 20 + i)
    bag = read_bag(tmp_path / 'run')
    times, values = bag.doubles('/tau')
    assert (times.tolist(), values.tolist()) == ([10, 11, 12], [[0, 0.5], [1, 1.5], [2, 2.5]])
    assert bag.doubles('v')[1].tolist() == [0.0, 0.25, 0.5]
    with pytest.raises(BagError, match='has type'):
        bag.joint_states('/v')
    with pytest.raises(BagError, match=r"no topic '/x': expected one of \['/tau', '/v'\]"):
        bag.doubles('/x')


def test_what_is_no_bag_is_refused_by_name(tmp_path):
    with BagWriter(tmp_path / 'empty') as writer:
        writer.add_topic('/a', JOINT_STATE)
    cases = {'empty': 'empty bag', 'empty/empty_0.mcap': 'empty bag', 'missing': 'No such file'}
    for name, data, words in (
            ('zero.mcap', b'', 'is an empty file'), ('text.mcap', b'hello', 'not a ROS 2 bag'),
            ('old.bag', b'#ROSBAG V2.0\n', 'ROS 1'),
            ('foreign.db3', b'SQLite format 3\0' + bytes(100), 'SQLite')):
        (tmp_path / name).write_bytes(data)
        cases[name] = words
    sqlite3.connect(tmp_path / 'tables.db3').execute('CREATE TABLE x(y)').connection.close()
    cases['tables.db3'] = 'not a rosbag2 SQLite file'
    (tmp_path / 'folder').mkdir()
    cases['folder'] = 'is not a bag'
    for name, words in cases.items():
        with pytest.raises(BagError, match=words) as caught:
            read_bag(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)


@pytest.mark.parametrize('text', [
    '', '[', '\x07', 'a: 1', 'rosbag2_bagfile_information: 3', '&a [*a]',
    'rosbag2_bagfile_information: {storage_identifier: mcap}',
    'rosbag2_bagfile_information: {storage_identifier: mcap, files: [1]}',
    'rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: 3}'])
def test_broken_metadata_are_refused_by_name(tmp_path, text):
    write_bag(tmp_path / 'run', 3)
    (tmp_path / 'run/metadata.yaml').write_text(text)
    with pytest.raises(BagError, match=r'metadata\.yaml'):
        read_bag(tmp_path / 'run')


def test_metadata_of_version_4_with_qos_as_text_are_read(tmp_path):
    sent = write_bag(tmp_path / 'run', 3)
    topic = {'name': '/rank', 'type': 'std_msgs/msg/Int32', 'serialization_format': 'cdr',
             'offered_qos_profiles': '- history: 3\n  depth: 0\n'}
    (tmp_path / 'run/metadata.yaml').write_text(dump_yaml({'rosbag2_bagfile_information': {
        'version': 4, 'storage_identifier': 'mcap', 'relative_file_paths': ['run/run_0.mcap'],
        'duration': {'nanoseconds': 1}, 'starting_time': {'nanoseconds_since_epoch': 0},
        'message_count': 6, 'compression_format': '', 'compression_mode': '',
        'topics_with_message_count': [{'topic_metadata': topic, 'message_count': 3}]}}))
    bag = read_bag(tmp_path / 'run')
    assert content(bag) == sent
    assert bag.complete


def test_missing_part_and_fewer_messages_than_stated_are_told(tmp_path):
    write_bag(tmp_path / 'run', 3)
    part = FileInformation('run_0.mcap', 0, 22, 6)
    save_metadata(tmp_path / 'run', BagMetadata((part, FileInformation('run_1.mcap', 30, 1, 2))))
    assert 'run_1.mcap is missing' in read_bag(tmp_path / 'run').problem
    save_metadata(tmp_path / 'run', BagMetadata((FileInformation('run_0.mcap', 0, 22, 9),)))
    assert '6 messages were found' in read_bag(tmp_path / 'run').problem
    save_metadata(tmp_path / 'run', BagMetadata((part,), compression_mode='FILE',
                                               compression_format='snappy'))
    with pytest.raises(BagError, match="format 'snappy' cannot be read: expected zstd or lz4"):
        read_bag(tmp_path / 'run')
    save_metadata(tmp_path / 'run', BagMetadata((FileInformation('gone.mcap'),)))
    with pytest.raises(BagError, match='none of its files'):
        read_bag(tmp_path / 'run')
