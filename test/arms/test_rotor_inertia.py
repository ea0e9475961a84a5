# SPDX-License-Identifier: Apache-2.0
"""Facts about rotor inertia and square-root friction of a URDF arm."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from adaptive_blf_control.errors import ParameterError
from spatial_arm import pairs, spatial_arm, URDF

ROTOR = np.array([0.3, 0.2, 0.1])
STATE = np.random.default_rng(4).normal(size=(3, 3))


def described(arm, q, qd, qdd):
    """Return the torque of Pinocchio's rigid bodies with rotors and friction beside them."""
    dry = 0.5 + 0.8 * np.sqrt(np.abs(qd))
    rigid = pin.rnea(arm.model, arm.model.createData(), q, qd, qdd)
    return rigid + ROTOR * qdd + 0.4 * qd + dry * np.tanh(qd / 0.02) - 0.1


@pytest.fixture(scope='module')
def arm():
    return spatial_arm(rotor=ROTOR, viscous=0.4, coulomb=0.5, square_root=0.8, offset=-0.1)


def test_torque_has_the_rotors_and_the_square_root(arm):
    np.testing.assert_allclose(arm.Y(*STATE) @ arm.nominal, described(arm, *STATE), atol=1e-11)


def test_momentum_has_the_rotors(arm):
    q, qd, _ = STATE
    mass = pin.crba(arm.model, arm.model.createData(), q)
    mass = np.triu(mass) + np.triu(mass, 1).T + np.diag(ROTOR)
    np.testing.assert_allclose(arm.Y1(q, qd) @ arm.nominal, mass @ qd, atol=1e-12)
    np.testing.assert_allclose(arm.dynamics(arm.nominal).mass_matrix(q), mass, atol=1e-12)


def test_forward_dynamics_undo_the_torque(arm):
    q, qd, qdd = STATE
    found = arm.dynamics(arm.nominal).acceleration(q, qd, described(arm, q, qd, qdd))
    np.testing.assert_allclose(found, qdd, atol=1e-9)


def test_a_rotor_that_no_torque_tells_from_its_link_has_no_column(arm):
    rotors = [name for name in arm.parameters if name.startswith('Ia_')]
    assert rotors == ['Ia_bend']  # turn: vertical, first; lift: like its link's Iyy
    regressors, _ = pairs(arm, arm.nominal)
    assert np.linalg.matrix_rank(regressors.reshape(-1, arm.m)) == arm.m


def test_parameters_come_back_as_links_and_rotors(arm):
    np.testing.assert_allclose(arm.to_inertial(arm.nominal), arm.inertial, atol=1e-14)
    np.testing.assert_allclose(arm.rotor_inertia(arm.nominal), ROTOR, atol=1e-15)
    changed = arm.nominal.copy()
    changed[arm.parameters.index('Ia_bend')] += 0.7
    np.testing.assert_allclose(arm.rotor_inertia(changed), [0.3, 0.2, 0.8], atol=1e-15)


def test_without_it_nothing_is_as_if_it_were_there():
    plain = spatial_arm(rotor_inertia=False, friction_square_root=False)
    assert not any(name.startswith(('Ia_', 'fs_')) for name in plain.parameters)
    assert not plain.rotor.any()
    with pytest.raises(ParameterError, match='rotor'):
        spatial_arm(rotor_inertia=False, rotor=0.1)
    with pytest.raises(ParameterError, match='rotor'):
        spatial_arm(URDF, rotor=-0.1)


def test_what_is_learned_and_its_nominal_value_are_two_arguments():
    with pytest.raises(ParameterError, match='friction_viscous=True says that it is learned'):
        spatial_arm(viscous=True)
