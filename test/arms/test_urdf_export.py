# SPDX-License-Identifier: Apache-2.0
"""Facts about the URDF of an identified arm."""

from __future__ import annotations

import difflib
import warnings

import numpy as np
import pinocchio as pin
import pytest

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf_export import export_urdf
from adaptive_blf_control.bench.read_back import mujoco_errors
from adaptive_blf_control.errors import ArmError
from spatial_arm import spatial_arm, true_theta, URDF


@pytest.fixture(scope='module')
def arm():
    return spatial_arm()


@pytest.fixture(scope='module')
def theta(arm):
    return true_theta(arm)


@pytest.fixture(scope='module')
def inertial(arm):
    """Return parameters of possible bodies, each another than the described one."""
    return arm.inertial * np.array([1.3, 0.8, 1.2])[:, None]


def rigid(xml: str, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Return Pinocchio's torque, rigid bodies alone, of a URDF."""
    model = pin.buildModelFromXML(xml)
    return pin.rnea(model, model.createData(), q, qd, qdd)


def test_read_back_it_predicts_the_same_torques(arm, theta, inertial):
    xml = export_urdf(arm, theta, inertial).xml
    base = np.append(arm.base_from_inertial(inertial), np.zeros(arm.m - arm.base_count))
    for state in np.random.default_rng(5).normal(size=(20, 3, 3)):
        np.testing.assert_allclose(rigid(xml, *state), arm.Y(*state) @ base, atol=1e-11)


def test_mujoco_predicts_the_same_torques(arm, theta, inertial, tmp_path):
    pytest.importorskip('mujoco', reason='the extra mujoco is not installed')
    (tmp_path / 'arm.urdf').write_text(export_urdf(arm, theta, inertial).xml)
    as_read, with_the_inertias_of_the_file = mujoco_errors(tmp_path / 'arm.urdf')
    assert as_read < 1e-8
    assert with_the_inertias_of_the_file < 1e-12


def test_friction_is_read_back(arm, theta, inertial):
    back = spatial_arm(export_urdf(arm, theta, inertial).xml)
    np.testing.assert_array_equal(back.friction(back.nominal)[:2], arm.friction(theta)[:2])


def test_an_arm_that_leaves_out_the_coulomb_friction_of_its_urdf_is_loaded_with_a_warning(
        arm, theta, inertial):
    exported = export_urdf(arm, theta, inertial)
    stated = ', '.join(f'{joint} {value:.4g} N·m'
                       for joint, value in zip(arm.joints, arm.friction(theta)[1], strict=True))
    with pytest.warns(UserWarning, match=f'{stated}.*coulomb=True') as caught:
        loaded = load_arm(exported)
    assert caught[0].filename == __file__
    assert not loaded.friction(loaded.nominal)[1].any()
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        whole = load_arm(exported, coulomb=True)
        load_arm(exported, coulomb=False)
        load_arm(URDF.replace('friction=', 'not_friction='))
    np.testing.assert_allclose(whole.friction(whole.nominal)[1], arm.friction(theta)[1])


def test_nothing_but_inertials_and_dynamics_changes(arm, theta, inertial):
    xml = export_urdf(arm, theta, inertial).xml
    removed = [line[1:] for line in difflib.ndiff(URDF.splitlines(), xml.splitlines())
               if line.startswith('- ')]
    assert all(any(tag in line for tag in ('<mass', '<origin', '<inertia', '<dynamics',
                                           '<link name="fore"/>', 'velocity=', 'rpy="0.3 0 0"/>'))
               for line in removed), removed
    for kept in ('<!-- an arm with a tool: this comment stays -->', '<!-- measured on a scale -->',
                 'other="kept"', '<box size="0.1 0.1 0.3"/>', '<?xml version="1.0"?>'):
        assert kept in xml


def test_what_is_carried_keeps_its_own_inertial(arm, theta, inertial):
    exported = export_urdf(arm, theta, inertial)
    assert exported.scaled == {}
    assert '<link name="tool"><inertial><origin xyz="0 0 0.03"/><mass value="0.4"/>' in \
        exported.xml


def test_what_is_carried_is_scaled_where_it_weighs_more_than_all(arm, theta, inertial):
    light = inertial.copy()
    light[2] *= 0.3
    exported = export_urdf(arm, theta, light)
    assert list(exported.scaled) == ['tool']
    assert 0.0 < exported.scaled['tool'] < 0.3
    back = spatial_arm(exported.xml)
    np.testing.assert_allclose(back.inertial, light, atol=1e-14)


def test_friction_that_is_not_learned_stays_as_described(inertial):
    plain = spatial_arm(friction_viscous=False, friction_coulomb=False)
    theta = np.append(plain.base_from_inertial(inertial), np.zeros(plain.m - plain.base_count))
    assert 'damping="0.7" friction="0.2" other="kept"' in export_urdf(plain, theta, inertial).xml


def test_what_a_urdf_cannot_say_is_named(arm, theta, inertial):
    missing = export_urdf(arm, theta, inertial).missing
    assert set(missing) == {name for name in arm.parameters
                            if name.startswith(('Ia_', 'f0_', 'fs_'))}
    assert missing['f0_lift'] == theta[arm.parameters.index('f0_lift')]


def test_an_impossible_body_is_refused_by_name(arm, theta, inertial):
    broken = inertial.copy()
    broken[1, 9] = 5.0
    with pytest.raises(ArmError, match="'lift' are not physically consistent"):
        export_urdf(arm, theta, broken)


def test_what_a_urdf_has_no_place_for_has_every_rotor_of_the_model(arm, theta, inertial):
    rotor = np.array([1.4, 0.0, 0.2])
    missing = export_urdf(arm, theta, inertial, rotor).missing
    assert {name: value for name, value in missing.items() if name.startswith('Ia_')} == {
        f'Ia_{arm.joints[0]}': 1.4, f'Ia_{arm.joints[2]}': 0.2}
