# SPDX-License-Identifier: Apache-2.0
"""Facts about changes of the true arm: what happens when, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.three_link import three_link_parameters, ThreeLinkArm
from adaptive_blf_control.configuration.build_closed_loop import build_closed_loop
from adaptive_blf_control.configuration.parameter_file import apply_settings, load_yaml
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.schedule import Change, Schedule

ARM = ThreeLinkArm()


def schedule(*changes: Change, payload: float = 0.0) -> Schedule:
    return Schedule(three_link_parameters(payload), ARM.parameters, changes,
                    ARM.payload_direction, payload)


def test_a_payload_replaces_the_one_before():
    epochs = schedule(Change(1.0, 'payload', 2.0), Change(3.0, 'payload', 0.5), payload=1.0).epochs
    assert [t for t, _ in epochs] == [0.0, 1.0, 3.0]
    for (_, theta), payload in zip(epochs, (1.0, 2.0, 0.5)):
        np.testing.assert_allclose(theta, three_link_parameters(payload), rtol=1e-12)


def test_changes_at_one_time_are_one_epoch():
    epochs = schedule(Change(2.0, 'p1', 3.0), Change(2.0, 'f', 1.0)).epochs
    assert len(epochs) == 2
    assert (epochs[1][1][0], epochs[1][1][10]) == (3.0, 1.0)


def test_a_payload_leaves_other_changes_in_place():
    epochs = schedule(Change(1.0, 'f', 9.0), Change(2.0, 'payload', 1.0)).epochs
    assert epochs[2][1][10] == 9.0


@pytest.mark.parametrize(('changes', 'name', 'expected'), [
    ([Change(2.0, 'p1', 3.0), Change(1.0, 'p2', 1.0)], 'time', 'not before the one before it'),
    ([Change(float('nan'), 'p1', 3.0)], 'time', 'a time'),
    ([Change(1.0, 'p12', 3.0)], 'parameter', 'one of p1, p2.*payload'),
    ([Change(1.0, 'payload', -0.1)], 'value', 'a payload >= 0 kg'),
    ([Change(1.0, 'p1', float('inf'))], 'parameter', 'finite')])
def test_schedules_that_cannot_be_are_refused_by_name(changes, name, expected):
    with pytest.raises(ParameterError, match=rf'arm_driver\.schedule\.{name}.*{expected}'):
        schedule(*changes)


@pytest.mark.parametrize(('setting', 'expected'), [
    (('schedule.time=[60.0, 5.0]', 'schedule.parameter=[f, f]', 'schedule.value=[1.0, 2.0]'),
     'schedule.time'),
    (('schedule.time=[1.0, 2.0]',), 'same length'),
    (('schedule.parameter=[mass]',), 'one of p1'),
    (('payload=-1.0',), 'arm_driver.payload'),
    (('sensors.encoder_counts=0',), 'sensors.encoder_counts')])
def test_a_scenario_with_such_a_driver_is_refused(repository, setting, expected):
    data = load_yaml(repository / 'config' / 'three_link_encoder.yaml')
    with pytest.raises(ParameterError, match=expected):
        build_closed_loop(apply_settings(data, [f'arm_driver.{part}' for part in setting]))


def test_an_arm_without_a_tip_has_no_payload():
    with pytest.raises(ParameterError, match=r"schedule\.parameter.*'payload'"):
        Schedule(np.ones(2), ('a', 'b'), [Change(1.0, 'payload', 1.0)])
