# SPDX-License-Identifier: Apache-2.0
"""CSV files as other programs write them: all give the same rows."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.bags.log_columns import given_columns
from adaptive_blf_control.bags.logs import read_log
from adaptive_blf_control.errors import LogError

JOINTS = ('shoulder', 'elbow')
T = 0.004 * np.arange(60)
Q = np.column_stack([np.sin(3 * T), 0.5 * np.cos(5 * T)])
QD = np.column_stack([3 * np.cos(3 * T), -2.5 * np.sin(5 * T)])
TAU = np.column_stack([7 * np.cos(T), -2 + T])
PLAIN = 't,q1,q2,qd1,qd2,tau1,tau2'


def text(header, t=T, separator=',', comma=False, columns=(Q, QD, TAU)):
    """Return a file's text."""
    rows = [separator.join(map(repr, (time, *row)))
            for time, row in zip(t.tolist(), np.hstack(columns).tolist())]
    body = '\n'.join(rows) + '\n'
    return (header + '\n' if header else '') + (body.replace('.', ',') if comma else body)


def read(tmp_path, content, **options):
    """Write a file and read it."""
    path = tmp_path / 'log.csv'
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_log(path, **options)


def check(log, *, velocity=True):
    """Compare a log with what was written."""
    np.testing.assert_allclose(log.t, T, atol=3e-7)
    np.testing.assert_allclose(log.q, Q, atol=1e-11)
    np.testing.assert_allclose(log.qd, QD if velocity else np.zeros_like(QD), atol=1e-11)
    np.testing.assert_allclose(log.tau, TAU, atol=1e-11)
    assert log.dropped == 0


@pytest.mark.parametrize(('separator', 'comma'), [
    (',', False), (';', False), (';', True), ('\t', False), ('\t', True), (' ', False),
    ('  ', True), ('|', True), (', ', False)])
def test_separators_and_decimal_commas(tmp_path, separator, comma):
    check(read(tmp_path, text(PLAIN.replace(',', separator), separator=separator, comma=comma)))


def test_quoted_cells_with_decimal_commas(tmp_path):
    quoted = [','.join(f'"{cell}"' for cell in line.replace('.', ',').split(';'))
              for line in text(PLAIN.replace(',', ';'), separator=';').splitlines()]
    check(read(tmp_path, '\n'.join(quoted)))


@pytest.mark.parametrize('encoding', [
    'utf-8-sig', 'utf-16', 'utf-16-le', 'utf-16-be', 'utf-32', 'utf-32-le', 'utf-32-be'])
def test_encodings_of_other_systems(tmp_path, encoding):
    check(read(tmp_path, text(PLAIN).replace('\n', '\r\n').encode(encoding)))


def test_bytes_that_are_not_utf8_stay_out_of_the_way(tmp_path):
    check(read(tmp_path, ('n\xb0,' + text(PLAIN).replace('\n', '\n1,')[:-2]).encode('latin-1')))


@pytest.mark.parametrize('header', [
    PLAIN, 'time,pos_1,pos_2,vel_1,vel_2,eff_1,eff_2', 'timestamp,q0,q1,dq0,dq1,tau0,tau1',
    't [s],q[0],q[1],qd[0],qd[1],torque[0],torque[1]',
    '%time,field.position0,field.position1,field.velocity0,field.velocity1,field.effort0,'
    'field.effort1',
    'T,Position 1 (rad),Position 2 (rad),Velocity 1,Velocity 2,Torque 1,Torque 2',
    'elapsed_time,actual_q_0,actual_q_1,actual_qd_0,actual_qd_1,actual_torque_0,actual_torque_1',
    'time,q_1,q_2,dq_1,dq_2,tau_J_1,tau_J_2',
    'time,q1_meas,q2_meas,qd1_meas,qd2_meas,tau1_measured,tau2_measured'])
def test_numbered_headers_of_other_programs(tmp_path, header):
    log = read(tmp_path, text(header), joints=JOINTS)
    assert log.joints == JOINTS
    check(log)


@pytest.mark.parametrize('form', [
    '/joint_states/{0}/{1}', '/ns/joint_states/{0}/{1}', '{1}.{0}', '{0}_{1}', '{1}_{0}'])
def test_named_headers_are_matched_by_joint_in_any_order(tmp_path, form):
    columns = [(joint, kind) for joint in ('elbow', 'gripper', 'shoulder')
               for kind in ('effort', 'position', 'velocity')]
    values = {'position': Q, 'velocity': QD, 'effort': TAU}
    table = np.column_stack([
        values[kind][:, JOINTS.index(joint)] if joint in JOINTS else T for joint, kind in columns])
    content = text('__time,' + ','.join(form.format(*column) for column in columns),
                   columns=(table,))
    check(read(tmp_path, content, joints=JOINTS))
    with pytest.raises(LogError, match=r"no column for the position of joint 'wrist'.*gripper"):
        read(tmp_path, content, joints=('shoulder', 'wrist'))


def test_what_was_asked_for_is_not_taken_for_what_was_measured(tmp_path):
    header = 't,q1,q2,q_des1,target_q_2,qd1,qd2,cmd_qd_1,ddq1,tau1,tau2,tau_cmd1'
    columns = (Q, 9 * Q, QD, 9 * QD[:, :1], 9 * QD[:, :1], TAU, 9 * TAU[:, :1])
    check(read(tmp_path, text(header, columns=columns)))


def test_two_columns_that_look_alike_have_to_be_chosen_from(tmp_path):
    header = 't,q1,q2,pos1,qd1,qd2,tau1,tau2'
    content = text(header, columns=(Q, Q[:, :1], QD, TAU))
    with pytest.raises(LogError, match="'q1' and 'pos1' both look like the position of joint '1'"):
        read(tmp_path, content)


@pytest.mark.parametrize('columns', [
    't=when,q=a*,qd=b*,tau=c*', 't=1,q=2..3,qd=4..5,tau=6..7',
    't=when,q1=a1,q2=a2,qd1=b1,qd2=b2,tau1=c1,tau2=7'])
def test_columns_can_be_named(tmp_path, columns):
    content = text('when,a1,a2,b1,b2,c1,c2')
    check(read(tmp_path, content, columns=given_columns(columns)))
    with pytest.raises(LogError, match=r'missing column t, q1, qd1, tau1.*columns='):
        read(tmp_path, content)


def test_numbers_without_a_header_need_columns(tmp_path):
    with pytest.raises(LogError, match=r'no header: .*columns='):
        read(tmp_path, text(''))
    check(read(tmp_path, text(''), columns=given_columns('t=1,q=2..3,qd=4..5,tau=6..7')))
    check(read(tmp_path, text('# made by a program\n# ' + PLAIN.replace(',', ' '))))


@pytest.mark.parametrize(('columns', 'words'), [
    ('q', 'expected KIND=COLUMN'), ('x=1', 'expected KIND=COLUMN'), ('t=', 'KIND=COLUMN')])
def test_columns_that_cannot_be_read_are_named(columns, words):
    with pytest.raises(LogError, match=words):
        given_columns(columns)


@pytest.mark.parametrize(('columns', 'words'), [
    ('t=nothing', "column 'nothing'"), ('q=z*', "'z\\*' for q"), ('t=99', "column '99'"),
    ('t=t[h]', "unit 'h'")])
def test_columns_that_are_not_there_are_named(tmp_path, columns, words):
    with pytest.raises(LogError, match=words):
        read(tmp_path, text(PLAIN), columns=given_columns(columns))


EPOCH = 1_700_000_000


@pytest.mark.parametrize(('name', 'times'), [
    ('time', T + 12.5), ('time', EPOCH + T), ('time', np.round((EPOCH + T) * 1000).astype(int)),
    ('time', EPOCH * 10**9 + np.round(T * 1e9).astype(int)), ('t [ms]', 1e3 * T),
    ('timestamp_ns', np.round(1e9 * T).astype(int)), ('t', 1e3 * T), ('t', 1e6 * T),
    ('t', np.round(1e9 * T + 5e9).astype(int))])
def test_times_of_any_unit_count_from_the_first_row(tmp_path, name, times):
    check(read(tmp_path, text(PLAIN.replace('t,', name + ',', 1), t=times)))


def test_seconds_and_nanoseconds_in_two_columns(tmp_path):
    parts = np.column_stack([np.full(T.size, float(EPOCH)), np.round(1e9 * T)])
    content = text('/js/header/stamp/sec,/js/header/stamp/nanosec,' + PLAIN[2:],
                   t=parts[:, 0].astype(int), columns=(parts[:, 1:].astype(int), Q, QD, TAU))
    check(read(tmp_path, content))


def test_guessed_units_are_told(tmp_path):
    log = read(tmp_path, text(PLAIN, t=1e3 * T))
    assert any('taken to be in ms: the velocities say so' in note for note in log.notes)
    log = read(tmp_path, text(PLAIN.replace('qd', 'x'), t=1e3 * T), velocity=False)
    assert any('taken to be in ms: the rows are 4 apart' in note for note in log.notes)
    assert read(tmp_path, text(PLAIN)).notes == ()


def test_degrees_in_the_header_are_converted(tmp_path):
    header = 't,q1 [°],q2 [°],qd1 [deg/s],qd2 [deg/s],tau1,tau2'
    log = read(tmp_path, text(header, columns=(np.rad2deg(Q), np.rad2deg(QD), TAU)))
    check(log)
    assert 'q is converted from degrees, as its columns say' in log.notes


@pytest.mark.parametrize('columns', [None, 't=t,qd=qd*', 't=1,q1=q1'])
def test_units_in_a_line_of_their_own_are_heeded(tmp_path, columns):
    units = '\n(ms),deg,deg,[rad/s],[rad/s],N m,'
    content = text(PLAIN + units, t=1e3 * T, columns=(np.rad2deg(Q), QD, TAU))
    log = read(tmp_path, content, columns=columns and given_columns(columns))
    check(log)
    assert log.notes == ('q is converted from degrees, as its columns say',)


def test_a_line_that_is_only_partly_numbers_is_not_taken_for_units(tmp_path):
    with pytest.raises(LogError, match="row 2, column 't': 'ms' is not a number"):
        read(tmp_path, text(PLAIN + '\nms,1.0,1.0,0.0,0.0,0.0,0.0'))


def test_a_last_line_that_is_cut_is_left_out_with_a_note(tmp_path):
    content = text(PLAIN)
    for end in (-8, -25):
        log = read(tmp_path, content[:end])
        assert len(log.t) in (59, 60)  # a number that lost digits is still a number
    log = read(tmp_path, content[:-25])
    assert len(log.t) == 59
    assert 'row 61 has' in log.problem


def test_rows_with_empty_cells_are_left_out_and_a_column_of_them_is_named(tmp_path):
    lines = text(PLAIN).splitlines()
    lines[5] = lines[5].rpartition(',')[0] + ','
    lines[7] = ',' * 6
    lines[9] += ','
    log = read(tmp_path, '\n'.join(lines))
    assert (len(log.t), log.dropped) == (58, 2)
    empty = [lines[0], *(line.rpartition(',')[0] + ',' for line in lines[1:9])]
    with pytest.raises(LogError, match="0 usable rows of 8.*no row has tau of 'joint2'"):
        read(tmp_path, '\n'.join(empty))


def test_velocities_are_not_needed_where_they_are_not_used(tmp_path):
    content = text(PLAIN.replace('qd', 'x'))
    log = read(tmp_path, content, velocity=False)
    check(log, velocity=False)
    assert not log.measured_velocity
    with pytest.raises(LogError, match=r'missing column qd1, qd2.*state_order'):
        read(tmp_path, content)
    nothing = text(PLAIN, columns=(Q, np.full_like(QD, np.nan), TAU))
    check(read(tmp_path, nothing, velocity=False), velocity=False)


def test_currents_are_taken_for_the_effort_with_a_note(tmp_path):
    log = read(tmp_path, text('t,q1,q2,qd1,qd2,actual_current_1,actual_current_2'))
    check(log)
    assert any('gain=' in note for note in log.notes)


def test_git_lfs_pointer_is_told_from_a_log(tmp_path):
    with pytest.raises(LogError, match='git lfs pull'):
        read(tmp_path, 'version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n')


@pytest.mark.parametrize('before', [
    'Robot log\n', 'Robot: UR10\nDate: 2024-01-01, 12:00\n\nNotes, with, commas\n\n',
    'Recorded by me,,,,,,\n250,,,,,,\n', 'Serial,12345\nRate,250\n', '// a comment\n// another\n',
    'a line\n' * 300])
@pytest.mark.parametrize('units', ['', 's,rad,rad,rad/s,rad/s,Nm,Nm\n'])
def test_text_before_the_header_is_left_out(tmp_path, before, units):
    header, rows = text(PLAIN).split('\n', 1)
    check(read(tmp_path, f'{before}{header}\n{units}{rows}'))


def test_a_header_is_named_with_its_row_and_its_columns(tmp_path):
    content = 'Robot log\n\n' + text(PLAIN.replace('t,', 'when,'))
    with pytest.raises(LogError, match=r"row 3: missing column t: .*the columns are 'when', 'q1'"):
        read(tmp_path, content)
    broken = text(PLAIN).split('\n')
    broken[1] = broken[1].replace(',', ',x', 1)
    with pytest.raises(LogError, match=r"row 2, column 'q1': 'x"):
        read(tmp_path, '\n'.join(broken))


@pytest.mark.parametrize('form', [
    '{1}[{0}]', '{1}({0})', '{1} [{0}]', '{0}[{1}]', '{0}({1})', '/joint_states.{1}[{0}]',
    'joint_states[{0}].{1}', '{0}:{1}', '{1}:{0}', '{0}-{1}', '{1}-{0}', '{0}/{1}/value',
    '/robot/{0}/state/{1}'])
@pytest.mark.parametrize('named', [True, False])
def test_what_differs_in_brackets_is_the_joint(tmp_path, form, named):
    header = ','.join(form.format(joint, kind) for kind in ('position', 'velocity', 'effort')
                      for joint in JOINTS)
    log = read(tmp_path, text('time,' + header), joints=JOINTS if named else None)
    assert log.joints == JOINTS
    check(log)


@pytest.mark.parametrize('header', [
    't,q1[rad],q2[rad],qd1[rad/s],qd2[rad/s],tau1[Nm],tau2[Nm]',
    't,q1,q2,q1dot,q2dot,tau1,tau2', 't,q1,q2,q\u03071,q\u03072,\u03c41,\u03c42',
    't,\u03b81,\u03b82,\u03c91,\u03c92,\u03c41,\u03c42',
    'time,qpos1,qpos2,qvel1,qvel2,qfrc_actuator1,qfrc_actuator2',
    'Receive Time,ActPos[1],ActPos[2],ActVel[1],ActVel[2],ActTrq[1],ActTrq[2]',
    'time,position_rad_1,position_rad_2,velocity_rad_s_1,velocity_rad_s_2,torque_nm_1,torque_nm_2',
    'time,joint position 1,joint position 2,joint velocity 1,joint velocity 2,joint torque 1,'
    'joint torque 2', f'{PLAIN},'])
def test_headers_in_other_spellings(tmp_path, header):
    check(read(tmp_path, text(header), joints=JOINTS))


@pytest.mark.parametrize('name', ['log.dat', 'log.asc', 'log.log', 'LOG.CSV'])
def test_endings_of_text_files_are_those_of_tables(tmp_path, name):
    path = tmp_path / name
    path.write_text(text(PLAIN))
    check(read_log(path))


def test_numbers_as_fortran_writes_them(tmp_path):
    rows = [','.join(f'{cell:.14E}'.replace('E', 'D') for cell in row)
            for row in np.column_stack([T, Q, QD, TAU])]
    check(read(tmp_path, '\n'.join([PLAIN, *rows])))


@pytest.mark.parametrize(('content', 'words'), [
    (b'', 'is empty: expected a header'), (bytes(range(14, 200)) * 9, 'is no text'),
    (b'<!DOCTYPE html>\n<html></html>\n', "row 1: missing column t.*'<!DOCTYPE'")])
def test_what_is_no_table_is_refused_by_its_content(tmp_path, content, words):
    with pytest.raises(LogError, match=words):
        read(tmp_path, content)


@pytest.mark.parametrize('form', [
    '2024-02-29T23:59:{:012.9f}Z', '2024-02-29 23:59:{:09.6f}', '2024/2/29 23:59:{:09.6f}+01:00',
    '29-Feb-2024 23:59:{:09.6f}', '23:59:{:09.6f}', '00:00:{:06.3f}', '{:.3f} sec', '{:.3f}s'])
def test_times_in_words_are_read(tmp_path, form):
    lines = text(PLAIN).splitlines()
    rows = [f'{form.format(time)},{line.partition(",")[2]}' for time, line in zip(T, lines[1:])]
    log = read(tmp_path, '\n'.join([lines[0], *rows]))
    check(log)
    assert log.notes == ()
    check(read(tmp_path, '\n'.join(['Robot log', '', lines[0], *rows])))


def test_a_day_that_there_is_not_is_refused(tmp_path):
    content = text(PLAIN).replace('\n0.0,', '\n2023-02-29 10:00:00,', 1)
    with pytest.raises(LogError, match="row 2, column 't': '2023-02-29 10:00:00' is not a number"):
        read(tmp_path, content)


def test_times_in_words_of_a_table_are_read():
    columns = dict(zip(PLAIN.split(','), np.column_stack([T, Q, QD, TAU]).T))
    columns['t'] = np.array([f'2024-02-29 23:59:{time:06.3f}' for time in T], dtype=object)
    check(read_log(columns))


def test_files_that_were_put_together_have_the_header_again(tmp_path):
    lines = text(PLAIN + '\ns,rad,rad,rad/s,rad/s,Nm,Nm').splitlines()
    check(read(tmp_path, '\n'.join([*lines[:30], *lines[:2], *lines[30:]])))


def test_words_of_other_programs_for_what_is_missing(tmp_path):
    lines = text(PLAIN).splitlines()
    words = ['-1.#IND', '1.#QNAN', '-nan(ind)', '#DIV/0!', '#N/A', 'NULL', '--']
    for place, word in enumerate(words, 5):
        lines[place] = lines[place].rpartition(',')[0] + ',' + word
    log = read(tmp_path, '\n'.join(lines))
    assert log.dropped == len(words)
    assert log.notes == (f'{len(words)} of {T.size} rows are left out: {len(words)} have no value '
                         'for a column',)


def test_a_cell_of_a_message_is_short(tmp_path):
    lines = text(PLAIN).splitlines()
    lines[30] = '\0' * 4096 + lines[30]
    with pytest.raises(LogError, match="row 31, column 't': .* is not a number") as told:
        read(tmp_path, '\n'.join(lines))
    assert len(str(told.value)) < 400


def test_what_topic_echo_prints_as_csv_is_read(tmp_path):
    rows = [f'{EPOCH},{round(1e9 * t)},base,{",".join(JOINTS)},{",".join(map(repr, row))}'
            for t, row in zip(T, np.hstack([Q, QD, TAU]).tolist())]
    log = read(tmp_path, '\n'.join(rows), joints=JOINTS)
    check(log)
    assert log.joints == JOINTS


def test_what_topic_echo_prints_otherwise_is_refused_by_its_name(tmp_path):
    with pytest.raises(LogError, match='ros2 topic echo --csv'):
        read(tmp_path, 'header:\n  stamp:\n    sec: 1\n')


def test_times_of_too_few_digits_are_told(tmp_path):
    log = read(tmp_path, text(PLAIN, t=np.round(T, 2)))
    note, = log.notes
    assert note.startswith(f'{log.dropped} of {T.size} rows are left out: {log.dropped} have a '
                           'time that is not after that of the row before (with too few digits')
    with pytest.raises(LogError, match='1 usable rows of 60: .*59 have a time that is not after'):
        read(tmp_path, text(PLAIN, t=np.full(T.size, 1.7e9)))
