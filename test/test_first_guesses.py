# SPDX-License-Identifier: Apache-2.0
"""What a newcomer tries first at the door works, or is told what to write instead."""

from __future__ import annotations

import copy
import functools
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
    (lambda: door.simulate(ARM, 1e-3, arm_drivr={'payload': 1.0}),
     r"'arm_drivr\.payload'.*did you mean arm_driver\.payload\?"),
    (lambda: door.simulate({'/**/arm_drivr': {'ros__parameters': {'payload': 1.0}}}, 1e-3),
     r"not '/\*\*/arm_drivr': did you mean arm_driver\?"),
    (lambda: door.identify(LOG, arm=ARM, colums={}), r"'colums' is {}.*did you mean columns\?"),
    (lambda: door.identify(LOG, arm=ARM, histroy={'size': 9}), r"'histroy'.*mean history\?"),
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


PENDULUM = (
    '<robot name="r"><link name="base"/><link name="rod"><inertial><mass value="1"/>'
    '<origin xyz="0 0 -0.2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" '
    'izz="0.1"/></inertial></link><joint name="pivot" type="continuous"><parent '
    'link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>')


def test_an_exported_urdf_is_a_urdf_wherever_one_is_taken():
    pytest.importorskip('pinocchio')
    exported = ExportedUrdf(PENDULUM, {}, {})
    assert str(exported) == PENDULUM
    assert len(repr(exported)) < 100
    assert door.load_arm(exported).joints == ('pivot',)
    assert door.load_arm(door.load_arm(PENDULUM)).joints == ('pivot',)


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
    (lambda: door.Identifier(ARM), 'fit', r'did you mean learn\?'),
    (lambda: door.Identifier(ARM), 'parameters', r'arm\.parameters has their names'),
    (lambda: door.Identifier(ARM), 'colour', r'the nearest are \w+, .*; dir\(\.\.\.\) lists all'),
    (lambda: door.Controller(ARM), 'step', r'did you mean update\?'),
    (lambda: door.Controller(ARM), 'gains', r'retune\(k2=\.\.\.\) changes them'),
    (lambda: door.Controller(ARM).update(0.0, [0.0] * 2, [0.0] * 2, [0.0] * 5), 'u',
     r'did you mean torque\?'),
    (lambda: door.IdentifierSettings(), 'gammas', r'did you mean gamma\?'),
    (lambda: door.ClosedLoop(Lost(), door.Controller(ARM)), 'simulate', r'did you mean run\?'),
    (lambda: door.read_log(LOG), 'dq', r'did you mean qd\?'),
    (lambda: door.read_log(LOG), 'colour', r'the nearest are .*joints; dir\(\.\.\.\) lists all'),
    (lambda: ARM, 'names', r'joints has the names of the joints'),
    (lambda: ARM, 'dof', r'did you mean n\?'),
    (lambda: ARM, 'joint_names', r'did you mean joints\?'),
    (lambda: ARM, 'regressor', r'X\(q, qd, qd, qdd\)'),
    (lambda: ARM.dynamics(ARM.nominal), 'step', r'advance\(q, qd, tau, dt\)'),
    (lambda: Rail(), 'dof', r'did you mean n\?'),
    (lambda: door.simulate(ARM, 0.01), 'tau', r'did you mean torque or measured\?'),
    (lambda: door.simulate(ARM, 0.01), 'torques', r'did you mean torque or measured\?'),
    (lambda: door.simulate(ARM, 0.01), 'error', r'did you mean e1\?'),
    (lambda: door.simulate(ARM, 0.01), 'time', r'did you mean t\?'),
    (lambda: door.simulate(ARM, 0.01), 'safe', r'did you mean kept'),
    (lambda: door.simulate(ARM, 0.01), 'plot', r'plt\.plot\(run\.t, run\.e1\)'),
    (lambda: door.simulate(ARM, 0.01), 'e2', r'observer=f.*sample\.output\.e2'),
    (lambda: door.simulate(ARM, 0.01), 'colour', r'the nearest are .*controller'),
    (lambda: identified(), 'rmse', r'did you mean test_rmse or train_rmse\?'),
    (lambda: identified(), 'tau', r'prediction has t, measured, predicted'),
    (lambda: identified(), 'test_error', r'did you mean test_rmse'),
    (lambda: identified(), 'to_yaml', r'did you mean save'),
    (lambda: identified().prediction, 'tau', r'did you mean measured or predicted\?'),
    (lambda: identified(), 'to_urdf', r'did you mean urdf\?'),
    (lambda: identified(), 'coefficients', r'did you mean theta or estimate'),
    (lambda: identified(), 'condition_number', r"figures\['condition'\]"),
    (lambda: door.simulate(ARM, 0.01), 'rms', r"figures\['rms_error'\]"),
    (lambda: door.simulate(ARM, 0.01), 'compare', r'figures of two runs are dictionaries'),
    (lambda: door.Controller(ARM), 'k2', r'settings\.k2 has it, retune\(k2='),
    (lambda: door.simulate(ARM, 0.01), 'theta', r'theta_hat has it over time')])
def test_a_wrong_attribute_is_refused_with_what_is_meant(subject, name, hint):
    with pytest.raises(AttributeError, match=f"has no attribute '{name}': .*{hint}"):
        getattr(subject(), name)


def test_an_estimate_is_taken_as_it_is_returned():
    found = identified()
    for given in (found, found.identifier, found.estimate, found.theta):
        np.testing.assert_array_equal(door.Identifier(ARM, initial_estimate=given).theta,
                                      found.theta)
    np.testing.assert_array_equal(
        door.inverse_dynamics(ARM, found.estimate, Q[0], QD[0], QD[0]),
        door.inverse_dynamics(ARM, found.theta, Q[0], QD[0], QD[0]))
    with pytest.raises(door.ParameterError, match=r"'theta' is \{'p1': 1.0\}.*one for each of p1"):
        door.inverse_dynamics(ARM, {'p1': 1.0}, Q[0], QD[0], QD[0])


def test_the_estimate_that_a_scenario_starts_from_is_given_by_name():
    names = {'p1': 3.0, 'p2': 0.2, 'p3': 0.2, 'fv_joint1': 5.0, 'fv_joint2': 1.0}
    run = door.simulate('two_link', 0.002, initial_estimate=names)
    np.testing.assert_array_equal(run.theta_hat[0], list(names.values()))
    with pytest.raises(door.ParameterError, match='no p2, p3, fv_joint1, fv_joint2'):
        door.simulate('two_link', 0.002, initial_estimate={'p1': 3.0})


class Rolling(door.Plant):
    """A plant whose author took ``advance`` for that of a model."""

    def __init__(self):
        self.q, self.qd, self.torque = np.zeros((3, 2))

    def advance(self, torque, dt):
        """Move on."""


def test_a_plant_whose_advance_takes_other_arguments_is_refused_before_it_runs():
    with pytest.raises(door.ParameterError, match=r'advance is called as advance\(dt\): missing'):
        door.simulate(ARM, 0.01, plant=Rolling)


def test_a_law_that_answers_with_a_torque_alone_is_told_what_is_expected():
    class Torque(door.Law):
        def answer(self, sample):
            return -sample.q

    with pytest.raises(door.ParameterError, match=r"'Torque\.answer'.*LawAnswer\(torque, e2\)"):
        door.simulate(ARM, 0.01, law=Torque)


@functools.cache
def identified():
    return door.identify(LOG, ARM, filter={'time_constant': 0.01})


class Rail(door.Arm):
    """An arm of a user's own."""

    joints, parameters = ('rail',), ('mass',)

    def Y1(self, q, qd):
        """Return the momentum."""
        return np.array([[qd[0]]])

    def Y2(self, q, qd):
        """Return nothing."""
        return np.zeros((1, 1))

    def X(self, q, qd, alpha, alpha_dot):
        """Return the inertia."""
        return np.array([[alpha_dot[0]]])


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


class Demanding:
    """A plant that asks for more than it is given."""

    def __init__(self, settings, arm, more):
        """Take three."""


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: door.Controller(ARM, constraints=object()),
     "'constraints' is .*a part with name, quantity"),
    (lambda: door.simulate(ARM, 0.01, plant=Foreign()),
     'Foreign has no measure, .*; a class that inherits from Plant has most of them'),
    (lambda: door.ClosedLoop(Lost, door.Controller(ARM)), r'such as Lost\(\), not the class'),
    (lambda: door.simulate(ARM, 0.01, plant=Foreign), 'Foreign has no measure'),
    (lambda: door.simulate(ARM, 0.01, plant=Demanding), r'an object, or what can be called with '
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


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: door.load_arm('x', friction=True), r"'friction' is True.*did you mean viscous"),
    (lambda: door.load_arm(), r"'urdf' is missing: expected load_arm\(urdf, joints="),
    (lambda: door.load_arm('x', viscous=0.1), r'True or False: whether it is learned'),
    (lambda: door.SumOfSinusoids(), r"'amplitude' is missing.*Shape \(n, terms\) \[rad\]"),
    (lambda: door.simulate(), r"'scenario' is missing"),
    (lambda: door.Controller(), r"'arm' is missing"),
    (lambda: door.read_bag(), r"'path' is missing"),
    (lambda: door.inverse_dynamics(ARM, Q, QD, Q), r"'qdd' is missing"),
    (lambda: door.Identifier(ARM).update(0.0, Q[0], dq=Q[0], tau=Q[0]),
     r"'dq'.*did you mean qd\?"),
    (lambda: door.Identifier(ARM).update(0.0, Q[0], Q[0]), r"'tau' is missing.*Mean torque"),
    (lambda: door.Controller(ARM).update(0.0, Q[0], Q[0]), r"'theta' is missing"),
    (lambda: door.Identifier(ARM).learn({'t': T}), r"'t' is .*learn\(t, q, qd, tau\)"),
    (lambda: door.Identifier(ARM).learn('log.csv'), r'learn\(read_log\(\.\.\.\)\)'),
    (lambda: door.Identifier(ARM).learn(T, Q, QD), r"'tau' is missing"),
    (lambda: door.identify(T, Q, QD, Q), r'given 4 arguments in order.*log: .*arrays by name'),
    (lambda: door.ControllerSettings(5.0), r'parameters by name: ControllerSettings\(law='),
    (lambda: door.Controller(ARM).retune({'k2': 5.0}), r"'t' is .*retune\(k2=50\.0\)"),
])
def test_a_call_that_lacks_something_is_told_what_it_is(call, message):
    with pytest.raises(door.ParameterError, match=message):
        call()


@pytest.mark.parametrize('name', ['theta0', 'initial', 'initial_guess'])
def test_other_names_of_a_start_value_are_told_ours(name):
    for call in (door.Identifier, door.simulate):
        with pytest.raises(door.ParameterError, match='did you mean .*initial_estimate'):
            call(ARM, **{name: [0.0] * 5})


@pytest.mark.parametrize(('changes', 'meant'), [
    ({'kd': 5.0}, r'controller\.k2'), ({'dt': 0.01}, r'arm_driver\.rate'),
    ({'time': 1.0}, r'duration'), ({'T': 1.0}, r'duration'), ({'q0': Q[0]}, 'initial_position'),
    ({'learning_rate': 1.0}, r'identifier\.gamma'), ({'max_torque': 1.0}, 'torque_limit'),
    ({'bounds': 1.0}, r'controller\.safety')])
def test_words_of_other_programs_are_told_ours(changes, meant):
    with pytest.raises(door.ParameterError, match=f'did you mean .*{meant}'):
        door.simulate(ARM, 0.01, **changes)


@pytest.mark.parametrize(('name', 'meant'), [
    ('load_urdf', 'load_arm'), ('read_csv', 'read_log'), ('identifyer', 'Identifier'),
    ('Simulate', 'simulate')])
def test_words_of_other_programs_are_told_the_names_of_the_door(name, meant):
    with pytest.raises(AttributeError, match=f'did you mean .*{meant}'):
        getattr(door, name)


def test_bounds_are_a_pair_where_that_has_one_meaning():
    controller = door.Controller(ARM, safety=(-1, 2.0), performance=[-0.1, 0.2])
    assert controller.safety.lower.tolist() == [-1.0, -1.0]
    assert controller.safety.upper.tolist() == [2.0, 2.0]
    assert controller.performance.lower.tolist() == [-0.1, -0.1]
    assert controller.performance.upper.tolist() == [0.2, 0.2]
    controller.retune(0.0, [0.0, 0.0], safety=(-1.5, 1.5))
    assert controller.safety.upper.tolist() == [1.5, 1.5]
    assert door.ControllerSettings(safety=(-1.0, 2.0)).safety.upper.tolist() == [2.0]
    for changes in ({'safety': (-1.0, 2.0)}, {'controller': {'safety': (-1.0, 2.0)}},
                    {'controller.safety': np.array([-1.0, 2.0])}):
        run = door.simulate(ARM, 1e-3, **changes)
        assert run.controller.safety.lower.tolist() == [-1.0, -1.0]
        assert run.controller.safety.upper.tolist() == [2.0, 2.0]


@pytest.mark.parametrize('given', [
    (0.5, 1.0), [1.0, 1.0], (1.0, -1.0), (0.0, 1.0), (-1.0, 0.0), (-1.0, 0.0, 1.0), 1.0,
    (True, 2.0), (-1.0, True), ([-1.0, -1.0], [1.0, 1.0]),
    [[-1.0, 1.0], [-1.0, 1.0]], (-1.0, float('nan'))])
def test_bounds_that_could_mean_two_things_are_refused_with_the_spelling(given):
    with pytest.raises(door.ParameterError, match=r"'safety' is .*{'lower': \.\.\., 'upper': "):
        door.Controller(ARM, safety=given)
    with pytest.raises(door.ParameterError, match='lower.*upper'):
        door.simulate(ARM, 1e-3, controller={'safety': given})


def test_a_group_that_is_given_a_value_is_told_its_members():
    for call in (lambda: door.Identifier(ARM, history=50), lambda: door.simulate(ARM, history=50),
                 lambda: door.simulate(ARM, identifier={'history': 50})):
        with pytest.raises(door.ParameterError, match=r"history' is 50.*: {.*'size': \.\."):
            call()


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'recorder': {'bag': 'x'}}, r"recorder uses it.*simulate\(\.\.\., bag='run'\)"),
    ({'executor': 'plain'}, 'runs no nodes'), ({'on_violation': 'stop'}, 'node controller'),
    ({'controller.state_timeout': 0.1}, 'node controller'),
    ({'gravity': [0.0, 0.0, 0.0]}, 'the arm is given'), ({'friction.coulomb': True}, 'arm is')])
def test_what_would_have_no_effect_on_a_run_is_refused(changes, reason):
    with pytest.raises(door.ParameterError, match=f'expected nothing: .*{reason}'):
        door.simulate(ARM, 0.01, **changes)


def test_what_a_plant_that_is_given_does_not_look_at_is_refused():
    with pytest.raises(door.ParameterError, match="'payload' is 1.*the plant is given.*Lost"):
        door.simulate(ARM, 0.01, plant=Lost(), payload=1.0)
    assert door.simulate(ARM, 0.01, plant=Lost(), rate=500.0, torque_limit=9.0).loop.period == 2e-3
    assert door.simulate(ARM, 0.01, plant=Lost, payload=1.0).t.size == 11  # it may look at them


def test_a_file_may_have_what_only_nodes_use(repository):
    assert door.simulate(repository / 'config' / 'two_link.yaml', 0.01).kept


def test_a_run_is_written_as_a_bag_where_one_is_asked_for(tmp_path):
    seen = []
    run = door.simulate(ARM, 0.02, bag=tmp_path / 'run', observer=seen.append)
    bag = door.read_bag(tmp_path / 'run')
    assert '/joint_states' in bag.topics
    assert len(seen) == run.t.size == 21
    with pytest.raises(door.BagError, match='exists already'):
        door.simulate(ARM, 0.02, bag=tmp_path / 'run')
    with pytest.raises(door.BagError, match='bag is 3: expected a path'):
        door.simulate(ARM, 0.02, bag=3)


def test_a_bag_of_objects_tells_no_true_parameters(tmp_path, repository):
    door.simulate(ARM, 0.02, bag=tmp_path / 'object')
    door.simulate(repository / 'config' / 'two_link.yaml', 0.02, bag=tmp_path / 'file')
    kept = {name: (tmp_path / name / 'metadata.yaml').read_text() for name in ('object', 'file')}
    assert '/arm_driver:' in kept['file']
    assert '/controller:' in kept['object']
    assert '/arm_driver:' not in kept['object']


def test_a_run_has_what_it_was_made_of_and_is_saved(tmp_path):
    run = door.simulate(ARM, 0.02, reference={'joint1': {'amplitude': 0.1}})
    assert (run.joints, run.parameters) == (ARM.joints, ARM.parameters)
    assert run.arm is ARM
    assert run.estimate == run.identifier.estimate
    assert run.undetermined == run.identifier.undetermined
    assert run.controller is run.loop.controller
    assert run.plant is run.loop.plant
    np.testing.assert_allclose(run.reference, run.q - run.e1)
    assert abs(run.reference).max() > 0.0
    with np.load(run.save(tmp_path / 'run.npz')) as saved:
        assert saved['joints'].tolist() == list(ARM.joints)
        np.testing.assert_array_equal(saved['q'], run.q)
        np.testing.assert_array_equal(saved['theta_hat'], run.theta_hat)
    read = door.read_log(run.save(str(tmp_path / 'run.npz')))  # replaced
    np.testing.assert_array_equal(read.tau, run.log().tau)
    assert [path.name for path in tmp_path.iterdir()] == ['run.npz']
    for path in (tmp_path / 'run.csv', 3, tmp_path / 'none' / 'run.npz'):
        with pytest.raises(door.ParameterError, match="'path' is"):
            run.save(path)
    assert run == run
    assert run != door.simulate(ARM, 0.01)


def test_an_identification_is_saved_as_what_an_identifier_starts_from(tmp_path):
    result = identified()
    assert (result.joints, result.parameters) == (ARM.joints, ARM.parameters)
    assert result.train_rmse.tolist() == result.figures['train_rmse']
    assert result.sigma_min == result.identifier.stack.sigma_min
    path = result.save(tmp_path / 'theta.yaml')
    backwards = dict(reversed(result.estimate.items()))
    for given in (str(path), result.theta, result.estimate, backwards):
        other = door.Identifier(ARM, initial_estimate=given)
        np.testing.assert_array_equal(other.theta, result.theta)
    run = door.simulate(ARM, 1e-3, initial_estimate=result.estimate)
    np.testing.assert_array_equal(run.theta_hat[0], result.theta)
    (tmp_path / 'mine.yaml').write_text('a: 1\n')
    for other in (tmp_path / 'mine.yaml', tmp_path / 'theta', 3):
        with pytest.raises(door.ParameterError, match="'path' is"):
            result.save(other)
    assert (tmp_path / 'mine.yaml').read_text() == 'a: 1\n'
    with pytest.raises(door.ParameterError, match=r'a value for each parameter.*no p2, p3'):
        door.Identifier(ARM, initial_estimate={'p1': 1.0, 'fv_joint1': 1.0, 'fv_joint2': 1.0})
    with pytest.raises(door.ParameterError, match=r"'p9' is none of them"):
        door.Identifier(ARM, initial_estimate={**result.estimate, 'p9': 1.0})


@pytest.mark.parametrize('reference', [
    door.SumOfSinusoids([0.0, 0.0], [0.1, 0.0], 2.0),
    {'joint1': {'amplitude': 0.1, 'frequency': 2.0}}])
def test_a_reference_is_given_to_simulate_as_it_is_to_a_controller(reference):
    run = door.simulate(ARM, 0.01, reference=reference)
    assert run.controller.reference.range()[1].tolist() == [pytest.approx(0.1), 0.0]


@pytest.mark.parametrize('reference', [len, [0.1, 0.2], 0.5, 'up', door.SumOfSinusoids])
def test_what_is_no_reference_is_told_its_three_forms(reference):
    for call in (door.Controller, door.simulate):
        with pytest.raises(door.ParameterError, match=r"'reference' is .*{'joint1': {'amplitude'.*"
                           r'a SumOfSinusoids, or an object with at\(t\)'):
            call(ARM, reference=reference)


def test_sinusoids_need_no_second_axis():
    plain = door.SumOfSinusoids([0.0, 1.0], [0.1, 0.2], 2.0)
    full = door.SumOfSinusoids([0.0, 1.0], [[0.1], [0.2]], [[2.0], [2.0]], [[0.0], [0.0]])
    np.testing.assert_array_equal(plain.at(0.3), full.at(0.3))
    assert repr(plain) == '<SumOfSinusoids: 2 joints, 1 terms, [-0.1, 0.8] to [0.1, 1.2] rad>'


@pytest.mark.parametrize('thing', [3, ARM.dynamics(ARM.nominal), Lost()])
def test_what_is_no_scenario_is_told_what_is_one(thing):
    with pytest.raises(door.ParameterError, match=r'an arm such as TwoLinkArm\(\)'):
        door.simulate(thing)
    with pytest.raises(door.ParameterError, match='load_arm reads a URDF'):
        door.simulate('robot.urdf')


@pytest.mark.parametrize('thing', ['two_link', 2, door.TwoLinkArm])
def test_what_is_no_arm_is_told_what_makes_one(thing):
    for call in (door.Identifier, door.Controller):
        with pytest.raises(door.ParameterError, match=r'as TwoLinkArm\(\), load_arm\(urdf\)'):
            call(thing)
    with pytest.raises(door.ArmError, match=r'load_arm\(urdf\) returns'):
        door.Arm('robot.urdf')


def test_objects_in_place_of_settings_are_told_where_they_go():
    for changes in ({'controller': door.Controller(ARM)}, {'identifier': door.Identifier(ARM)}):
        with pytest.raises(door.ParameterError, match=r'ClosedLoop\(plant, controller, identifi'):
            door.simulate(ARM, 0.01, **changes)


def test_a_whole_object_in_place_of_its_estimate_is_told_so():
    with pytest.raises(door.ParameterError, match=r"'theta' is <Identifier.*: its theta$"):
        door.Controller(ARM).update(0.0, Q[0], QD[0], door.Identifier(ARM))


class Frame:
    """A data frame, as pandas and polars have it."""

    def __init__(self, columns, index=None):
        """Take columns by name, and what was made the index."""
        self._data, self.columns, self.index = columns, list(columns), index

    def __getitem__(self, name):
        """Return a column."""
        return self._data[name]


class Labelled:
    """Numbers with names along their last axis, as a pandas Series or a data frame has them."""

    def __init__(self, values, names):
        """Take numbers and names."""
        self._values = np.asarray(values)
        setattr(self, 'index' if self._values.ndim == 1 else 'columns', names)
        if self._values.ndim > 1:
            self.index = range(len(self._values))

    def __array__(self, dtype=None, copy=None):
        """Return the numbers."""
        return np.array(self._values, dtype)


def test_numbers_with_names_are_put_in_the_order_of_the_names():
    back, theta = list(reversed(ARM.joints)), ARM.nominal
    whole = Labelled(theta[::-1], list(reversed(ARM.parameters)))
    np.testing.assert_array_equal(door.Identifier(ARM, initial_estimate=whole).theta, theta)
    np.testing.assert_array_equal(
        door.inverse_dynamics(ARM, whole, *(Labelled(Q[:, ::-1], back) for _ in range(3))),
        door.inverse_dynamics(ARM, theta, Q, Q, Q))
    output, asked = (door.Controller(ARM).update(0.0, *state, theta) for state in (
        [Labelled(0.1 * Q[0, ::-1], back), Labelled(QD[0, ::-1], back)], [0.1 * Q[0], QD[0]]))
    np.testing.assert_array_equal(output.torque, asked.torque)


def test_numbers_with_other_names_or_with_some_of_them_are_refused():
    with pytest.raises(door.ParameterError, match='the names joint1, joint2; to_numpy'):
        door.inverse_dynamics(ARM, ARM.nominal, *(Labelled(Q, ['a', 'b']) for _ in range(3)))
    with pytest.raises(door.ParameterError, match='one value for each of joint1, joint2'):
        door.Controller(ARM).update(0.0, Labelled(Q[0], ['joint2', 'a']), QD[0], ARM.nominal)


def test_a_setting_with_names_is_refused_because_settings_know_no_arm():
    with pytest.raises(door.ParameterError, match='torque_limit.*list of doubles'):
        door.Controller(ARM, torque_limit=Labelled([5.0, 50.0], ['joint2', 'joint1']))


TABLE = {'t': T, 'q1': Q[:, 0], 'q2': Q[:, 1], 'qd1': QD[:, 0], 'qd2': QD[:, 1],
         'tau1': Q[:, 0], 'tau2': Q[:, 1]}


@pytest.mark.parametrize('table', [
    Frame(TABLE), TABLE, {name: column.tolist() for name, column in TABLE.items()},
    np.rec.fromarrays(list(TABLE.values()), names=list(TABLE)), {**TABLE, 'note': T},
    {'velocity_1': TABLE['qd1'], 'velocity_2': TABLE['qd2'], 'stamp': T,
     **{name: TABLE[name] for name in ('q1', 'q2', 'tau1', 'tau2')}}],
    ids=['frame', 'mapping', 'lists', 'structured', 'more columns', 'other names'])
def test_a_table_in_memory_is_read_as_its_file_would_be(table):
    log = door.read_log(table)
    np.testing.assert_allclose(log.t, T)
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.qd, QD)
    np.testing.assert_array_equal(log.tau, Q)


def test_a_table_has_its_time_as_index_or_as_dates():
    class Index(np.ndarray):
        name = 't'

    values = {name: column for name, column in TABLE.items() if name != 't'}
    log = door.read_log(Frame(values, T.view(Index)))
    np.testing.assert_allclose(log.t, T)
    dates = np.datetime64('2024-05-01T12:00:00', 'ns') + (1e9 * T).astype('timedelta64[ns]')
    np.testing.assert_allclose(door.read_log({**TABLE, 't': dates}).t, T, atol=1e-9)


@pytest.mark.parametrize(('table', 'message'), [
    ({**TABLE, 'q2': ['a'] * len(T)}, r"column 'q2' holds something else than numbers"),
    ({name: TABLE[name] for name in TABLE if name != 't'}, r'missing column t: .*columns='),
    (np.zeros((9, 7)), r"an array of shape \(9, 7\).*{'t': a\[:, 0\], 'q': a\[:, 1:3\]"),
    ({'time': T, 'q': Q, 'dq': QD, 'tau': Q}, r"as in columns={'t': 'time', 'qd': 'dq'}"),
    ({'t': T, 'q': Q, 'tau': Q}, r"or filter={'state_order': 4}, which takes velocities")])
def test_a_table_that_is_no_log_is_told_what_is_missing(table, message):
    with pytest.raises(door.LogError, match=message):
        door.read_log(table)


def test_plants_and_sensors_are_named_as_laws_are():
    run = door.simulate(ARM, 0.01, plant='builtin', sensor='encoder', law='pd')
    assert run.plant.settings.sensors.model == 'encoder'
    for part in ({'plant': 'mujuco'}, {'sensor': 'camera'}):
        with pytest.raises(door.ParameterError, match=r"is '(mujuco|camera)': expected one of"):
            door.simulate(ARM, 0.01, **part)


def test_columns_are_named_one_by_one_in_a_list():
    table = {'zeit': T, 'a': Q[:, 0], 'b': Q[:, 1], 'c': QD[:, 0], 'd': QD[:, 1], 'e': Q[:, 0],
             'f': Q[:, 1]}
    log = door.read_log(table, columns={'t': 'zeit', 'q': ['a', 'b'], 'qd': ('c', 'd'),
                                        'tau': ['e', 'f']})
    np.testing.assert_array_equal(log.qd, QD)
    for wrong in ({'q': ['a', 2]}, {'t': ['zeit']}, {'q': None}):
        with pytest.raises(door.ParameterError, match="'columns' is .*a name or a list of names"):
            door.read_log(table, columns=wrong)


def test_joints_beside_an_arm_have_no_effect_and_are_refused():
    with pytest.raises(door.ParameterError, match="'joints' is .*nothing beside an arm"):
        door.identify(LOG, ARM, joints=['a', 'b'])


def test_a_log_of_one_joint_needs_no_second_axis():
    log = door.read_log({'t': T, 'q': T, 'qd': T, 'tau': T})
    assert log.q.shape == (len(T), 1)
    rail = door.Identifier(Rail())
    np.testing.assert_array_equal(rail.learn(T, T, T, T),
                                  door.Identifier(Rail()).learn(T, log.q, log.qd, log.tau))


def test_a_log_is_learned_as_a_whole():
    first, second, third = (door.Identifier(ARM) for _ in range(3))
    first.learn(T, Q, QD, Q)
    np.testing.assert_array_equal(second.learn(LOG), first.theta)
    np.testing.assert_array_equal(third.learn(door.read_log(LOG)), first.theta)


def test_an_arm_may_stand_where_a_urdf_could():
    for arm in (ARM, 'two_link'):
        result = door.identify(LOG, arm, filter={'time_constant': 0.01})
        np.testing.assert_array_equal(result.theta, identified().theta)


def test_an_arm_of_a_urdf_is_learned_as_it_is_and_its_result_can_be_copied():
    pytest.importorskip('pinocchio')
    arm = door.load_arm(PENDULUM, coulomb=True)
    log = {'t': T, 'q': Q[:, :1], 'qd': QD[:, :1], 'tau': Q[:, :1]}
    named = door.identify(log, arm=arm, filter={'time_constant': 0.01})
    for given in ((arm,), (arm, ['pivot'])):
        result = door.identify(log, *given, filter={'time_constant': 0.01})
        assert result.arm is arm
        assert result.figures['checks'] == named.figures['checks']
        np.testing.assert_array_equal(result.theta, named.theta)
    with pytest.raises(door.ParameterError, match=r"'friction\.offset' is True.*arm is given"):
        door.identify(log, arm, friction={'offset': True})
    controller = door.Controller(arm)
    for duplicate in (copy.deepcopy, _by_pickle):
        np.testing.assert_array_equal(duplicate(named).theta, named.theta)
        np.testing.assert_array_equal(duplicate(controller).safety.upper, controller.safety.upper)
        assert duplicate(door.simulate(arm, 0.01)).joints == ('pivot',)


def test_parts_show_what_they_are():
    loop = door.ClosedLoop(Lost(), door.Controller(ARM))
    assert repr(loop).startswith('<ClosedLoop of Lost, Controller, Identifier for <TwoLinkArm')
    assert repr(ARM.dynamics(ARM.nominal)) == '<CompiledDynamics of 2 joints (joint1, joint2)>'
    run = door.simulate(ARM, 0.01)
    assert repr(run.plant).startswith('<SimulatedArm of <TwoLinkArm')
    assert 'object at 0x' not in repr(run.controller.reference)
