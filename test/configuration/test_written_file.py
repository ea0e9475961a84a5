# SPDX-License-Identifier: Apache-2.0
"""Facts about a parameter file that is written out in full."""

from __future__ import annotations

import pytest
import yaml

from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    DriverSettings,
    IdentifierNodeSettings,
    NODE_SETTINGS,
    RuntimeSettings,
)
from adaptive_blf_control.configuration.parameter_file import given_values, node_settings
from adaptive_blf_control.configuration.written_file import written_file

ARM = {'joints': ['a', 'b-1'], 'urdf': 'package://of/an arm.urdf', 'arm': 'urdf'}
NODES: dict[str, RuntimeSettings] = {
    'arm_driver': DriverSettings(**ARM, torque_limit=[1.5, 2e-07]),
    'identifier': IdentifierNodeSettings(**ARM, initial_estimate='nominal', gamma=[1e-05] * 60),
    'controller': ControllerNodeSettings.from_values({
        **ARM, 'reference.a.amplitude': [0.1, 0.2], 'reference.b-1.offset': -0.5,
        'k2': [10.0, 20.0]}),
    'recorder': NODE_SETTINGS['recorder']()}
TEXT = written_file(NODES, 'A title\nof two lines', {'controller.k2': 'Because.'})


@pytest.mark.parametrize('node', NODES)
def test_it_reads_back_as_what_was_written(node: str) -> None:
    assert node_settings(yaml.safe_load(TEXT), NODE_SETTINGS[node]) == NODES[node]


@pytest.mark.parametrize('node', NODES)
def test_every_parameter_of_every_node_is_in_it(node: str) -> None:
    assert set(given_values(yaml.safe_load(TEXT), node)) == set(NODES[node].values())


def test_what_describes_the_arm_is_written_once() -> None:
    assert TEXT.count('urdf: "package://of/an arm.urdf"') == 1
    assert TEXT.index('/**:') < TEXT.index('joints:') < TEXT.index('/**/arm_driver:')


def test_each_value_stands_below_its_meaning_unit_and_range_and_the_reason() -> None:
    lines = [line.strip() for line in TEXT.splitlines()]
    at = lines.index('k2: [10.0, 20.0]')
    assert lines[at - 2:at] == ['# Gains on e2 in (38) [N*m*s/rad]; > 0 N*m*s/rad, live.',
                                '# Because.']
    assert TEXT.startswith('# A title\n# of two lines\n/**:')
    assert TEXT.count('# Centre of the sinusoids') == 1  # not again for every joint


def test_no_line_is_longer_than_the_house_allows() -> None:
    assert max(map(len, TEXT.splitlines())) <= 99
