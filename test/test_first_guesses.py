# SPDX-License-Identifier: Apache-2.0
"""What a newcomer tries first at the door works, or is told what to write instead."""

from __future__ import annotations

import numpy as np
import pytest

import adaptive_blf_control as door
from adaptive_blf_control.arms.urdf_export import ExportedUrdf
from adaptive_blf_control.spelling import as_command, option, setting

ARM = door.TwoLinkArm()
T = np.arange(0.0, 1.0, 1e-3)
Q = np.column_stack([np.sin(3.0 * T), np.cos(2.0 * T)])
QD = np.column_stack([3.0 * np.cos(3.0 * T), -2.0 * np.sin(2.0 * T)])
LOG = {'t': T, 'q': Q, 'qd': QD, 'tau': Q}


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: door.simulate(ARM, 1e-3, k22=5.0), r"'k22' is 5\.0.*did you mean controller\.k2\?"),
    (lambda: door.simulate(ARM, 1e-3, controller__k2=5.0),
     r"'controller__k2'.*did you mean controller\.k2\?"),
    (lambda: door.simulate(ARM, 1e-3, contoller={'k2': 5.0}),
     r"'contoller\.k2'.*did you mean controller\.k2\?"),
    (lambda: door.identify(LOG, arm=ARM, colums={}), r"'colums' is {}.*did you mean columns\?"),
    (lambda: door.identify(LOG, arm=ARM, histroy={'size': 9}), r"'histroy'.*history\.size"),
    (lambda: door.read_log(LOG, degree=True), r"'degree' is True.*did you mean degrees\?"),
    (lambda: door.read_log(LOG, columns='t'), r"'columns' is 't'.*a mapping"),
    (lambda: door.read_log(LOG, columns={'time': 't'}), r"'columns' is 'time'.*t, q, qd or tau"),
    (lambda: door.LogOptions(colums={}), r"'colums'.*did you mean columns\?"),
])
def test_a_wrong_name_is_named_as_it_was_written_with_one_that_is_close(call, message):
    with pytest.raises(door.ParameterError, match=message):
        call()


def test_a_log_is_converted_while_it_is_read():
    log = door.read_log({**LOG, 'q': np.rad2deg(Q), 'qd': np.rad2deg(QD)}, degrees=True,
                        gain={'joint2': 2.0})
    np.testing.assert_allclose(log.q, Q)
    np.testing.assert_allclose(log.qd, QD)
    np.testing.assert_allclose(log.tau, Q * [1.0, 2.0])
    later = door.read_log(LOG, effort_delay=0.1)
    np.testing.assert_allclose(later.tau, Q[100:])
    np.testing.assert_allclose(later.q, Q[:-100])


def test_arrays_of_other_names_are_named_by_columns():
    other = {'time': T, 'pos': Q, 'qd': QD, 'effort': Q}
    columns = {'t': 'time', 'q': 'pos', 'tau': 'effort'}
    np.testing.assert_array_equal(door.read_log(other, columns=columns).tau, Q)
    with pytest.raises(door.LogError, match=r"no array 't'.*got time, pos.*columns={'t': \.\.\.}"):
        door.read_log(other)
    with pytest.raises(door.LogError, match=r"no array 'stamp': it has time, pos"):
        door.read_log(other, columns={'t': 'stamp'})


def test_columns_and_conversions_are_given_to_identify_directly(tmp_path):
    path = tmp_path / 'log.csv'
    rows = np.column_stack([1e3 * T, np.rad2deg(Q), np.rad2deg(QD), Q])
    np.savetxt(path, rows, delimiter=',', header='a,b1,b2,c1,c2,d1,d2', comments='')
    options = {'columns': {'t': 'a[ms]', 'q': 'b*', 'qd': 'c*', 'tau': 'd*'}, 'degrees': True}
    settings = {'arm': ARM, 'filter': {'time_constant': 0.01}}
    direct = door.identify(path, **options, **settings)
    by_object = door.identify(path, options=door.LogOptions(**options), **settings)
    of_arrays = door.identify(LOG, **settings)
    np.testing.assert_array_equal(direct.theta, by_object.theta)
    np.testing.assert_allclose(direct.theta, of_arrays.theta, rtol=1e-3, atol=1e-6)


def test_a_log_shows_its_size_span_and_rate():
    assert repr(door.read_log(LOG)) == (
        '<MeasuredLog: 1000 samples of 2 joints (joint1, joint2), 0.999 s at 1000 Hz>')


def test_a_python_error_names_no_option_of_a_command(tmp_path):
    slow = {'t': T, 'q': Q, 'qd': np.rad2deg(QD), 'tau': Q}
    with pytest.raises(door.LogError, match='velocity') as caught:
        door.identify(slow, arm=ARM, filter={'time_constant': 0.01})
    assert "filter={'state_order': 4} takes velocities" in str(caught.value)
    assert 'force=True' in str(caught.value)
    assert '--' not in str(caught.value)
    with pytest.raises(door.ParameterError, match=r"'scenario' is '.*nothing\.yaml'"):
        door.simulate(tmp_path / 'nothing.yaml')


def test_a_command_spells_options_its_way():
    assert option('degrees') == 'degrees=True'
    assert setting('filter.gap', '1') == "filter={'gap': 1}"
    with as_command():
        assert option('degrees') == '--degrees'
        assert option('effort_delay', '0.02') == '--effort-delay 0.02'
        assert setting('filter.gap', '1') == '--set filter.gap=1'
    assert option('effort_delay', '0.02') == 'effort_delay=0.02'


def test_an_exported_urdf_is_a_urdf_wherever_one_is_taken():
    pytest.importorskip('pinocchio')
    urdf = ('<robot name="r"><link name="base"/><link name="rod"><inertial><mass value="1"/>'
            '<origin xyz="0 0 -0.2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" '
            'izz="0.1"/></inertial></link><joint name="pivot" type="continuous"><parent '
            'link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>')
    exported = ExportedUrdf(urdf, {}, {})
    assert str(exported) == urdf
    assert len(repr(exported)) < 100
    assert door.load_arm(exported).joints == door.load_arm(door.load_arm(urdf)).joints == ('pivot',)
