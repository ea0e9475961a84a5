# SPDX-License-Identifier: Apache-2.0
"""What the URDF says of dry friction decides whether it is learned, unless the owner does."""

from __future__ import annotations

import pytest

from adaptive_blf_control.tuning.recipe import recipe
from adaptive_blf_control.tuning.robot import Robot
from adaptive_blf_control.tuning.stated_friction import arm_with_friction


@pytest.fixture
def dry_urdf(urdf: str) -> str:
    """Return the URDF of the tests with 0.7 N·m of dry friction in one joint."""
    stated = '<dynamics damping="0.5"/>'
    assert urdf.count(stated) == 1
    return urdf.replace(stated, '<dynamics damping="0.5" friction="0.7"/>')


def test_dry_friction_is_learned_where_the_urdf_states_any(urdf: str, dry_urdf: str) -> None:
    assert not [name for name in arm_with_friction(urdf).parameters if name.startswith('fc_')]
    arm = arm_with_friction(dry_urdf)
    nominal = dict(zip(arm.parameters, arm.nominal.tolist()))
    assert [nominal[f'fc_{joint}'] for joint in arm.joints] == [0.7, 0.0]


@pytest.mark.parametrize('coulomb', [True, False])
def test_the_owner_decides_if_he_wants_to(urdf: str, dry_urdf: str, coulomb: bool) -> None:
    for each in (urdf, dry_urdf):
        arm = arm_with_friction(each, coulomb=coulomb)
        assert ('fc_elbow' in arm.parameters) is coulomb


def test_it_is_said_that_it_is_learned(urdf: str, dry_urdf: str) -> None:
    said = [' '.join(recipe(arm_with_friction(each), Robot()).assumed)
            for each in (urdf, dry_urdf)]
    assert 'Coulomb' not in said[0]
    assert 'shoulder 0.7 N·m (--no-coulomb' in said[1]


def test_a_stated_rotor_is_learned_from_its_value_on_and_counts_in_the_inertia(urdf: str) -> None:
    plain, stated = arm_with_friction(urdf), arm_with_friction(urdf, rotor=[0.5, 2.0])
    assert stated.rotor.tolist() == [0.5, 2.0]
    assert any(name.startswith('Ia_') for name in stated.parameters)
    assert arm_with_friction(urdf, rotor=[0.3]).rotor.tolist() == [0.3, 0.3]
    before, after = (recipe(arm, Robot(delay=0.005)) for arm in (plain, stated))
    assert (after.inertia.most > before.inertia.most + 0.4).all()
    assert (after.gains.k2 > before.gains.k2).all()


def test_what_is_assumed_says_that_no_rotor_is_stated(urdf: str) -> None:
    said = [' '.join(recipe(arm_with_friction(urdf, rotor=rotor), Robot()).assumed)
            for rotor in (None, [0.5])]
    assert '--rotor-inertia' in said[0]
    assert '--rotor-inertia' not in said[1]
