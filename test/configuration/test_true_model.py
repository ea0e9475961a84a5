# SPDX-License-Identifier: Apache-2.0
"""Facts about where θ* of the simulated arm comes from."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.three_link import three_link_parameters
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.configuration.parameter_file import apply_settings, node_settings
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.estimate_file import write_estimate
from adaptive_blf_control.identification.knowledge import Snapshot
from adaptive_blf_control.simulation.true_arm import true_theta
from spatial_arm import JOINTS, URDF


def theta(*settings: str) -> np.ndarray:
    values = node_settings(apply_settings({}, list(settings)), DriverSettings)
    return true_theta(values, build_arm(values))


THREE = ('arm=three_link', 'joints=[a, b, c]')
GIVEN = 'arm_driver.true_model=given'


def test_nominal_is_the_default():
    np.testing.assert_array_equal(theta(), [3.473, 0.196, 0.242, 5.3, 1.1])
    np.testing.assert_array_equal(theta(*THREE), three_link_parameters())


def test_given_parameters_are_taken_as_they_are():
    given = 'arm_driver.true_parameters=[4.0, 0.2, 0.3, 5.6, 0.8]'
    np.testing.assert_array_equal(theta(GIVEN, given), [4.0, 0.2, 0.3, 5.6, 0.8])


def test_a_payload_comes_on_top_of_either():
    np.testing.assert_allclose(theta(*THREE, 'arm_driver.payload=2.0'), three_link_parameters(2.0))
    half = three_link_parameters() / 2.0
    given = f'arm_driver.true_parameters={half.tolist()}'
    np.testing.assert_allclose(theta(*THREE, GIVEN, given, 'arm_driver.payload=2.0') - half,
                               three_link_parameters(2.0) - three_link_parameters())


@pytest.fixture
def written(tmp_path):
    """Write parameters by name as ``identify`` does, in another order than the arm's."""
    path = tmp_path / 'theta_hat.yaml'
    names = ('fv_joint2', 'p3', 'p2', 'p1', 'fv_joint1')
    write_estimate(path, Snapshot(names, np.array([0.8, 0.3, 0.2, 4.0, 5.6]), 5, 1.0, 9))
    return path


def test_they_may_come_from_a_file_by_name(written):
    np.testing.assert_array_equal(theta(GIVEN, f'arm_driver.true_parameters={written}'),
                                  [4.0, 0.2, 0.3, 5.6, 0.8])


@pytest.mark.parametrize(('more', 'message'), [
    ((), 'true_parameters.*true_model: given'),
    ((GIVEN, *THREE), "true_parameters.*an entry 'p4'")])
def test_a_file_that_does_not_fit_is_refused(written, more, message):
    with pytest.raises(ParameterError, match=message):
        theta(f'arm_driver.true_parameters={written}', *more)


@pytest.mark.parametrize(('settings', 'message'), [
    (('arm_driver.true_parameters=[4.0, 0.2, 0.3, 5.6, 0.8]',), 'true_model: given'),
    ((GIVEN, 'arm_driver.true_parameters=[4.0, 0.2]'), 'p1 p2 p3 fv_joint1 fv_joint2'),
    ((GIVEN,), '5 values'),
    (('arm_driver.payload=1.0',), 'TwoLinkArm has no tip'),
    ((*THREE, 'arm_driver.payload=-1.0'), 'payload'),
    (('arm_driver.true_model=guess',), 'nominal, given')])
def test_what_does_not_fit_together_is_refused(settings, message):
    with pytest.raises(ParameterError, match=message):
        theta(*settings)


def test_rotors_and_square_root_friction_of_the_true_arm_are_those_of_its_settings(tmp_path):
    pytest.importorskip('pinocchio')
    (tmp_path / 'arm.urdf').write_text(URDF, encoding='utf-8')
    settings = node_settings(apply_settings({}, [
        'arm=urdf', f'urdf={tmp_path / "arm.urdf"}', f'joints={list(JOINTS)}',
        'arm_driver.true_friction.rotor_inertia=[0.3, 0.2, 0.1]',
        'arm_driver.true_friction.square_root=[0.5]']), DriverSettings)
    arm = build_arm(settings)
    truth = true_theta(settings, arm)
    np.testing.assert_array_equal(arm.rotor_inertia(truth), [0.3, 0.2, 0.1])
    np.testing.assert_array_equal(arm.friction(truth)[3], [0.5, 0.5, 0.5])


def _arm_with_rotors(tmp_path, *settings):
    pytest.importorskip('pinocchio')
    (tmp_path / 'arm.urdf').write_text(URDF, encoding='utf-8')
    return build_arm(node_settings(apply_settings({}, [
        'arm=urdf', f'urdf={tmp_path / "arm.urdf"}', f'joints={list(JOINTS)}',
        'friction.nominal_rotor_inertia=[0.3, 0.2, 0.1]', *settings]), DriverSettings))


def test_rotors_are_those_that_are_stated_unless_the_true_arm_has_others(tmp_path):
    learned = 'friction.rotor_inertia=true'
    assert _arm_with_rotors(tmp_path, learned).rotor.tolist() == [0.3, 0.2, 0.1]
    other = _arm_with_rotors(tmp_path, learned, 'arm_driver.true_friction.rotor_inertia=[0.7]')
    assert other.rotor.tolist() == [0.7, 0.7, 0.7]


def test_rotors_that_are_stated_but_not_in_the_model_are_refused(tmp_path):
    with pytest.raises(ParameterError, match=r'nominal_rotor_inertia.*0\.3.*rotor_inertia is off'):
        _arm_with_rotors(tmp_path)
