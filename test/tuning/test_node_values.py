# SPDX-License-Identifier: Apache-2.0
"""Facts about the parameters that follow from a recipe."""

from __future__ import annotations

from typing import Any

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.tuning.node_values import node_settings_of, reasons_of
from adaptive_blf_control.tuning.recipe import recipe
from adaptive_blf_control.tuning.robot import Robot

SENSORS = {'delay': 0.004, 'encoder_counts': 200000, 'torque_noise': 0.05}


def _identifier(arm: UrdfArm, **stated: Any) -> dict[str, Any]:
    nodes = node_settings_of(recipe(arm, Robot(**stated)), 'package://arm/arm.urdf')
    return dict(nodes['identifier'].values())


def test_no_file_lets_a_contact_teach_whatever_is_stated(arm: UrdfArm) -> None:
    for stated in ({}, SENSORS, {**SENSORS, 'payload': 1.0}, {'from_zero': True}):
        values = _identifier(arm, **stated)
        assert 1.0 < values['change.suspicion'] < values['change.threshold']


def test_xt_e2_is_to_hold_a_load_only_where_one_is_stated(arm: UrdfArm) -> None:
    assert not _identifier(arm, **SENSORS)['change.adapt']
    assert _identifier(arm, **SENSORS, payload=1.0)['change.adapt']


def test_every_reason_is_that_of_a_parameter(arm: UrdfArm) -> None:
    found = recipe(arm, Robot(**SENSORS))
    nodes = node_settings_of(found, 'package://arm/arm.urdf')
    known = {f'{node}.{name}' for node, settings in nodes.items() for name in settings.values()}
    assert set(reasons_of(found)) <= known
