# SPDX-License-Identifier: Apache-2.0
"""An arm whose joints come in several messages is put together again."""

from __future__ import annotations

import os
from pathlib import Path
import tracemalloc

import numpy as np
import pytest

from adaptive_blf_control.bags import row_store
from adaptive_blf_control.bags.reader import read_bag
from adaptive_blf_control.bags.row_store import keep_rows, new_table, row_blocks, RowStore
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.joint_state import JointStateCodec

MS = 1_000_000


def write(folder, *parts):
    """Write (names, stamps [ms]) on one topic: position t, velocity 2 t, effort 3 t, in s."""
    messages = sorted((stamp, index) for index, (_, stamps) in enumerate(parts)
                      for stamp in stamps)
    with BagWriter(folder) as writer:
        writer.add_topic('/js', 'sensor_msgs/msg/JointState')
        for stamp, index in messages:
            names = parts[index][0]
            value = [1e-3 * stamp] * len(names)
            writer.write('/js', JointStateCodec(names).encode(
                round(stamp * MS), value, np.multiply(2, value), np.multiply(3, value)),
                round(stamp * MS))
    return read_bag(folder)


def test_parts_with_stamps_of_their_own_are_interpolated_to_the_slowest(tmp_path):
    bag = write(tmp_path / 'run', (['b', 'grip'], range(0, 40, 4)), (['c', 'a'], range(1, 41, 2)))
    series = bag.joint_states('js', ['a', 'b', 'c'], skip_foreign=True)
    assert series.names == ('a', 'b', 'c')
    assert series.stamp_ns.tolist() == [4 * i * MS for i in range(10)]
    for factor, values in zip((1, 2, 3), (series.position, series.velocity, series.effort)):
        assert np.isnan(values[0, [0, 2]]).all()  # nothing before it
        np.testing.assert_allclose(values[1:], np.repeat(
            factor * 4e-3 * np.arange(1, 10)[:, None], 3, axis=1), rtol=1e-12)


def test_equal_stamps_are_joined_exactly_and_gaps_are_not_bridged(tmp_path):
    fast = [t for t in range(40) if not 20 <= t < 30]
    bag = write(tmp_path / 'run', (['a'], range(0, 40, 2)), (['b'], fast))
    series = bag.joint_states('js', ['a', 'b'], skip_foreign=True)
    there = np.isfinite(series.position[:, 1])
    assert (~there).nonzero()[0].tolist() == [10, 11, 12, 13, 14]
    np.testing.assert_array_equal(series.position[there, 0], series.position[there, 1])


def test_a_joint_in_no_message_is_named_and_a_whole_message_is_preferred(tmp_path):
    bag = write(tmp_path / 'run', (['a'], range(10)), (['b'], range(10)))
    with pytest.raises(BagError, match="/js message 0: JointState lacks joint 'b', 'c'"):
        bag.joint_states('js', ['a', 'b', 'c'], skip_foreign=True)
    with pytest.raises(BagError, match="lacks joint 'b'"):
        bag.joint_states('js', ['a', 'b'])
    bag = write(tmp_path / 'whole', (['a'], range(10)), (['a', 'b'], range(0, 10, 5)))
    series = bag.joint_states('js', ['a', 'b'], skip_foreign=True)
    assert (len(series.stamp_ns), series.skipped) == (2, 10)


def test_topic_without_schema_or_of_another_type(tmp_path):
    mcap_writer = pytest.importorskip('mcap.writer')
    data = JointStateCodec(['a']).encode(5, [1.0], [2.0], [3.0])
    dynamic = 'control_msgs/msg/DynamicJointState'
    for encoding, schema, words in (
            ('cdr', '', ''),
            ('cdr', 'std_msgs/msg/Int32', "has type 'std_msgs/msg/Int32': expected sensor"),
            ('ros1', 'sensor_msgs/msg/JointState', "encoded as 'ros1': expected 'cdr', .* 'json'"),
            ('json', dynamic, f"encoded as 'json': expected 'cdr', .* for {dynamic}")):
        with (tmp_path / 'x.mcap').open('wb') as stream:
            writer = mcap_writer.Writer(stream)
            writer.start('ros2', 'test')
            number = writer.register_schema(schema, 'ros2msg', b'') if schema else 0
            writer.add_message(writer.register_channel('/js', encoding, number), 1, data, 1)
            writer.finish()
        bag = read_bag(tmp_path / 'x.mcap')
        if not schema:
            assert bag.joint_states('js').effort.tolist() == [[3.0]]
            continue
        with pytest.raises(BagError, match=words):
            bag.joint_states('js')


@pytest.mark.parametrize('limit', [1, 1 << 30])
def test_rows_come_back_from_memory_and_from_the_disk(limit):
    rows = np.arange(3.0 * 10_000).reshape(-1, 3)
    store = RowStore(3, limit)
    for row in rows:
        store.append(row)
    assert len(store) == len(rows)
    table = store.table()
    np.testing.assert_array_equal(table, rows)
    keep = rows[:, 0] % 7 != 0
    np.testing.assert_array_equal(keep_rows(table, keep), rows[keep])


def test_a_store_keeps_no_copy_of_the_rows_of_its_table():
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        store, row = RowStore(20), np.arange(20.0)
        for _ in range(25 * row_store.BLOCK_ROWS):  # 16 MB
            store.append(row)
        table = store.table()
        held = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert table.nbytes <= held < 1.2 * table.nbytes


def test_a_full_disk_is_a_bag_error(monkeypatch):
    def full():
        raise OSError(28, 'No space left on device')
    monkeypatch.setattr(row_store.tempfile, 'TemporaryFile', full)
    store = RowStore(1, 1)
    for _ in range(row_store.BLOCK_ROWS - 1):
        store.append([0.0])
    with pytest.raises(BagError, match='No space left'):
        store.append([0.0])


def resident() -> int:
    """Return the memory of this process [bytes]."""
    return int(Path('/proc/self/statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE')


def test_rows_of_a_large_table_that_were_passed_leave_the_memory_and_keep_their_values():
    table = new_table(400_000, 20, limit=1)  # 64 MB
    before, most = resident(), 0
    for some in row_blocks(table):
        table[some] = np.arange(some.start, some.stop)[:len(table[some]), None]
        most = max(most, resident() - before)
    assert most < 0.6 * table.nbytes
    assert resident() - before < 0.1 * table.nbytes
    for some in row_blocks(table):
        assert (table[some][:, 7] == np.arange(some.start, some.stop)[:len(table[some])]).all()


def test_a_disk_without_room_for_a_table_is_a_bag_error(monkeypatch):
    def full(*_):
        raise OSError(28, 'No space left on device')
    monkeypatch.setattr(row_store.os, 'posix_fallocate', full)
    with pytest.raises(BagError, match='No space left'):
        new_table(10, 1, limit=1)
