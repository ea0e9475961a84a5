# SPDX-License-Identifier: Apache-2.0
"""Facts about the objects of the door: what is set, written, compared, copied or listed."""

from __future__ import annotations

import copy
import pickle
import re

import numpy as np
import pytest

import adaptive_blf_control as door

ARM = door.TwoLinkArm()
ZERO = [0.0, 0.0]
T = np.linspace(0.0, 2.0, 1001)
LOG = {'t': T, 'q': np.column_stack([np.sin(3.0 * T), np.cos(2.0 * T)]),
       'qd': np.column_stack([3.0 * np.cos(3.0 * T), -2.0 * np.sin(2.0 * T)])}
LOG['tau'] = LOG['q']


def controller():
    return door.Controller(ARM)


def output():
    return controller().update(0.0, [0.1, 0.0], [0.2, 0.0], np.arange(5.0))


def loop():
    return door.simulate(ARM, 0.01).loop


@pytest.mark.parametrize(('subject', 'name', 'hint'), [
    (door.TwoLinkArm, 'nominal', r'simulate\(arm, true_model=.given., true_parameters='),
    (door.ThreeLinkArm, 'payload_direction', 'true_parameters='),
    (door.TwoLinkArm, 'joints', 'named where the arm is made'),
    (door.TwoLinkArm, 'parameters', 'make another TwoLinkArm'),
    (controller, 'arm', 'make another Controller'),
    (controller, 'settings', r'retune\(settings=\.\.\.\)'),
    (controller, 'constraints', r'retune\(constraints='),
    (lambda: door.Identifier(ARM), 'arm', 'make another Identifier'),
    (loop, 'arm', 'make another ClosedLoop'),
    (lambda: ARM.dynamics(ARM.nominal), 'arm', 'make another CompiledDynamics'),
    (lambda: door.Identifier(ARM).stack, 'size', r'retune\(history='),
    (lambda: door.Identifier(ARM).stack, 'rank', 'make another HistoryStack'),
    (lambda: controller().constraints, 'parts', r'Controller\(\.\.\., constraints='),
    (lambda: loop().plant, 'settings', r'retune\(settings\.replace\(payload=')])
def test_what_an_object_was_made_of_cannot_be_set(subject, name, hint):
    made = subject()
    before = getattr(made, name)
    with pytest.raises(AttributeError, match=f'{name} cannot be set: .*{hint}'):
        setattr(made, name, None)
    assert getattr(made, name) is before


@pytest.mark.parametrize(('subject', 'name', 'hint'), [
    (door.TwoLinkArm, 'theta_star', r'did you mean nominal\?'),
    (controller, 'torque_limits', r'did you mean settings\.torque_limit\?'),
    (lambda: door.Identifier(ARM), 'learning_rate', r'did you mean settings\.gamma\?'),
    (loop, 'periods', r'did you mean period\?'),
    (lambda: door.Identifier(ARM).stack, 'siz', r'did you mean size\?'),
    (lambda: controller().constraints, 'safety', 'the controller has it'),
    (lambda: loop().plant, 'payload', 'settings has what it was made with'),
    (lambda: loop().plant, 'torques', r'did you mean torque\?')])
def test_a_name_that_an_object_does_not_have_cannot_be_set_either(subject, name, hint):
    with pytest.raises(AttributeError, match=f"no attribute '{name}': {hint}"):
        setattr(subject(), name, 1.0)


def test_an_object_of_a_class_of_a_user_stays_open():
    class Own(door.Controller):
        """Counts its samples."""

        def __init__(self, arm):
            super().__init__(arm)
            self.samples = 0

    own = Own(ARM)
    own.samples += 1
    assert own.samples == 1


def test_limits_of_an_arm_can_be_set_and_are_the_arms_own():
    arm, limit = door.TwoLinkArm(), np.array([5.0, 5.0])
    arm.torque_limit = limit
    limit[:] = 1e9
    assert any('5' in note for note in door.Controller(arm, torque_limit=80.0).notes)


@pytest.mark.parametrize('array', [
    lambda: door.TwoLinkArm().nominal, lambda: door.ThreeLinkArm().payload_direction,
    lambda: door.Identifier(ARM).theta, lambda: door.Identifier(ARM).stack.gram,
    lambda: door.Identifier(ARM).stack.regressors, lambda: controller().safety.lower,
    lambda: controller().settings.k1])
def test_an_array_that_others_rely_on_cannot_be_written(array):
    with pytest.raises(ValueError, match='read-only'):
        array()[0] = 5.0


def test_the_estimate_that_update_returns_is_the_callers():
    identifier = door.Identifier(ARM)
    for k in range(3):
        theta = identifier.update(0.001 * k, *([0.1, 0.2],) * 3)
    before = identifier.estimate
    theta[:] = 77.0
    assert identifier.estimate == before
    np.testing.assert_array_equal(identifier.theta, list(before.values()))


@pytest.mark.parametrize('made', [
    output, lambda: output().state, lambda: output().reference, lambda: output().bounds,
    lambda: controller().safety,
    lambda: door.Measurement(np.ones(2), np.full(2, np.nan), np.ones(2)),
    lambda: door.LawAnswer(np.ones(2), np.ones(2), None)])
@pytest.mark.parametrize('duplicate', [
    copy.copy, copy.deepcopy, lambda given: pickle.loads(pickle.dumps(given))])
def test_what_has_equal_arrays_is_equal_and_stays_so_when_it_is_copied(made, duplicate):
    given = made()
    assert duplicate(given) == given
    assert (duplicate(given) != given) is False
    assert given != None  # noqa: E711, what a program may write
    assert given != made


def test_what_differs_in_one_element_is_not_equal():
    first = output()
    second = first._replace(torque=first.torque + [0.0, 1e-12])
    assert first != second
    assert first.torque in first
    assert second.torque not in first
    safety = controller().safety
    assert safety != door.Controller(ARM, safety=(-1.0, 1.0)).safety
    assert hash(safety) == hash(controller().safety)


def test_what_has_one_shape_is_an_array_and_what_has_not_says_what_it_has():
    point = output().reference
    assert np.asarray(point).shape == (3, 2)
    with pytest.raises(TypeError, match='ControlOutput is no array: it has torque, adaptation'):
        np.asarray(output())


@pytest.mark.parametrize(('made', 'message'), [
    (lambda: ARM, 'TwoLinkArm is no array: its nominal is'),
    (lambda: door.Identifier(ARM), 'Identifier is no array: its theta is'),
    (lambda: door.read_log(LOG), 'MeasuredLog is no array: its t, q, qd, tau are'),
    (lambda: door.simulate(ARM, 0.01), 'Simulation is no array: its t, q, qd, torque are'),
    (controller, 'Controller is no array')])
def test_an_object_that_is_no_array_says_which_it_has(made, message):
    with pytest.raises(TypeError, match=message):
        np.asarray(made())


def test_an_object_in_place_of_an_array_is_told_which_is_meant():
    with pytest.raises(door.ParameterError, match=r"'theta' is .*shape \(5,\).*: its theta$"):
        controller().update(0.0, ZERO, ZERO, door.Identifier(ARM))


@pytest.mark.parametrize('error', [
    door.ParameterError('k1', -1.0, 'more'), door.UnknownParameter('k3', 1.0, ['k1', 'k2']),
    door.SetViolation('joint1', 2.0, 1.0, 'outside'), door.MissingExtra('pinocchio', 'urdf', 'it'),
    door.ArmError('none')])
@pytest.mark.parametrize('duplicate', [
    copy.copy, copy.deepcopy, lambda given: pickle.loads(pickle.dumps(given))])
def test_an_error_passes_from_one_process_to_another(error, duplicate):
    other = duplicate(error)
    assert (type(other), str(other), vars(other)) == (type(error), str(error), vars(error))


def test_a_reference_that_is_called_without_a_time_is_told_so():
    with pytest.raises(door.ParameterError, match="'t' is missing"):
        controller().reference()


def test_arms_at_hand_are_listed_with_what_makes_them():
    found = door.list_arms()
    assert found['two_link'] == 'TwoLinkArm()'
    assert eval(found['three_link'], {'ThreeLinkArm': door.ThreeLinkArm}).n == 3
    if 'panda' in found:  # example-robot-data is installed
        address, = re.findall(r"load_arm\('(.*)'\)", found['panda'])
        assert 'panda_joint1' in door.load_arm(address).joints
        with pytest.raises(door.ParameterError, match=r"of this name is load_arm\('package:"):
            door.load_arm('panda')


@pytest.mark.parametrize('name', door.list_scenarios())
def test_every_scenario_that_is_listed_runs(name):
    assert door.simulate(name, 0.01).q.shape[0] > 1
