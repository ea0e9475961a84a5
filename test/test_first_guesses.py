# SPDX-License-Identifier: Apache-2.0
"""What a newcomer tries first at the door works, or is told what to write instead."""

from __future__ import annotations

import copy
import pickle

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
    assert door.load_arm(exported).joints == ('pivot',)
    assert door.load_arm(door.load_arm(urdf)).joints == ('pivot',)


class Broken:
    """A law that answers NaN for the second joint from 0.02 s on."""

    def __init__(self, arm, settings):
        """Take both; it needs neither."""

    def answer(self, sample):
        """Answer a sample."""
        torque = np.zeros(2)
        torque[1] = np.nan if sample.t > 0.0195 else 0.0
        return door.LawAnswer(torque, sample.qd)


class Lost(door.Plant):
    """A plant whose first position is no number from 0.03 s on."""

    def __init__(self, settings=None, arm=None):
        """Begin at rest."""
        self.q, self.qd, self.torque, self._t = np.zeros(2), np.zeros(2), np.zeros(2), 0.0

    def advance(self, dt):
        """Move on."""
        self._t += dt
        if self._t > 0.0295:
            self.q = np.array([np.nan, 0.0])


@pytest.mark.parametrize(('part', 'failure'), [
    ({'law': Broken}, "the law's torque of joint 'joint2' is not finite at 0.02 s"),
    ({'plant': Lost}, "the position of joint 'joint1' is not finite at 0.03 s"),
    ({'plant': Lost()}, "the position of joint 'joint1' is not finite at 0.03 s")])
def test_a_part_that_answers_no_number_fails_the_run_whatever_the_margins_are(part, failure):
    run = door.simulate(ARM, 0.05, **part)
    assert not run.kept
    assert str(run.failure) == run.figures['failure'] == failure
    assert run.figures['min_margin'] == [None, None]
    assert f'FAILED: {failure}' in repr(run)
    assert 'KEPT' not in repr(run)
    assert 'unknown' in repr(run)
    assert np.isfinite(run.torque).all()


def test_a_run_of_numbers_has_no_failure():
    run = door.simulate(ARM, 0.01)
    assert (run.failure, run.figures['failure'], run.kept) == (None, None, True)


@pytest.mark.parametrize(('changes', 'words'), [
    ({'dead_time': 2}, 'dead time'), ({'sensors': {'model': 'encoder'}}, 'encoders'),
    ({'sensors': {'torque_noise': 0.1}}, 'noise of the torque'),
    ({'actuator': {'delay': 0.001}}, 'actuators or forces beside the law')])
def test_theorem_2_is_said_not_to_be_about_a_loop_with(changes, words):
    run = door.simulate(ARM, 0.01, arm_driver=changes)
    assert f'Theorem 2            is not about this loop: it has {words}' in repr(run)
    assert run.figures['guarantee'] is None


def test_a_reference_that_does_not_move_is_noted():
    still = door.simulate(ARM, 0.01)
    moving = door.simulate(ARM, 0.01, reference={'joint1': {'amplitude': 0.1}})
    assert any('the reference does not move' in note for note in still.notes)
    assert 'note: the reference does not move' in repr(still)
    assert not any('does not move' in note for note in moving.notes)


def test_a_history_too_small_for_its_rank_is_noted():
    assert 'too few for more than rank 4' in repr(door.Identifier(ARM, history={'size': 2}))
    assert 'too few' not in repr(door.Identifier(ARM))
    run = door.simulate(ARM, 0.01, history={'size': 2})
    assert any('rank cannot exceed 4 of 5' in note for note in run.notes)


@pytest.mark.parametrize(('subject', 'name', 'hint'), [
    (lambda: door.Identifier(ARM), 'theta_hat', 'theta is the estimate'),
    (lambda: door.Identifier(ARM), 'kt', r'settings\.kt has it, retune\(kt='),
    (lambda: door.Identifier(ARM), 'ranks', r'did you mean rank\?'),
    (lambda: door.Controller(ARM), 'k2', r'settings\.k2 has it, retune\(k2='),
    (lambda: door.simulate(ARM, 0.01), 'theta', r'theta_hat has it over time')])
def test_a_wrong_attribute_is_refused_with_what_is_meant(subject, name, hint):
    with pytest.raises(AttributeError, match=f"has no attribute '{name}': .*{hint}"):
        getattr(subject(), name)


@pytest.mark.parametrize(('subject', 'name'), [
    (door.Controller, 'k2'), (door.Controller, 'safety'), (door.Identifier, 'kt'),
    (door.Identifier, 'history')])
def test_a_setting_that_is_set_as_an_attribute_is_refused(subject, name):
    with pytest.raises(AttributeError, match=f'{name} cannot be set: retune'):
        setattr(subject(ARM), name, 5.0)


def test_settings_are_retuned_by_name():
    identifier, controller = door.Identifier(ARM), door.Controller(ARM)
    identifier.retune(kt=3.0, history={'size': 30})
    assert (identifier.settings.kt, identifier.settings.history.size) == (3.0, 30)
    controller.retune(k2=7.0)
    assert controller.settings.k2.tolist() == [7.0, 7.0]
    output = controller.update(0.0, [0.0, 0.0], [0.0, 0.0], np.zeros(5))
    assert output.torque.shape == (2,)
    controller.retune(0.0, [0.0, 0.0], safety={'upper': 2.0}, **{'performance.upper': 0.1})
    assert controller.safety.upper.tolist() == [2.0, 2.0]
    assert controller.safety.lower.tolist() == [-3.14, -3.14]
    assert controller.performance.upper.tolist() == [0.1, 0.1]
    assert controller.settings.k2.tolist() == [7.0, 7.0]
    for call, message in ((lambda: identifier.retune(ktt=3.0), r'ktt.*did you mean kt\?'),
                          (lambda: controller.retune(k22=3.0), r'k22.*did you mean k2\?'),
                          (lambda: controller.retune(safety={'upper': 2.0}), "'t' is None")):
        with pytest.raises(door.ParameterError, match=message):
            call()


def _by_pickle(given):
    return pickle.loads(pickle.dumps(given))


@pytest.mark.parametrize('duplicate', [copy.deepcopy, _by_pickle])
def test_a_copy_of_an_identifier_goes_on_alike_without_a_trace_in_the_first(duplicate):
    first = door.Identifier(ARM)
    first.learn(T[:500], Q[:500], QD[:500], Q[:500])
    before, other = first.theta.copy(), duplicate(first)
    learned = other.learn(T[500:], Q[500:], QD[500:], Q[500:]).copy()
    assert not np.array_equal(learned, before)
    np.testing.assert_array_equal(first.theta, before)
    np.testing.assert_array_equal(first.learn(T[500:], Q[500:], QD[500:], Q[500:]), learned)


@pytest.mark.parametrize('duplicate', [copy.deepcopy, _by_pickle])
def test_a_copy_of_a_controller_goes_on_alike_without_a_trace_in_the_first(duplicate):
    swing = {'joint1': {'amplitude': 0.1, 'frequency': 1.0}}
    first = door.Controller(ARM, reference=swing, torque_rate_limit=100.0)
    first.update(0.0, [0.0, 0.0], [0.0, 0.0], np.zeros(5))
    other = duplicate(first)
    sample = (1e-3, [0.01, 0.0], [0.1, 0.0], ARM.nominal)
    torque = other.update(*sample).torque.copy()
    np.testing.assert_array_equal(first.update(*sample).torque, torque)
    assert other.settings == first.settings


class Slow(door.Constraint):
    """A limit of the velocity."""

    name, quantity, unit, recovery = 'velocity', 'velocity', 'rad/s', 'slow down'
    bodies = ARM.joints

    def bounded(self, state):
        """Return the velocities with their bounds."""
        return door.Bounded(state.qd, np.full(2, -2.0), np.full(2, 2.0))


@pytest.mark.parametrize('given', [Slow(), [Slow()], (Slow(),)])
def test_one_constraint_needs_no_list(given):
    assert len(door.Controller(ARM, constraints=given).constraints.parts) == 3


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: door.Controller(ARM, constraints=object()),
     "'constraints' is .*a part with name, quantity"),
    (lambda: door.simulate(ARM, 0.01, plant=Foreign()),
     'Foreign has no measure, .*; a class that inherits from Plant has most of them'),
    (lambda: door.ClosedLoop(Lost, door.Controller(ARM)), 'an object, not the class Lost'),
    (lambda: door.simulate(ARM, 0.01, plant=Foreign), r'an object, or what can be called with '
     r'DriverSettings, TwoLinkArm \(TypeError'),
])
def test_a_part_of_another_kind_is_refused_with_what_is_needed(call, message):
    with pytest.raises(door.ParameterError, match=message):
        call()


class Foreign:
    """A plant that inherits from nothing."""

    def __init__(self):
        """Begin at rest."""
        self.q = self.qd = self.torque = np.zeros(2)

    def advance(self, dt):
        """Stand still."""
