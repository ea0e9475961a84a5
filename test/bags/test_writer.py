# SPDX-License-Identifier: Apache-2.0
"""Bags as other libraries read them, and what a crash or a full disk leaves behind."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
import yaml

from adaptive_blf_control.bags.metadata import (
    BagMetadata,
    default_qos,
    FileInformation,
    load_metadata,
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
from adaptive_blf_control.messages.definitions import embedded_definition, message_definition
from disk import synced_files
from patience import PATIENCE

START = 1_700_000_000_000_000_000
TOPICS = {
    '/joint_states': 'sensor_msgs/msg/JointState',
    '/theta_hat': 'sensor_msgs/msg/JointState',
    '/commands': 'std_msgs/msg/Float64MultiArray',
    '/sigma': 'std_msgs/msg/Float64',
    '/rank': 'std_msgs/msg/Int32',
}
CUSTOM = {'controller.k1': '[1.0, 1.0]', 'number': '1e5', 'octal': '0o17', 'empty': '',
          'lines': 'a: 1\nb: "x" # ü\n'}


def messages(count):
    """Return (topic, data, log time) of a run: sensible, random values."""
    rng = np.random.default_rng(3)
    joints = JointStateCodec(['j1', 'joint_2'])
    theta = JointStateCodec(['θ1'], 'arm', ['position'])
    commands = Float64MultiArrayCodec(2)
    for i in range(count):
        now = START + i * 1_000_000
        yield '/joint_states', joints.encode(now, *rng.normal(size=(3, 2))), now
        yield '/theta_hat', theta.encode(now, rng.normal(size=1)), now + 10
        yield '/commands', commands.encode(rng.normal(size=2)), now + 20
        yield '/sigma', encode_float64(rng.normal()), now + 30
        yield '/rank', encode_int32(i), now + 40


@pytest.fixture
def bag(tmp_path):
    """Write a bag of more than one chunk."""
    with BagWriter(tmp_path / 'run', custom_data=CUSTOM) as writer:
        for topic, type_name in TOPICS.items():
            writer.add_topic(topic, type_name)
        writer.add_topic('/silent', 'diagnostic_msgs/msg/DiagnosticArray',
                         qos=default_qos('best_effort', 'transient_local'))
        for topic, data, now in messages(2500):
            writer.write(topic, data, now, now - 5)
    assert writer.counts == {**dict.fromkeys(TOPICS, 2500), '/silent': 0}
    return writer.path


def test_rosbags_reads_every_message_bit_for_bit(bag):
    highlevel = pytest.importorskip('rosbags.highlevel')
    typesys = pytest.importorskip('rosbags.typesys')
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    with highlevel.AnyReader([bag], default_typestore=store) as reader:
        assert {c.topic: c.msgtype for c in reader.connections} == {
            **TOPICS, '/silent': 'diagnostic_msgs/msg/DiagnosticArray'}
        assert reader.message_count == 12_500
        assert (reader.start_time, reader.duration) == (START, 2_499_000_041)
        for (connection, now, data), sent in zip(reader.messages(), messages(2500)):
            assert (connection.topic, bytes(data), now) == sent
            value = reader.deserialize(data, connection.msgtype)
            assert bytes(store.serialize_cdr(value, connection.msgtype)) == sent[1]


def test_mcap_reads_every_message_bit_for_bit(bag):
    mcap_reader = pytest.importorskip('mcap.reader')
    decoder = pytest.importorskip('mcap_ros2.decoder')
    with (bag / 'run_0.mcap').open('rb') as stream:
        reader = mcap_reader.make_reader(stream, validate_crcs=True,
                                         decoder_factories=[decoder.DecoderFactory()])
        header, summary = reader.get_header(), reader.get_summary()
        assert header.profile == 'ros2'
        assert header.library.startswith('adaptive_blf_control ')
        assert len(summary.chunk_indexes) > 1
        assert {index.compression for index in summary.chunk_indexes} == {''}
        assert max(i.uncompressed_size for i in summary.chunk_indexes) < 786_432 + 1000
        ranks = []
        for (schema, channel, message, value), sent in zip(
                reader.iter_decoded_messages(), messages(2500)):
            assert (channel.topic, message.data, message.log_time) == sent
            assert (message.publish_time, message.sequence) == (sent[2] - 5, 0)
            assert (schema.name, schema.encoding) == (TOPICS[channel.topic], 'ros2msg')
            assert schema.data.decode() == message_definition(schema.name).text
            if channel.topic == '/rank':
                ranks.append(value.data)
        assert ranks == list(range(2500))


def test_qos_and_hash_are_equal_in_metadata_and_channel(bag):
    mcap_reader = pytest.importorskip('mcap.reader')
    with (bag / 'metadata.yaml').open() as stream:
        content = yaml.safe_load(stream)['rosbag2_bagfile_information']
    with (bag / 'run_0.mcap').open('rb') as stream:
        channels = mcap_reader.make_reader(stream).get_summary().channels.values()
    stored = {channel.topic: channel for channel in channels}
    assert len(content['topics_with_message_count']) == 6
    for item in content['topics_with_message_count']:
        topic = item['topic_metadata']
        channel = stored[topic['name']]
        assert channel.message_encoding == topic['serialization_format'] == 'cdr'
        qos = yaml.safe_load(channel.metadata['offered_qos_profiles'])
        assert qos == topic['offered_qos_profiles']
        assert channel.metadata['topic_type_hash'] == topic['type_description_hash']
        assert topic['type_description_hash'] == embedded_definition(topic['type']).type_hash
    assert qos[0]['reliability'] == 'best_effort'


def test_metadata_has_the_keys_of_version_9_in_order(bag):
    text = (bag / 'metadata.yaml').read_text()
    assert '&' not in text.replace('"', '')
    content = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert list(content) == [
        'version', 'storage_identifier', 'duration', 'starting_time', 'message_count',
        'topics_with_message_count', 'compression_format', 'compression_mode',
        'relative_file_paths', 'files', 'custom_data', 'ros_distro']
    assert (content['version'], content['storage_identifier']) == (9, 'mcap')
    assert content['relative_file_paths'] == ['run_0.mcap']
    assert content['files'] == [{
        'path': 'run_0.mcap', 'starting_time': {'nanoseconds_since_epoch': START},
        'duration': {'nanoseconds': 2_499_000_040}, 'message_count': 12_500}]
    assert content['custom_data'] == CUSTOM
    assert content['ros_distro'] == 'jazzy'
    assert list(default_qos()[0]) == [
        'history', 'depth', 'reliability', 'durability', 'deadline', 'lifespan', 'liveliness',
        'liveliness_lease_duration', 'avoid_ros_namespace_conventions']


def test_metadata_record_stands_at_open_and_at_close(bag):
    mcap_reader = pytest.importorskip('mcap.reader')
    with (bag / 'run_0.mcap').open('rb') as stream:
        records = list(mcap_reader.make_reader(stream).iter_metadata())
    assert [record.name for record in records] == ['rosbag2', 'rosbag2']
    first, last = (yaml.safe_load(record.metadata['serialized_metadata']) for record in records)
    assert (first['message_count'], last['message_count']) == (0, 12_500)
    assert first['starting_time']['nanoseconds_since_epoch'] == 2**63 - 1
    assert last == yaml.safe_load((bag / 'metadata.yaml').read_text())[
        'rosbag2_bagfile_information']


def test_custom_data_survive_another_yaml_reader(bag):
    ruamel = pytest.importorskip('ruamel.yaml')
    content = ruamel.YAML(typ='safe').load((bag / 'metadata.yaml').read_text())
    assert content['rosbag2_bagfile_information']['custom_data'] == CUSTOM


def test_writer_refuses_wrong_use(tmp_path):
    with BagWriter(tmp_path / 'deep' / 'run') as writer:
        handle = writer.add_topic('/a', 'std_msgs/msg/Int32')
        assert writer.add_topic('/a', 'std_msgs/msg/Int32') == handle
        with pytest.raises(BagError, match="topic '/a' has type"):
            writer.add_topic('/a', 'std_msgs/msg/Float64')
        with pytest.raises(BagError, match='no definition'):
            writer.add_topic('/b', 'no_msgs/msg/Such')
        with pytest.raises(BagError, match="'/b' was not added"):
            writer.write('/b', b'', 0)
        with pytest.raises(BagError, match='expected 0 to'):
            writer.write('/a', encode_int32(1), -1)
        with pytest.raises(BagError, match="custom data 'k': 1 is a int"):
            writer.set_custom_data({'k': 1})
        writer.write('/a', encode_int32(1), 7)
    with pytest.raises(BagError, match='is closed'):
        writer.write('/a', encode_int32(1), 8)
    writer.close()
    assert read_bag(writer.path).topics['/a'].count == 1
    with pytest.raises(BagError, match='exists already'):
        BagWriter(writer.path)
    (tmp_path / 'file').touch()
    with pytest.raises(BagError, match='cannot be created'):
        BagWriter(tmp_path / 'file' / 'run')


def test_error_inside_the_context_keeps_what_was_written(tmp_path):
    def fail():
        with BagWriter(tmp_path / 'run') as writer:
            writer.add_topic('/a', 'std_msgs/msg/Int32')
            writer.write('/a', encode_int32(5), 7)
            writer.set_custom_data({'why': 'stopped'})
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    bag = read_bag(tmp_path / 'run')
    assert bag.complete
    assert bag.custom_data == {'why': 'stopped'}


WRITE_AND_DIE = """
import os, sys
from adaptive_blf_control.messages.cdr import encode_int32
from adaptive_blf_control.bags.writer import BagWriter
writer = BagWriter(sys.argv[1], custom_data={'k': 'v'})
writer.add_topic('/a', 'std_msgs/msg/Int32')
for i in range(700):
    writer.write('/a', encode_int32(i), 1000 + i)
    if i in (99, 499):
        writer.flush()
os._exit(9)
"""

FILL_THE_DISK = """
import resource, signal, sys
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
data = Float64MultiArrayCodec(1000).encode([0.5] * 1000)
with BagWriter(sys.argv[1]) as writer:
    writer.add_topic('/a', 'std_msgs/msg/Float64MultiArray')
    try:
        for i in range(100):
            writer.write('/a', data, i)
            if (i + 1) % int(sys.argv[2]) == 0:
                writer.flush()
    except BagError as exc:
        print(exc)
    try:
        writer.write('/a', data, 200)
    except BagError as exc:
        print(exc)
"""


BEGIN_ON_A_FULL_DISK = """
import resource, signal, sys
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300))
try:
    BagWriter(sys.argv[1])
except BagError as exc:
    print(exc)
"""


def run(script, *arguments, status=0):
    """Run a script in a process of its own and return what it printed."""
    done = subprocess.run([sys.executable, '-c', script, *map(str, arguments)], timeout=PATIENCE,
                          capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    return done.stdout


def test_killed_process_loses_nothing_that_was_flushed(tmp_path):
    run(WRITE_AND_DIE, tmp_path / 'run', status=9)
    bag = read_bag(tmp_path / 'run')
    assert not bag.complete
    assert 'truncated' in bag.problem
    times, values = bag.doubles('/a')
    assert values.tolist() == list(range(len(values)))
    assert len(values) >= 500
    assert times[0] == 1000
    assert bag.custom_data == {'k': 'v'}
    assert [topic.name for topic in load_metadata(tmp_path / 'run').topics] == ['/a']


@pytest.mark.parametrize('together', [1, 7, 1000])  # messages from flush to flush; 1000: none
def test_full_disk_is_reported_with_the_path_and_leaves_a_readable_bag(tmp_path, together):
    pytest.importorskip('resource')
    first, second = run(FILL_THE_DISK, tmp_path / 'run', together).splitlines()
    assert 'run_0.mcap: cannot be written' in first
    assert 'after a disk error' in second
    bag = read_bag(tmp_path / 'run')
    assert not bag.complete
    numbers = [message.log_time_ns for message in bag]
    assert len(numbers) >= 35
    assert numbers == list(range(len(numbers)))
    metadata = load_metadata(tmp_path / 'run')
    assert metadata.message_count == metadata.topics[0].message_count == len(numbers)
    assert metadata.files[0].duration_ns == numbers[-1]


def test_a_disk_that_is_full_from_the_start_is_reported_with_the_path(tmp_path):
    pytest.importorskip('resource')
    told = run(BEGIN_ON_A_FULL_DISK, tmp_path / 'run')
    assert 'run_0.mcap: cannot be written' in told


def test_what_is_flushed_with_fsync_and_what_is_closed_is_on_the_disk(tmp_path, monkeypatch):
    writer = BagWriter(tmp_path / 'run')
    writer.add_topic('/rank', TOPICS['/rank'])
    synced = synced_files(monkeypatch)
    writer.write('/rank', encode_int32(1), START)
    writer.flush()
    assert 'run_0.mcap' not in synced
    writer.flush(fsync=True)
    assert synced.count('run_0.mcap') == 1
    writer.close()
    assert synced.count('run_0.mcap') == 2


def test_a_bag_that_is_removed_or_replaced_while_it_is_written_is_told_with_the_next_flush(
        tmp_path):
    for change in (lambda file: file.unlink(), lambda file: file.rename(tmp_path / 'elsewhere'),
                   lambda file: (file.rename(tmp_path / 'mine'), file.touch())):
        writer = BagWriter(tmp_path / f'run{len(list(tmp_path.iterdir()))}')
        writer.add_topic('/rank', TOPICS['/rank'])
        writer.write('/rank', encode_int32(1), START)
        writer.flush()
        change(writer.file)
        with pytest.raises(BagError, match='was removed or renamed'):
            writer.flush()
        writer.close()


def test_the_duration_is_that_from_the_earliest_to_the_latest_message_whatever_their_order(
        tmp_path):
    with BagWriter(tmp_path / 'run') as writer:
        writer.add_topic('/rank', TOPICS['/rank'])
        for late in (5, 9, 2, 7):
            writer.write('/rank', encode_int32(late), START + late)
    (file,) = load_metadata(writer.path).files
    assert (file.start_ns, file.duration_ns) == (START + 2, 7)


@pytest.mark.parametrize('order', [(0, 1), (1, 0)])
def test_a_bag_begins_with_the_file_that_begins_first_and_ends_with_the_one_that_ends_last(order):
    files = (FileInformation('a.mcap', START, 1000, 3), FileInformation('b.mcap', START - 5, 7, 2))
    written = BagMetadata(tuple(files[i] for i in order)).to_dict()
    assert written['starting_time'] == {'nanoseconds_since_epoch': START - 5}
    assert written['duration'] == {'nanoseconds': 1005}
    assert written['message_count'] == 5


def test_a_long_recording_does_not_grow_and_has_the_index_of_every_chunk(tmp_path):
    mcap_reader = pytest.importorskip('mcap.reader')
    chunks = 600
    with BagWriter(tmp_path / 'long') as writer:
        for topic, type_name in TOPICS.items():
            writer.add_topic(topic, type_name)
        tracemalloc.start()
        try:
            for i in range(chunks):
                if i == 100:
                    settled = tracemalloc.get_traced_memory()[0]
                for topic in TOPICS:
                    writer.write(topic, encode_int32(i), START + i)
                writer.flush()
            grown = tracemalloc.get_traced_memory()[0] - settled
        finally:
            tracemalloc.stop()
    assert grown < 20_000  # the library's own list: 1 kB for each chunk
    with writer.file.open('rb') as stream:
        reader = mcap_reader.make_reader(stream)
        index = reader.get_summary().chunk_indexes
        ranks = [message.data for _, _, message in reader.iter_messages(['/rank'])]
    assert [(chunk.message_start_time, len(chunk.message_index_offsets)) for chunk in index] == [
        (START + i, len(TOPICS)) for i in range(chunks)]
    assert ranks == [encode_int32(i) for i in range(chunks)]
    assert sorted(path.name for path in writer.path.iterdir()) == ['long_0.mcap', 'metadata.yaml']


def test_a_discarded_bag_leaves_nothing_that_it_made_and_all_that_was_there(tmp_path):
    (tmp_path / 'mine').mkdir()
    writer = BagWriter(tmp_path / 'mine' / 'a' / 'b' / 'bag')
    for topic, type_name in TOPICS.items():
        writer.add_topic(topic, type_name)
    for topic, data, now in messages(100):
        writer.write(topic, data, now)
    writer.flush()
    writer.discard()
    assert [path.name for path in tmp_path.rglob('*')] == ['mine']
    with pytest.raises(BagError, match='is closed'):
        writer.write('/rank', encode_int32(1), START)
    writer.close()  # as a program does that closes whatever it has opened
    assert [path.name for path in tmp_path.rglob('*')] == ['mine']


def test_a_discarded_bag_leaves_what_others_put_beside_it_and_a_bag_that_was_renamed(tmp_path):
    writer = BagWriter(tmp_path / 'bag')
    (tmp_path / 'bag' / 'notes.txt').write_text('mine')
    writer.discard()
    assert [path.name for path in tmp_path.rglob('*')] == ['bag', 'notes.txt']
    renamed = BagWriter(tmp_path / 'before')
    (tmp_path / 'before').rename(tmp_path / 'after')
    other = BagWriter(tmp_path / 'before')
    renamed.discard()
    assert (tmp_path / 'after' / 'before_0.mcap').exists()
    assert other.file.exists()
    other.close()
