# SPDX-License-Identifier: Apache-2.0
"""What the URDF says of dry friction decides whether it is learned, unless the owner does."""

from __future__ import annotations

import pytest

from adaptive_blf_control.tuning.node_values import node_settings_of
from adaptive_blf_control.tuning.recipe import recipe
from adaptive_blf_control.tuning.robot import Robot
from adaptive_blf_control.tuning.stated_friction import arm_with_friction, sliding_velocity


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


def test_the_sign_of_friction_is_as_sharp_as_the_measured_velocity_allows():
    sharp = [sliding_velocity(Robot(encoder_counts=counts))
             for counts in (None, 1000000, 150000, 4096)]
    assert sharp == [0.01, 0.01, 0.014, 0.02]


def test_the_files_have_the_sliding_velocity_of_the_arm_where_friction_is_learned(urdf: str):
    for coulomb, expected in ((True, 0.013), (False, 0.02)):
        arm = arm_with_friction(urdf, coulomb=coulomb, coulomb_velocity=0.013)
        nodes = node_settings_of(recipe(arm, Robot()), urdf)
        for node in ('arm_driver', 'identifier', 'controller'):
            assert nodes[node].friction.coulomb_velocity == expected
