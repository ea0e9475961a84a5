# SPDX-License-Identifier: Apache-2.0
"""Measured logs from bags and CSV files, good and bad."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.bags.logs import read_log
from adaptive_blf_control.bags.row_store import BLOCK_ROWS
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import LogError
from adaptive_blf_control.messages.cdr import encode_int32, JointStateCodec

JOINT_STATE = 'sensor_msgs/msg/JointState'
HEADER = 't,q1,q2,qd1,qd2,tau1,tau2'
ROWS = ['0,1,2,3,4,5,6', '0.5,1,2,3,4,5,6', '1,7,8,9,10,11,12']


def write_bag(path, rows, *, names=('a', 'b'), topic='/joint_states', more=()):
    """Write rows of (stamp, log time, 3n numbers) and messages (topic, type, data) after them."""
    codec, n = JointStateCodec(names), len(names)
    with BagWriter(path) as writer:
        writer.add_topic(topic, JOINT_STATE)
        for stamp, now, values in rows:
            writer.write(topic, codec.encode(stamp, values[:n], values[n:2 * n], values[2 * n:]),
                         now)
        for name, type_name, data in more:
            writer.add_topic(name, type_name)
            writer.write(name, data, 10**9)
    return path


def write_csv(path, *lines):
    """Write lines and return the path."""
    path.write_text('\n'.join(lines) + '\n')
    return path


def numbers(count, width=6):
    """Return rows of different finite numbers, shape (count, width)."""
    return np.arange(float(count * width)).reshape(count, width)


def test_bag_is_read_by_name_with_time_from_its_first_stamp(tmp_path):
    start, table = 1_700_000_000_000_000_000, numbers(4)
    rows = [(start + i * 1_000_001, 5 + i, row) for i, row in enumerate(table)]
    log = read_log(write_bag(tmp_path / 'run', rows), joints=['b', 'a'])
    assert log.joints == ('b', 'a')
    assert log.t.tolist() == [0.0, 0.001000001, 0.002000002, 0.003000003]
    np.testing.assert_array_equal(log.q, table[:, [1, 0]])
    np.testing.assert_array_equal(log.qd, table[:, [3, 2]])
    np.testing.assert_array_equal(log.tau, table[:, [5, 4]])
    assert (log.dropped, log.problem) == (0, None)


def test_log_time_serves_where_all_stamps_are_zero(tmp_path):
    rows = [(0, 10**9 * i, row) for i, row in enumerate(numbers(3))]
    assert read_log(write_bag(tmp_path / 'run', rows)).t.tolist() == [0.0, 1.0, 2.0]


def test_log_time_serves_where_stamps_have_whole_seconds(tmp_path):
    times, table = 10**9 + 10**8 * np.arange(40), numbers(40)
    whole = [(int(now) // 10**9 * 10**9, int(now), row) for now, row in zip(times, table)]
    log = read_log(write_bag(tmp_path / 'run', whole))
    np.testing.assert_allclose(log.t, 0.1 * np.arange(40))
    assert log.notes == ('the stamp is that of the message before in 90% of the messages, whose '
                         'positions are others: times of reception are used',)
    thrice = [(int(now), int(now) + k, row) for now, row in zip(times, table) for k in range(3)]
    log = read_log(write_bag(tmp_path / 'thrice', thrice))
    np.testing.assert_allclose(log.t, 0.1 * np.arange(40))
    assert log.dropped == 80


def test_bad_rows_are_dropped_and_counted(tmp_path):
    table = numbers(9)
    table[2, 1], table[3, 5] = np.nan, np.inf
    stamps = [1, 2, 3, 4, 5, 5, 4, 6, 7]  # repeats, then goes back
    gripper = JointStateCodec(['finger']).encode(8, [0.0], [0.0], [0.0])
    rows = [(stamp * 10**9, 0, row) for stamp, row in zip(stamps, table)]
    bag = write_bag(tmp_path / 'run', rows, more=[('/joint_states', JOINT_STATE, gripper)])
    log = read_log(bag)
    assert log.t.tolist() == [0.0, 1.0, 4.0, 5.0, 6.0]
    np.testing.assert_array_equal(log.q, table[[0, 1, 4, 7, 8], :2])
    assert log.dropped == 5
    lines = [','.join(map(str, (stamp, *row))) for stamp, row in zip(stamps, table)]
    csv = read_log(write_csv(tmp_path / 'log.csv', HEADER, *lines))
    assert (csv.t.tolist(), csv.dropped) == ([0.0, 1.0, 4.0, 5.0, 6.0], 4)


def test_topic_is_chosen_or_the_candidates_are_named(tmp_path):
    rows = [(i, i, row) for i, row in enumerate(numbers(3))]
    other = ('/theta_hat', JOINT_STATE, JointStateCodec(['m'], fields=['position']).encode(0, [1]))
    assert read_log(write_bag(tmp_path / 'a', rows, topic='/arm/js')).q.shape == (3, 2)
    assert read_log(write_bag(tmp_path / 'b', rows, more=[other])).q.shape == (3, 2)
    two = write_bag(tmp_path / 'c', rows, topic='/arm/js', more=[other])
    with pytest.raises(LogError, match=r'one of /arm/js, /theta_hat'):
        read_log(two)
    assert read_log(two, topic='arm/js').q.shape == (3, 2)
    with pytest.raises(LogError, match="no effort|no velocity for joint 'm'"):
        read_log(two, topic='/theta_hat')
    with pytest.raises(LogError, match='no topic'):
        read_log(two, topic='/none')
    with BagWriter(tmp_path / 'd') as writer:
        writer.add_topic('/n', 'std_msgs/msg/Int32')
        writer.write('/n', encode_int32(1), 0)
    with pytest.raises(LogError, match='no topic of type'):
        read_log(tmp_path / 'd')


def test_bag_errors_name_bag_joint_and_count(tmp_path):
    rows = [(i, i, row) for i, row in enumerate(numbers(3))]
    path = write_bag(tmp_path / 'run', rows)
    with pytest.raises(LogError, match=r"run: /?joint_states message 0: .* lacks joint 'z'"):
        read_log(path, joints=['a', 'z'])
    with pytest.raises(LogError, match='2 usable rows of 2'):
        read_log(write_bag(tmp_path / 'short', rows[:2]))
    with pytest.raises(LogError, match='missing'):
        read_log(tmp_path / 'missing')
    codec = JointStateCodec(['a'], fields=['position', 'velocity'])
    with BagWriter(tmp_path / 'free') as writer:
        writer.add_topic('/joint_states', JOINT_STATE)
        for i in range(5):
            writer.write('/joint_states', codec.encode(i, [1.0], [2.0]), i)
    with pytest.raises(LogError, match="no effort for joint 'a'"):
        read_log(tmp_path / 'free')


@pytest.mark.parametrize(('field', 'words'), [
    (0, 'no position for joint'), (1, 'no velocity for joint'), (2, 'no effort for joint')])
def test_a_joint_without_a_number_in_any_message_is_named(tmp_path, field, words):
    """Though the other joint has one in each, and this one has other values."""
    table = numbers(5)
    table[:, 2 * field + 1] = np.nan
    path = write_bag(tmp_path / 'run', [(i, i, row) for i, row in enumerate(table)])
    with pytest.raises(LogError, match=f"{words} 'b' in any message"):
        read_log(path)


def test_a_joint_whose_numbers_begin_late_has_some(tmp_path):
    """After more rows than are looked at together."""
    table = numbers(BLOCK_ROWS + 9)
    table[:BLOCK_ROWS + 4, 5] = np.nan
    rows = [(10**6 * i, i, row) for i, row in enumerate(table)]
    log = read_log(write_bag(tmp_path / 'run', rows))
    np.testing.assert_array_equal(log.tau, table[BLOCK_ROWS + 4:, 4:])


def test_truncated_bag_is_told(tmp_path):
    path = write_bag(tmp_path / 'run', [(i, i, row) for i, row in enumerate(numbers(50))])
    file = path / 'run_0.mcap'
    file.write_bytes(file.read_bytes()[:7000])
    log = read_log(path)
    assert 3 <= len(log.t) < 50
    assert 'truncated' in log.problem


def test_csv_columns_in_any_order_with_others_between(tmp_path):
    path = write_csv(tmp_path / 'log.csv', '\ufefftau2,q1, t,note,q2,qd2,qd1,tau1',
                     *(f'6,1,{i},x,2,4,3,5' for i in range(3)), '')
    log = read_log(path, joints=('left', 'right'))
    assert log.joints == ('left', 'right')
    assert log.t.tolist() == [0.0, 1.0, 2.0]
    assert [part[0].tolist() for part in (log.q, log.qd, log.tau)] == [[1, 2], [3, 4], [5, 6]]
    assert read_log(path).joints == ('joint1', 'joint2')


@pytest.mark.parametrize(('lines', 'words'), [
    ([], 'is empty'),
    (['t,q1,q2,qd1,tau1,tau2', *ROWS], 'missing column qd2'),
    (['q1,qd1,tau1', '1,2,3'], 'missing column t'),
    (['t,q1,qd1', '0,1,2'], 'no effort'),
    (['t,q1,q1,qd1,tau1', '0,1,1,2,3'], "'q1'.* more than once"),
    ([HEADER, ROWS[0], '0.5,1,2,x,4,5,6', ROWS[2]], "row 3, column 'qd1': 'x' is not a number"),
    ([HEADER, ROWS[0], '0.5,1,2', ROWS[2]], 'row 3 has 3 cells: expected 7'),
    ([HEADER, *ROWS[:2]], '2 usable rows of 2'),
    ([HEADER, *ROWS[:2], 'nan,1,2,3,4,5,6'], '2 usable rows of 3'),
    ([HEADER], '0 usable rows of 0')])
def test_bad_csv_is_refused_with_row_and_column(tmp_path, lines, words):
    path = write_csv(tmp_path / 'log.csv', *lines)
    with pytest.raises(LogError, match=words) as caught:
        read_log(path)
    assert str(path) in str(caught.value)


def test_csv_that_cannot_be_read_and_names_that_do_not_fit(tmp_path):
    path = write_csv(tmp_path / 'log.csv', HEADER, *ROWS)
    for names in (['a'], ['a', 'a'], ['a', 'b', 'c']):
        with pytest.raises(LogError, match='different names'):
            read_log(path, joints=names)
    with pytest.raises(LogError, match='cannot be read'):
        read_log(tmp_path / 'none.csv')


def test_real_logs_are_read_whole(realdata):
    panda = read_log(realdata / 'panda_gaz2019/panda_exciting_traj.csv')
    assert (panda.q.shape, panda.dropped) == ((20544, 7), 0)
    bag = read_log(realdata / 'ur10_unisa2025/ur10_exciting_trajectory.db3')
    csv = read_log(realdata / 'ur10_unisa2025/ur10_exciting.csv', joints=bag.joints)
    assert bag.q.shape == (3441, 6)
    assert bag.joints[:2] == ('shoulder_pan_joint', 'shoulder_lift_joint')
    for name, tolerance in (('t', 2e-9), ('q', 6e-7), ('qd', 6e-7), ('tau', 6e-5)):
        np.testing.assert_allclose(getattr(bag, name), getattr(csv, name), atol=tolerance)


def test_messages_of_renamed_joints_are_left_out_with_a_note(tmp_path):
    stamps = 10**9 + 10**7 * np.arange(1, 13)
    codec = JointStateCodec(('a', 'b_new'))
    renamed = [('/joint_states', JOINT_STATE, codec.encode(int(stamp), *np.zeros((3, 2))))
               for stamp in stamps[8:]]
    rows = [(int(stamp), int(stamp), row) for stamp, row in zip(stamps[:8], numbers(8))]
    log = read_log(write_bag(tmp_path / 'run', rows, more=renamed))
    assert log.notes == ('4 of 12 rows are left out: 4 do not hold all joints (renamed, or of '
                         'another robot?)',)
    few = read_log(write_bag(tmp_path / 'few', rows, more=renamed[:0]))
    assert few.notes == ()
