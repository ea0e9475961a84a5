# SPDX-License-Identifier: Apache-2.0
"""What is read and written in one compiled call is what the general way gives, byte for byte."""

import copy

import numpy as np
import pytest

from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.joint_state_reader import JointStateReader
from adaptive_blf_control.messages.usual_joint_state import (
    StandingJointStateCodec,
    UsualJointStateReader,
)

JOINTS = ('shoulder', 'elbow')


def message(names=JOINTS, stamp=3_000_000_500, fields=('position', 'velocity', 'effort'), seed=0):
    random = np.random.default_rng(seed)
    codec = JointStateCodec(names, 'arm#01234567', fields)
    return codec.encode(stamp, *(random.normal(size=len(names)) if field in fields else ()
                                 for field in ('position', 'velocity', 'effort')))


def outcome(reader, data):
    try:
        stamp, *arrays = reader.read(data)
    except BagError as error:
        return str(error)
    return stamp, reader.source, [array.tobytes() for array in arrays]


@pytest.mark.parametrize('names', [JOINTS, JOINTS[::-1], ('gripper', 'elbow', 'x', 'shoulder')])
@pytest.mark.parametrize('fields', [('position',), ('velocity', 'effort'),
                                    ('position', 'velocity', 'effort'), ()])
@pytest.mark.parametrize('stamp', [0, 3_000_000_500, (2**31 - 1) * 10**9 + 999_999_999, -7])
def test_later_message_of_a_layout_reads_as_the_general_reader_reads_it(names, fields, stamp):
    usual, general = UsualJointStateReader(JOINTS), JointStateReader(JOINTS)
    for seed in range(4):
        data = message(names, stamp, fields, seed)
        assert outcome(usual, data) == outcome(general, data)
        assert outcome(usual, data + b'123') == outcome(general, data + b'123')
        assert outcome(usual, bytearray(data)) == outcome(general, data)


def test_message_that_differs_in_any_byte_reads_as_the_general_reader_reads_it():
    data, general = message(), JointStateReader(JOINTS)
    usual = UsualJointStateReader(JOINTS)
    usual.read(data)
    for place in range(len(data)):
        for bit in (1, 128):
            other = bytearray(data)
            other[place] ^= bit
            assert outcome(usual, bytes(other)) == outcome(general, bytes(other)), place
    for size in range(len(data)):
        assert outcome(usual, data[:size]) == outcome(general, data[:size]), size


def test_arrays_stay_what_they_were_when_the_next_message_is_read():
    reader = UsualJointStateReader(JOINTS)
    reader.read(message(seed=0))
    kept = reader.read(message(seed=1))[1:]
    before = [array.copy() for array in kept]
    reader.read(message(seed=2))
    assert [array.tolist() for array in kept] == [array.tolist() for array in before]


def test_publishers_in_turn_are_told_apart():
    reader = UsualJointStateReader(JOINTS)
    messages = [message(), message(('elbow', 'shoulder'), seed=1)]
    expected = [outcome(JointStateReader(JOINTS), each) for each in messages]
    for _ in range(3):
        assert [outcome(reader, each) for each in messages] == expected


def test_copy_of_a_reader_reads_its_own_messages():
    reader = UsualJointStateReader(JOINTS)
    reader.read(message())
    other = copy.deepcopy(reader)
    for seed in range(3):
        data = message(seed=seed)
        assert outcome(other, data) == outcome(JointStateReader(JOINTS), data)


@pytest.mark.parametrize('fields', [('position',), ('position', 'velocity'),
                                    ('velocity', 'effort')])
def test_arrays_that_stand_are_written_as_they_are_now(fields):
    standing, general = (each(JOINTS, 'a', fields)
                         for each in (StandingJointStateCodec, JointStateCodec))
    random = np.random.default_rng(0)
    rows = random.normal(size=(3, 2))
    given = tuple(row if field in fields else () for row, field in zip(
        rows, ('position', 'velocity', 'effort')))
    for stamp in (0, 5, 10**9, (2**31 - 1) * 10**9 + 999_999_999, -3, np.int64(7)):
        rows[:] = random.normal(size=(3, 2))
        assert standing.encode(stamp, *given) == general.encode(stamp, *given)


def test_other_arrays_than_last_time_are_written():
    standing, general = StandingJointStateCodec(JOINTS), JointStateCodec(JOINTS)
    a, b = np.ones((3, 2)), np.full((2, 3), 2.0).T
    for given in ([*a], [*a], [*b], [*b], [*b.astype(np.float32)], [[1, 2]] * 3, [[1, 2]] * 3):
        for _ in range(3):
            assert standing.encode(4, *given) == general.encode(4, *given)


def test_stamp_or_length_that_does_not_fit_is_refused_for_standing_arrays():
    codec, values = StandingJointStateCodec(JOINTS, fields=('position',)), np.zeros(2)
    for _ in range(3):
        codec.encode(1, values)
    for stamp in (2**31 * 10**9, 1.5, 2**70):
        with pytest.raises(BagError, match='stamp'):
            codec.encode(stamp, values)
    with pytest.raises(BagError, match='3 values: expected 2'):
        codec.encode(1, np.zeros(3))
