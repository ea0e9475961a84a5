# SPDX-License-Identifier: Apache-2.0
"""Facts about the objects that are built from a parameter file."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.configuration.build_arm import ArmStore, build_arm
from adaptive_blf_control.configuration.build_identifier import build_identifier
from adaptive_blf_control.configuration.build_plant import build_plant
from adaptive_blf_control.configuration.initial_theta import initial_theta
from adaptive_blf_control.configuration.node_settings import NODE_SETTINGS
from adaptive_blf_control.configuration.parameter_file import (
    apply_settings,
    load_yaml,
    node_settings,
)
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.errors import ArmError, BlfError, ParameterError, SetViolation
from adaptive_blf_control.identification.estimate_file import write_estimate
from adaptive_blf_control.identification.knowledge import Snapshot

START = np.array([0.0, 2.0])


@pytest.fixture
def values(repository):
    """Return ``values(node, setting, ...)``: settings of config/two_link.yaml, changed."""
    def of(node: str, *settings: str):
        data = load_yaml(repository / 'config' / 'two_link.yaml')
        return node_settings(apply_settings(data, list(settings)), NODE_SETTINGS[node])
    return of


def test_controller_has_the_gains_sets_and_reference_of_the_file(values):
    given = values('controller', 'controller.k1=[40.0, 30.0]', 'controller.k2=[25.0]',
                   'controller.coupling=pseudoinverse', 'controller.torque_limit=[70.0, 60.0]')
    controller = Controller(build_arm(given), given, start=START)
    np.testing.assert_array_equal(controller.settings.k1, [40.0, 30.0])
    np.testing.assert_array_equal(controller.settings.k2, [25.0, 25.0])
    np.testing.assert_array_equal(controller.settings.torque_limit, [70.0, 60.0])
    assert controller.settings.coupling == 'pseudoinverse'
    np.testing.assert_array_equal(controller.safety.lower, [-1.17, -2.17])
    np.testing.assert_array_equal(controller.safety.upper, [1.2, 2.2])
    np.testing.assert_array_equal(controller.performance.lower, [-0.17, -0.17])
    np.testing.assert_array_equal(controller.performance.upper, [0.2, 0.2])
    point = controller.reference.at(3.0)
    np.testing.assert_allclose(point.position, [np.sin(1.5), 2 * np.cos(1.5)])
    np.testing.assert_allclose(point.velocity, [0.5 * np.cos(1.5), -np.sin(1.5)])


def test_joints_with_fewer_sinusoids_are_filled_up_with_nothing(values):
    given = values('controller', 'controller.reference.joint2.amplitude=[1.0, 0.5, 0.25]',
                   'controller.reference.joint2.frequency=[1.0, 2.0, 3.0]',
                   'controller.reference.joint2.phase=[0.0, 0.1, 0.2]',
                   'controller.reference.joint2.offset=0.25')
    reference = Controller(build_arm(given), given).reference
    expected = 0.25 + np.sin(0.7) + 0.5 * np.sin(1.5) + 0.25 * np.sin(2.3)
    np.testing.assert_allclose(reference.at(0.7).position, [np.sin(0.35), expected])


def test_sinusoids_of_different_lengths_are_refused(values):
    given = values('controller', 'controller.reference.joint2.phase=[0.0, 0.1]')
    with pytest.raises(ParameterError, match=r'controller\.reference\.joint2.*same length'):
        Controller(build_arm(given), given, start=START)


def test_smooth_start_begins_in_the_measured_posture(values):
    given = values('controller', 'controller.reference.smooth_start=2.0')
    start = np.array([0.7, 1.2])
    reference = Controller(build_arm(given), given, start=start).reference
    np.testing.assert_array_equal(reference.at(0.0).position, start)
    np.testing.assert_allclose(reference.at(2.5).position, [np.sin(1.25), 2 * np.cos(1.25)])


def test_a_start_outside_a_set_is_refused(values):
    given = values('controller')
    with pytest.raises(SetViolation, match="'joint2': start error"):
        Controller(build_arm(given), given, start=np.array([0.0, 1.7]))


def test_sets_are_checked_without_a_start(values):
    given = values('controller', 'controller.safety.upper=[1.1, 2.2]')
    with pytest.raises(SetViolation, match="'joint1'.*exceeds the safety set above"):
        Controller(build_arm(given), given)


def test_identifier_has_the_gains_of_the_file(values):
    given = values('identifier', 'identifier.kt=3.0', 'identifier.kh=4.0',
                   'identifier.gamma=[2.0]', 'identifier.filter.time_constant=0.03',
                   'identifier.filter.gap=0.2', 'identifier.filter.settle=5.0',
                   'identifier.history.size=11', 'identifier.history.epsilon=0.3')
    settings = build_identifier(given, build_arm(given)).settings
    assert (settings.kt, settings.kh) == (3.0, 4.0)
    filters, history = settings.filter, settings.history
    assert (filters.time_constant, filters.gap, filters.settle) == (0.03, 0.2, 5.0)
    assert (history.size, history.epsilon) == (11, 0.3)
    np.testing.assert_array_equal(settings.gamma, np.full(5, 2.0))
    np.testing.assert_array_equal(settings.initial_estimate, [0.0, 9.0, 6.0, 0.0, 0.0])


@pytest.mark.parametrize('name', ['gamma', 'initial_estimate'])
def test_identifier_arrays_have_one_value_for_each_parameter(values, name):
    given = values('identifier', f'identifier.{name}=[1.0, 2.0, 3.0]')
    with pytest.raises(ParameterError, match=rf'identifier\.{name}.*length 1 or 5'):
        build_identifier(given, build_arm(given))


def test_identifier_starts_from_a_saved_estimate(values, tmp_path):
    path = tmp_path / 'theta.yaml'
    path.write_text('theta_hat: {fv_joint2: 5.0, p1: 1.0, p2: 2.0, p3: 3.0, fv_joint1: 4.0}')
    given = values('identifier', f'identifier.initial_estimate_file={path}')
    theta = build_identifier(given, build_arm(given)).theta
    np.testing.assert_array_equal(theta, [1.0, 2.0, 3.0, 4.0, 5.0])


def test_an_estimate_that_is_given_takes_the_place_of_the_file(values):
    given = values('identifier', 'identifier.initial_estimate_file=/nowhere/theta.yaml')
    estimate = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    identifier = build_identifier(given, build_arm(given), estimate)
    np.testing.assert_array_equal(identifier.theta, estimate)
    with pytest.raises(ParameterError, match='nowhere'):
        build_identifier(given, build_arm(given))


def test_controller_starts_from_the_initial_estimate_or_the_known_parameters(values):
    given = values('controller')
    np.testing.assert_array_equal(initial_theta(given, build_arm(given)),
                                  [0.0, 9.0, 6.0, 0.0, 0.0])
    given = values('controller', 'controller.model=known', 'controller.known_parameters=[2.0]')
    np.testing.assert_array_equal(initial_theta(given, build_arm(given)), np.full(5, 2.0))


@pytest.mark.parametrize(('name', 'more'), [
    ('initial_estimate', ()), ('known_parameters', ('controller.model=known',))])
def test_controller_takes_parameters_from_a_file_by_name(values, tmp_path, name, more):
    path = tmp_path / 'theta_hat.yaml'
    names = ('fv_joint2', 'p3', 'p2', 'p1', 'fv_joint1')
    write_estimate(path, Snapshot(names, np.array([0.8, 0.3, 0.2, 4.0, 5.6]), 5, 1.0, 9))
    given = values('controller', *more, f'controller.{name}={path}')
    np.testing.assert_array_equal(initial_theta(given, build_arm(given)),
                                  [4.0, 0.2, 0.3, 5.6, 0.8])
    given = values('controller', *more, f'controller.{name}=/nowhere/theta.yaml')
    with pytest.raises(ParameterError, match=rf'controller\.{name}.*nowhere'):
        initial_theta(given, build_arm(given))


@pytest.mark.parametrize(('settings', 'name'), [
    (['controller.initial_estimate=[1.0, 2.0]'], 'initial_estimate'),
    (['controller.model=known', 'controller.known_parameters=[1.0, 2.0]'], 'known_parameters')])
def test_controller_estimate_has_one_finite_value_for_each_parameter(values, settings, name):
    given = values('controller', *settings)
    with pytest.raises(ParameterError, match=rf'controller\.{name}.*length 1 or 5'):
        initial_theta(given, build_arm(given))


def test_a_controller_estimate_that_is_not_finite_is_refused(values):
    with pytest.raises(ParameterError, match=r'controller\.initial_estimate.*finite'):
        values('controller').replace(initial_estimate=[float('inf')])


def test_plant_has_the_state_and_the_parameters_of_the_file(values):
    given = values('arm_driver', 'arm_driver.torque_limit=[12.0]')
    plant = build_plant(given, build_arm(given))
    np.testing.assert_array_equal(plant.q, [0.0, 2.0])
    np.testing.assert_array_equal(plant.qd, [0.5, 0.0])
    np.testing.assert_array_equal(plant.torque_limit, [12.0, 12.0])
    (_, theta), = plant.truth(('p1', 'p2', 'p3', 'fv_joint1', 'fv_joint2'))
    np.testing.assert_array_equal(theta, [3.473, 0.196, 0.242, 5.3, 1.1])


def test_true_parameters_that_do_not_fit_the_arm_are_refused(values):
    given = values('arm_driver', 'arm_driver.true_parameters=[1.0, 2.0]')
    with pytest.raises(ParameterError, match=r'arm_driver\.true_parameters.*5 values: p1 p2 p3'):
        build_plant(given, build_arm(given))


@pytest.mark.parametrize('p1', [0.0, -3.0, float('nan'), float('inf')])
def test_true_parameters_without_inertia_are_refused(values, p1):
    given, arm = values('arm_driver'), build_arm(values('arm_driver'))
    with pytest.raises(BlfError):
        build_plant(given.replace(true_parameters=[p1, 0.2, 0.2, 5.3, 1.1]), arm)


@pytest.mark.parametrize('name', ['initial_position', 'initial_velocity'])
def test_an_infinite_start_is_refused(values, name):
    with pytest.raises(ParameterError, match=rf'arm_driver\.{name}.*finite'):
        values('arm_driver', f'arm_driver.{name}=[.inf, 0.0]')
    with pytest.raises(ParameterError, match=rf'arm_driver\.{name}.*finite'):
        values('arm_driver').replace(**{name: [float('inf'), 0.0]})


@pytest.mark.parametrize(('joints', 'expected'), [
    ([], 'distinct joint names, at least one'), (['a', 'a'], 'distinct joint names')])
def test_joint_names_are_distinct(values, joints, expected):
    with pytest.raises(ParameterError, match=expected):
        build_arm(values('arm_driver').replace(joints=joints))


def test_the_two_link_arm_has_two_joints(values):
    with pytest.raises(ArmError, match='two joints'):
        build_arm(values('arm_driver').replace(joints=['a', 'b', 'c']))


def test_a_urdf_arm_needs_a_urdf(values):
    pytest.importorskip('pinocchio')
    with pytest.raises(ParameterError, match="'urdf'.*a path, package"):
        build_arm(values('arm_driver', 'arm=urdf'))


def test_arms_of_the_same_settings_are_built_once(values):
    arms = ArmStore()
    controller = values('controller')
    assert arms.arm(controller) is arms.arm(values('identifier'))
    assert arms.arm(controller) is not arms.arm(values('controller', 'gravity=[0.0, 0.0, -1.6]'))


def test_a_store_keeps_the_arms_that_were_asked_for_last(values):
    arms, first = ArmStore(), values('controller')
    built = arms.arm(first)
    others = [values('controller', f'gravity=[0.0, 0.0, {-i}.0]') for i in range(ArmStore.LARGEST)]
    forgotten = arms.arm(others[0])
    for other in others[1:]:
        arms.arm(other)
        assert arms.arm(first) is built
    assert arms.arm(others[0]) is not forgotten
