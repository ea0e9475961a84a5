# SPDX-License-Identifier: Apache-2.0
"""Inertias of the rotors that a data sheet states are what gains and learning begin with."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.tuning.adaptation import parameter_deviation
from adaptive_blf_control.tuning.node_values import node_settings_of
from adaptive_blf_control.tuning.recipe import Recipe, recipe
from adaptive_blf_control.tuning.robot import Robot
from adaptive_blf_control.tuning.stated_friction import arm_with_friction

STATED = [0.4, 0.3]


def _found(urdf: str, rotors: bool | list[float]) -> Recipe:
    pytest.importorskip('pinocchio')
    return recipe(arm_with_friction(urdf, rotor_inertia=rotors), Robot(delay=0.005))


def test_a_stated_rotor_is_an_inertia_that_its_joint_sees_and_gains_grow_with_it(
        urdf: str) -> None:
    learned, stated = _found(urdf, True), _found(urdf, STATED)
    more = stated.inertia.least - learned.inertia.least
    assert (more > 0.9 * np.array(STATED)).all()
    assert stated.gains.k2[1] > 3.0 * learned.gains.k2[1]
    assert stated.torque[1] > learned.torque[1]


def test_learning_begins_with_it_a_quarter_uncertain(urdf: str) -> None:
    arm = arm_with_friction(urdf, rotor_inertia=STATED)
    column = arm.parameters.index('Ia_elbow')
    assert arm.nominal[column] == pytest.approx(0.3)
    limit, speed, damping = np.array([40.0, 10.0]), np.array([2.0, 3.0]), np.ones(2)
    deviation = parameter_deviation(arm, speed, limit, 0.0, damping)
    assert deviation[column] == pytest.approx(0.25 * 0.3)
    unknown = arm_with_friction(urdf, rotor_inertia=True)
    assert parameter_deviation(unknown, speed, limit, 0.0, damping)[column] == pytest.approx(0.01)


def test_all_nodes_know_it_and_the_simulated_arm_has_it(urdf: str) -> None:
    nodes = node_settings_of(_found(urdf, STATED), urdf)
    for name in ('controller', 'identifier', 'arm_driver'):
        friction = nodes[name].friction  # type: ignore[attr-defined]
        assert friction.rotor_inertia
        assert friction.nominal_rotor_inertia.tolist() == STATED
    true = nodes['arm_driver'].true_friction  # type: ignore[attr-defined]
    assert true.rotor_inertia.tolist() == STATED


def test_one_number_is_that_of_every_joint(urdf: str) -> None:
    assert arm_with_friction(urdf, rotor_inertia=[0.2]).rotor.tolist() == [0.2, 0.2]


def test_where_it_is_only_learned_it_is_said_that_gains_do_not_know_it(urdf: str) -> None:
    said = [' '.join(_found(urdf, rotors).assumed) for rotors in (False, True, STATED)]
    assert ['--rotor-inertia' in each for each in said] == [False, True, False]
    assert 'kg·m² at elbow' in said[1]


@pytest.mark.parametrize(('rotors', 'message'), [
    ([-0.1], r'-0\.1.*>= 0 kg·m²'),
    ([0.1, float('nan')], 'finite'),
    ([0.1, 0.2, 0.3], r'shoulder.*elbow|2')])
def test_what_no_rotor_has_is_refused(urdf: str, rotors: list[float], message: str) -> None:
    pytest.importorskip('pinocchio')
    with pytest.raises(ParameterError, match=f'--rotor-inertia.*({message})'):
        arm_with_friction(urdf, rotor_inertia=rotors)
