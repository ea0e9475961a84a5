# SPDX-License-Identifier: Apache-2.0
"""CDR codecs against rosbags' and rclpy's serialisers, and against garbage."""

from __future__ import annotations

import contextlib
import pickle
import struct
import tracemalloc

import numpy as np
import pytest

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import (
    decode_float64,
    decode_float64_array,
    decode_int32,
    decode_joint_state,
    DECODERS,
    encode_float64,
    encode_int32,
    Float64MultiArrayCodec,
    JointStateCodec,
    JointStateReader,
)

hypothesis = pytest.importorskip('hypothesis')
typesys = pytest.importorskip('rosbags.typesys')
st = hypothesis.strategies
given = hypothesis.given

STORE = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
JOINT_STATE = 'sensor_msgs/msg/JointState'
FIELDS = ('position', 'velocity', 'effort')

names_lists = st.lists(st.text(st.characters(exclude_characters='\0', codec='utf-8'),
                               min_size=1, max_size=12), max_size=9, unique=True)
stamps = st.integers(-2**31 * 10**9, (2**31 - 1) * 10**9 + 999_999_999)


def reference(names, stamp_ns=0, frame_id='', position=(), velocity=(), effort=(), little=True):
    """Serialise a JointState with rosbags."""
    types = STORE.types
    stamp = types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    header = types['std_msgs/msg/Header'](stamp, frame_id)
    arrays = [np.array(field, dtype=np.float64) for field in (position, velocity, effort)]
    message = types[JOINT_STATE](header, list(names), *arrays)
    return bytes(STORE.serialize_cdr(message, JOINT_STATE, little_endian=little))


@given(names_lists, st.text(max_size=12).filter(lambda text: '\0' not in text), stamps,
       st.sets(st.sampled_from(FIELDS)), st.integers(0, 2**32 - 1))
def test_joint_state_codec_equals_rosbags_serialiser(names, frame_id, stamp_ns, fields, seed):
    rng = np.random.default_rng(seed)
    values = {field: rng.normal(size=len(names)) for field in fields}
    data = JointStateCodec(names, frame_id, tuple(fields)).encode(stamp_ns, **values)
    assert data == reference(names, stamp_ns, frame_id, **values)


@given(names_lists, stamps, st.sets(st.sampled_from(FIELDS)), st.booleans(), st.randoms())
def test_both_decoders_return_what_was_serialised(names, stamp_ns, fields, little, random):
    rng = np.random.default_rng(len(names))
    values = {field: rng.normal(size=len(names)) for field in fields}
    data = reference(names, stamp_ns, 'base', little=little, **values)
    record = decode_joint_state(data)
    assert (record.stamp_ns, record.frame_id, record.names) == (stamp_ns, 'base', tuple(names))
    joints = random.sample(names, random.randint(0, len(names)))
    order = [names.index(joint) for joint in joints]
    reader = JointStateReader(joints)
    for _ in range(2):  # the second time from the layout it remembers
        stamp, *arrays = reader.read(data)
        assert stamp == stamp_ns
        for field, array, whole in zip(FIELDS, arrays, record[3:]):
            expected = values.get(field, np.empty(0))
            np.testing.assert_array_equal(whole, expected)
            np.testing.assert_array_equal(
                array, expected[order] if len(expected) else np.full(len(joints), np.nan))


def test_template_holds_nothing_of_the_message_before():
    codec, joints = JointStateCodec(['a', 'bc'], 'f'), ['a', 'bc']
    first = codec.encode(1, [1.0, 2.0], [3.0, 4.0], [5.0, 6.0])
    second = codec.encode(-1, (7, 8), np.array([9.0, 10.0]), [np.nan, np.inf])
    assert first == reference(joints, 1, 'f', [1, 2], [3, 4], [5, 6])
    assert second == reference(joints, -1, 'f', [7, 8], [9, 10], [np.nan, np.inf])


def test_codec_refuses_what_does_not_fit():
    codec = JointStateCodec(['a', 'b'], fields=('position',))
    with pytest.raises(BagError, match='position has 1 values: expected 2'):
        codec.encode(0, [1.0])
    with pytest.raises(BagError, match='effort has 2 values: expected 0'):
        codec.encode(0, [1.0, 2.0], effort=[1.0, 2.0])
    with pytest.raises(BagError, match='stamp'):
        codec.encode(2**31 * 10**9, [1.0, 2.0])
    with pytest.raises(BagError, match="'b' more than once"):
        JointStateCodec(['a', 'b', 'b'])
    with pytest.raises(BagError, match='NUL'):
        JointStateCodec(['a\0'])
    with pytest.raises(BagError, match='no field'):
        JointStateCodec(['a'], fields=('positions',))


def test_reader_follows_publishers_of_different_layouts_in_turn():
    reader = JointStateReader(['b', 'a'])
    shuffled = [JointStateCodec(names, frame) for names, frame in
                ((['a', 'b'], ''), (['b', 'x', 'a'], ''), (['a', 'b'], 'base_link'))]
    for turn in range(4):
        for codec in shuffled:
            values = {'a': turn + 0.25, 'b': turn + 0.5, 'x': -1.0}
            row = [values[name] for name in codec.names]
            stamp, position, velocity, effort = reader.read(codec.encode(turn, row, row, row))
            assert stamp == turn
            for array in (position, velocity, effort):
                assert array.tolist() == [values['b'], values['a']]


def test_reader_returns_arrays_of_their_own():
    reader, codec = JointStateReader(['a']), JointStateCodec(['a'])
    first = reader.read(codec.encode(0, [1.0], [2.0], [3.0]))
    second = reader.read(codec.encode(0, [4.0], [5.0], [6.0]))
    second[1][0] = 7.0
    assert [array.tolist() for array in first[1:]] == [[1.0], [2.0], [3.0]]
    assert second[2].tolist() == [5.0]


def test_reader_names_what_is_wrong_also_after_good_messages():
    reader = JointStateReader(['a', 'b'])
    good = reference(['b', 'a'], position=[1, 2])
    assert reader.read(good)[1].tolist() == [2.0, 1.0]
    for data, words in (
            (reference(['b', 'c'], position=[1, 2]), "lacks joint 'a'"),
            (reference([], position=[1, 2]), "lacks joint 'a', 'b'"),
            (reference(['a', 'b', 'a'], position=[1, 2, 3]), "'a' more than once"),
            (reference(['b', 'a'], position=[1]), 'position has 1 values for 2 names'),
            (reference(['b', 'a'], effort=[1, 2, 3]), 'effort has 3 values for 2 names'),
            (good[:-1], 'truncated'), (b'', 'truncated'),
            (b'\0\7\0\0' + good[4:], 'representation')):
        with pytest.raises(BagError, match=words):
            reader.read(data)
    assert reader.read(good)[1].tolist() == [2.0, 1.0]


def test_publisher_that_leaves_arrays_empty_now_and_then_is_read_as_each_message_is():
    reader = JointStateReader(['a', 'b'])
    for turn in range(3):
        for fields in (FIELDS, ('position',), ('position', 'effort'), ('velocity',), ()):
            for names in (['a', 'b'], ['b', 'x', 'a']):
                values = {field: turn + np.arange(len(names)) for field in fields}
                _, *arrays = reader.read(JointStateCodec(names, 'f', fields).encode(0, **values))
                for field, array in zip(FIELDS, arrays):
                    expected = [turn + names.index(joint) if field in fields else np.nan
                                for joint in ('a', 'b')]
                    np.testing.assert_array_equal(array, expected)


def test_name_that_is_not_utf8_stays_distinct():
    data = reference(['a1', 'a2'], position=[1, 2])
    data = data.replace(b'a1\0', b'a\xfe\0').replace(b'a2\0', b'a\xff\0')
    assert decode_joint_state(data).names == ('a\\xfe', 'a\\xff')
    assert JointStateReader(['a\\xff']).read(data)[1].tolist() == [2.0]


def test_every_truncation_is_refused():
    data = JointStateCodec(['a', 'bcd'], 'f').encode(5, [1.0, 2.0], [3.0, 4.0], [5.0, 6.0])
    reader = JointStateReader(['a', 'bcd'])
    reader.read(data)
    for size in range(len(data)):
        with pytest.raises(BagError):
            decode_joint_state(data[:size])
        with pytest.raises(BagError):
            reader.read(data[:size])


@given(st.lists(st.floats(), max_size=9))
def test_float64_array_equals_rosbags_serialiser(values):
    data = Float64MultiArrayCodec(len(values)).encode(values)
    layout = STORE.types['std_msgs/msg/MultiArrayLayout']([], 0)
    message = STORE.types['std_msgs/msg/Float64MultiArray'](layout, np.array(values, dtype=float))
    for little in (True, False):
        expected = bytes(STORE.serialize_cdr(message, 'std_msgs/msg/Float64MultiArray',
                                             little_endian=little))
        np.testing.assert_array_equal(decode_float64_array(expected), values)
        assert data == expected or not little


def test_float64_array_with_a_layout_is_read():
    dimension = STORE.types['std_msgs/msg/MultiArrayDimension']
    layout = STORE.types['std_msgs/msg/MultiArrayLayout'](
        [dimension('rows', 1, 3), dimension('c', 3, 3)], 0)
    message = STORE.types['std_msgs/msg/Float64MultiArray'](layout, np.array([1.0, 2.0, 3.0]))
    data = bytes(STORE.serialize_cdr(message, 'std_msgs/msg/Float64MultiArray'))
    assert decode_float64_array(data).tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(BagError, match='gets 2 values: expected 3'):
        Float64MultiArrayCodec(3).encode([1.0, 2.0])


@given(st.floats(allow_nan=False), st.integers(-2**31, 2**31 - 1))
def test_scalars_equal_rosbags_serialiser(number, integer):
    for value, kind, encode, decode in ((number, 'Float64', encode_float64, decode_float64),
                                        (integer, 'Int32', encode_int32, decode_int32)):
        name = f'std_msgs/msg/{kind}'
        data = bytes(STORE.serialize_cdr(STORE.types[name](value), name))
        assert encode(value) == data
        assert decode(data) == value
    with pytest.raises(BagError, match='Int32'):
        encode_int32(2**31)


def refuse_or_decode(data):
    """Run every decoder; anything but a result or a BagError fails the test."""
    reader = JointStateReader(['joint1', 'joint2'])
    reader.read(JointStateCodec(['joint1', 'joint2']).encode(0, [1, 2], [3, 4], [5, 6]))
    for decode in (*DECODERS.values(), reader.read, JointStateReader(['joint1']).read):
        with contextlib.suppress(BagError):
            decode(data)


@given(st.binary(max_size=300))
def test_random_bytes_raise_nothing_but_bag_errors(data):
    refuse_or_decode(data)
    refuse_or_decode(b'\0\1\0\0' + data)


@given(st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 7)), min_size=1, max_size=6),
       st.integers(0, 200))
def test_flipped_bits_raise_nothing_but_bag_errors(flips, cut):
    data = bytearray(reference(['joint1', 'joint2'], 7, 'base', [1, 2], [3, 4], [5, 6]))
    for position, bit in flips:
        data[position % len(data)] ^= 1 << bit
    refuse_or_decode(bytes(data[:len(data) - cut % len(data)]))


@given(st.integers(1, 50), st.integers(0, 2**32 - 1))
def test_a_word_of_any_value_raises_nothing_but_bag_errors(word, value):
    data = bytearray(reference(['joint1', 'joint2'], 7, 'base', [1, 2], [3, 4], [5, 6]))
    struct.pack_into('<I', data, 4 * (word % (len(data) // 4)), value)
    refuse_or_decode(bytes(data))


@pytest.mark.parametrize('claimed', [1000, 2**31, 2**32 - 1])
@pytest.mark.parametrize('what', ['name', 'position', 'velocity', 'effort'])
def test_a_count_beyond_the_message_is_refused_without_memory(what, claimed):
    whole = reference(['joint1', 'joint2'], 7, 'base', [1, 2], [3, 4], [5, 6])
    counts = [at for at in range(4, len(whole) - 3, 4) if whole[at:at + 4] == b'\2\0\0\0']
    assert len(counts) == 4
    data = bytearray(whole)
    struct.pack_into('<I', data, counts[['name', *FIELDS].index(what)], claimed)
    reader = JointStateReader(['joint1', 'joint2'])
    reader.read(whole)  # one that knows the layout, too
    tracemalloc.start()
    try:
        for decode in (decode_joint_state, JointStateReader(['joint1']).read, reader.read):
            with pytest.raises(BagError):
                decode(bytes(data))
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 100_000


def test_an_array_of_more_numbers_than_bytes_is_refused_without_memory():
    data = bytearray(Float64MultiArrayCodec(2).encode([1.0, 2.0]))
    struct.pack_into('<I', data, 12, 2**31)
    tracemalloc.start()
    try:
        with pytest.raises(BagError, match='truncated'):
            decode_float64_array(bytes(data))
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 100_000


def test_what_is_read_of_a_message_is_the_readers_own_each_time():
    reader = JointStateReader(['b', 'a'])
    data = reference(['a', 'b'], 7, 'base', [1, 2])
    for _ in range(3):  # of a new layout, then of a known one
        _, position, velocity, effort = reader.read(data)
        assert position.tolist() == [2.0, 1.0]
        assert np.isnan([velocity, effort]).all()
        for array in (position, velocity, effort):
            array[:] = 7.0  # that of the next message is another
    torque = decode_float64_array(Float64MultiArrayCodec(2).encode([1.0, 2.0]))
    torque[:] = 7.0  # may be written to


def test_publishers_without_number_do_not_make_a_reader_grow():
    reader = JointStateReader(['a'])
    sizes = []
    for k in range(200):
        reader.read(reference(['a'], 7, f'publisher {k:03d}', [1.0]))
        sizes.append(len(pickle.dumps(reader)))
    assert max(sizes[50:]) == sizes[50]


def test_message_serialised_by_rclpy_is_read():
    serialization = pytest.importorskip('rclpy.serialization')
    sensor_msgs = pytest.importorskip('sensor_msgs.msg')
    message = sensor_msgs.JointState(name=['elbow', 'wrist_1'])
    message.header.stamp.sec, message.header.frame_id = 5, 'w'
    message.position, message.effort = [1.0, 2.0], [3.0, 4.0]
    data = serialization.serialize_message(message)  # garbage in its padding and behind its end
    record = decode_joint_state(data)
    assert record[:3] == (5 * 10**9, 'w', ('elbow', 'wrist_1'))
    reader = JointStateReader(['wrist_1'])
    for _ in range(2):
        stamp_ns, position, velocity, effort = reader.read(data)
        assert (stamp_ns, position.tolist(), effort.tolist()) == (5 * 10**9, [2.0], [4.0])
        assert np.isnan(velocity).all()


def test_rclpy_reads_what_the_codec_writes():
    serialization = pytest.importorskip('rclpy.serialization')
    sensor_msgs = pytest.importorskip('sensor_msgs.msg')
    data = JointStateCodec(['elbow', 'w'], 'base').encode(1_500_000_000, [1, 2], [3, 4], [5, 6])
    message = serialization.deserialize_message(data, sensor_msgs.JointState)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    assert (message.header.frame_id, message.name) == ('base', ['elbow', 'w'])
    assert [list(message.position), list(message.velocity), list(message.effort)] == [
        [1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
