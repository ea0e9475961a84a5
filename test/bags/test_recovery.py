# SPDX-License-Identifier: Apache-2.0
"""A bag that a crash left unfinished becomes one that other libraries read, byte for byte."""

from __future__ import annotations

import hashlib
from pathlib import Path
import shutil

import pytest
import yaml

from adaptive_blf_control.bags.mcap_file import McapFile
from adaptive_blf_control.bags.metadata import default_qos, load_metadata
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bags.recovery import KEPT_NAME, recover_bag
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import encode_float64, encode_int32, Float64MultiArrayCodec
from adaptive_blf_control.tools import recover

START = 1_700_000_000_000_000_000
TYPES = {'/commands': 'std_msgs/msg/Float64MultiArray', '/sigma': 'std_msgs/msg/Float64',
         '/rank': 'std_msgs/msg/Int32'}
CUSTOM = {'ros__parameters': 'a: 1\nb: "x" # ü\n', 'number': '1e5'}


def _messages(count: int) -> list[tuple[str, bytes, int]]:
    commands = Float64MultiArrayCodec(2)
    return [message for i in range(count) for message in (
        ('/commands', commands.encode([i, -i]), START + i * 1_000_000),
        ('/sigma', encode_float64(0.1 * i), START + i * 1_000_000 + 7),
        ('/rank', encode_int32(i), START + i * 1_000_000 + 9))]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Write a bag of several chunks whose custom data came late, as the recorder's do."""
    with BagWriter(tmp_path / 'run') as writer:
        for topic, type_name in TYPES.items():
            writer.add_topic(topic, type_name, qos=default_qos(
                'best_effort' if topic == '/sigma' else 'reliable', 'transient_local'))
        for i, (topic, data, now) in enumerate(_messages(2000)):
            if i == 3000:
                writer.set_custom_data(CUSTOM)
                writer.flush()
            writer.write(topic, data, now, now - 5)
    return writer.path


def _cut(bag: Path, size: int) -> bytes:
    file = bag / 'run_0.mcap'
    file.write_bytes(file.read_bytes()[:size])
    return file.read_bytes()


def _with_rosbags(bag: Path) -> list[tuple[str, bytes, int]]:
    highlevel = pytest.importorskip('rosbags.highlevel')
    typesys = pytest.importorskip('rosbags.typesys')
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    with highlevel.AnyReader([bag], default_typestore=store) as reader:
        for connection in reader.connections:
            assert connection.msgtype == TYPES[connection.topic]
        return [(connection.topic, bytes(data), now)
                for connection, now, data in reader.messages()]


def test_metadata_is_rebuilt_from_the_file_alone(bag: Path) -> None:
    before = load_metadata(bag).to_dict()
    file = (bag / 'run_0.mcap').read_bytes()
    (bag / 'metadata.yaml').unlink()
    done = recover_bag(bag)
    assert done == (bag, 'metadata', 6_000, None)
    assert load_metadata(bag).to_dict() == before
    assert (bag / 'run_0.mcap').read_bytes() == file
    assert _with_rosbags(bag) == _messages(2000)
    assert recover_bag(bag).what == 'whole'


def test_metadata_that_says_otherwise_is_replaced_and_kept(bag: Path) -> None:
    right = load_metadata(bag).to_dict()
    text = (bag / 'metadata.yaml').read_text()
    old = text.replace('message_count: 2000', 'message_count: 3')
    (bag / 'metadata.yaml').write_text(old)
    assert recover_bag(bag).what == 'metadata'
    assert load_metadata(bag).to_dict() == right
    assert (bag / KEPT_NAME).read_text() == old


@pytest.mark.parametrize('part', [0.5, 0.8, 0.999])
def test_truncated_bag_becomes_a_finished_copy_up_to_the_break(bag: Path, part: float) -> None:
    size = int(part * (bag / 'run_0.mcap').stat().st_size)
    original = _cut(bag, size)
    metadata = (bag / 'metadata.yaml').read_bytes()
    done = recover_bag(bag)
    assert (done.path, done.what) == (bag.with_name('run_recovered'), 'copy')
    assert done.problem is not None
    assert 'run_0.mcap' in done.problem
    read = _with_rosbags(done.path)
    assert read == _messages(2000)[:len(read)]
    assert len(read) == done.messages >= int(5_500 * part)
    assert (bag / 'run_0.mcap').read_bytes() == original
    assert (bag / 'metadata.yaml').read_bytes() == metadata
    assert read_bag(done.path).complete


def test_copy_keeps_custom_data_qos_hashes_and_times_of_sending(bag: Path) -> None:
    whole = McapFile(bag / 'run_0.mcap')
    sent = list(whole.timed_messages())
    _cut(bag, int(0.9 * (bag / 'run_0.mcap').stat().st_size))
    (bag / 'metadata.yaml').unlink()
    copy = McapFile(recover_bag(bag).path / 'run_recovered_0.mcap')
    again = list(copy.timed_messages())
    assert again == sent[:len(again)]
    assert copy.custom_data() == CUSTOM
    assert copy.details == whole.details
    qos = yaml.safe_load(copy.details[2].metadata['offered_qos_profiles'])
    assert (qos[0]['reliability'], qos[0]['durability']) == ('best_effort', 'transient_local')
    assert load_metadata(recover_bag(bag, bag.parent / 'other').path).custom_data == CUSTOM


def test_a_file_cut_in_its_closing_bytes_is_finished_without_a_loss(bag: Path) -> None:
    _cut(bag, (bag / 'run_0.mcap').stat().st_size - 1)
    done = recover_bag(bag)
    assert (done.what, done.messages) == ('copy', 6_000)
    assert _with_rosbags(done.path) == _messages(2000)


def test_a_lone_file_becomes_a_bag_folder(bag: Path, tmp_path: Path) -> None:
    lone = tmp_path / 'alone.mcap'
    shutil.copy(bag / 'run_0.mcap', lone)
    done = recover_bag(lone)
    assert done.path == tmp_path / 'alone_recovered'
    assert done.problem is None
    assert _with_rosbags(done.path) == _messages(2000)


def test_files_of_a_split_bag_are_joined_in_order(bag: Path) -> None:
    with BagWriter(bag.parent / 'later') as writer:
        writer.add_topic('/rank', TYPES['/rank'])
        writer.write('/rank', encode_int32(77), START + 10**10)
    shutil.move(writer.file, bag / 'run_1.mcap')
    assert recover_bag(bag).what == 'metadata'
    metadata = load_metadata(bag)
    assert [item.path for item in metadata.files] == ['run_0.mcap', 'run_1.mcap']
    assert metadata.message_count == 6_001
    done = recover_bag(bag, bag.parent / 'joined')
    assert _with_rosbags(done.path)[-1] == ('/rank', encode_int32(77), START + 10**10)


def test_exit_status_tells_complete_from_partial_from_no_recovery(
        bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    digest = hashlib.sha256((bag / 'run_0.mcap').read_bytes()).hexdigest()
    assert recover.main([str(bag)]) == 0
    assert 'is complete' in capsys.readouterr().out
    assert hashlib.sha256((bag / 'run_0.mcap').read_bytes()).hexdigest() == digest
    _cut(bag, 150_000)
    assert recover.main([str(bag)]) == 1
    output = capsys.readouterr()
    assert 'run_recovered: finished copy' in output.out
    assert 'truncated' in output.err
    assert recover.main([str(bag)]) == 2  # the copy is there already
    _cut(bag, 100)
    for hopeless in (bag, tmp_path / 'nothing', tmp_path):
        assert recover.main([str(hopeless)]) == 2
    assert capsys.readouterr().err.count('recover: ') == 4


def test_what_rosbag2_does_not_write_is_refused_by_name(tmp_path: Path) -> None:
    mcap_writer = pytest.importorskip('mcap.writer')
    file = tmp_path / 'json.mcap'
    with file.open('wb') as stream:
        writer = mcap_writer.Writer(stream)
        writer.start()
        schema = writer.register_schema('Thing', 'jsonschema', b'{}')
        channel = writer.register_channel('/thing', 'json', schema)
        writer.add_message(channel, START, b'{}', START)
        writer.finish()
    with pytest.raises(BagError, match=r"'/thing' has encoding 'json'.*expected 'cdr'"):
        recover_bag(file)
