# SPDX-License-Identifier: Apache-2.0
"""Every series that the viewer layouts name is one that the 2-DoF demo sends."""

from __future__ import annotations

from collections.abc import Iterator
import json
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree

import pytest

from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.configuration.parameter_file import load_yaml, node_values
from adaptive_blf_control.control.constraints import MarginName
from adaptive_blf_control.messages.controller_codecs import margin_names
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    BARRIER,
    COMMANDS,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    JOINT_STATES,
    RECORDED,
    REFERENCE,
    THETA_HAT,
    TRACKING_ERROR,
)

STATE = ('position', 'velocity', 'effort')
PLOT_PATH = re.compile(r'(/[\w/]+)\.(\w+)(?:\[(\d+)\])?')


@pytest.fixture(scope='module')
def named(repository: Path) -> dict[str, tuple[list[str], tuple[str, ...]]]:
    """Return names and fields of each JointState topic of the demo."""
    arm = TwoLinkArm()
    data = load_yaml(repository / 'config' / 'two_link.yaml')
    joints = node_values(data, 'controller')['joints']
    parameters = list(arm.parameters)
    return {
        JOINT_STATES: (joints, STATE), REFERENCE: (joints, STATE),
        TRACKING_ERROR: (joints, STATE[:2]), THETA_HAT: (parameters, STATE[:1]),
        ADAPTATION_TERM: (parameters, STATE[:1]), BARRIER: (margin_names(
            [MarginName(joint, what) for what in ('safety', 'performance') for joint in joints]),
            STATE[:1])}


def test_the_types_behind_the_series_are_those_of_the_topic_table(named) -> None:
    assert {RECORDED[topic] for topic in named} == {'sensor_msgs/msg/JointState'}
    assert RECORDED[COMMANDS] == 'std_msgs/msg/Float64MultiArray'
    assert RECORDED[HISTORY_RANK] == 'std_msgs/msg/Int32'
    assert RECORDED[HISTORY_SIGMA_MIN] == 'std_msgs/msg/Float64'


@pytest.fixture(scope='module')
def plotjuggler(repository: Path) -> ElementTree.Element:
    return ElementTree.parse(repository / 'config' / 'plotjuggler.xml').getroot()


@pytest.fixture(scope='module')
def foxglove(repository: Path) -> dict[str, Any]:
    return json.loads((repository / 'config' / 'foxglove.json').read_text(encoding='utf-8'))


def test_plotjuggler_curves_are_series_of_our_topics(plotjuggler, named) -> None:
    series = {f'/{topic}/{name}/{field}' for topic, (names, fields) in named.items()
              for name in names for field in fields}
    series |= {f'/{COMMANDS}/data[{i}]' for i in range(len(named[JOINT_STATES][0]))}
    series |= {f'/{HISTORY_RANK}/data', f'/{HISTORY_SIGMA_MIN}/data'}
    curves = [curve.get('name') for curve in plotjuggler.iter('curve')]
    assert len(curves) > 20
    assert set(curves) <= series


def test_plotjuggler_layout_is_a_tree_of_tabs_splitters_and_plots(plotjuggler) -> None:
    assert plotjuggler.tag == 'root'
    assert [child.tag for child in plotjuggler][0] == 'tabbed_widget'
    for tab in plotjuggler.iter('Tab'):
        assert [child.tag for child in tab] == ['Container'] * int(tab.get('containers'))
    for splitter in plotjuggler.iter('DockSplitter'):
        assert splitter.get('orientation') in '-|'
        assert len(splitter) == int(splitter.get('count')) == len(splitter.get('sizes').split(';'))
    for area in plotjuggler.iter('DockArea'):
        assert [child.tag for child in area] == ['plot']
    for curve in plotjuggler.iter('curve'):
        assert re.fullmatch(r'#[0-9a-f]{6}', curve.get('color'))


def test_plotjuggler_layout_names_no_file_and_no_streamer(plotjuggler) -> None:
    tags = {element.tag for element in plotjuggler.iter()}
    assert not tags & {'previouslyLoaded_Datafiles', 'previouslyLoaded_Streamer'}


def _panels(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
        return
    assert layout['direction'] in ('row', 'column')
    assert 0 < layout['splitPercentage'] < 100
    yield from _panels(layout['first'])
    yield from _panels(layout['second'])


def test_foxglove_panels_have_ids_of_type_and_name_and_each_stands_once(foxglove) -> None:
    assert set(foxglove) == {'configById', 'globalVariables', 'userNodes', 'playbackConfig',
                             'layout'}
    panels = list(_panels(foxglove['layout']))
    assert sorted(panels) == sorted(foxglove['configById'])
    assert all(re.fullmatch(r'(Plot|DiagnosticSummary)!\w+', panel) for panel in panels)


def test_foxglove_paths_are_fields_of_our_topics(foxglove, named) -> None:
    plain = {HISTORY_RANK, HISTORY_SIGMA_MIN}
    count = 0
    for panel, config in foxglove['configById'].items():
        if panel.startswith('DiagnosticSummary!'):
            assert config['topicToRender'] == '/diagnostics'
            continue
        for path in config['paths']:
            match = PLOT_PATH.fullmatch(path['value'])
            assert match is not None, path['value']
            topic, field, index = match[1][1:], match[2], match[3]
            assert topic in RECORDED
            if topic in plain:
                assert (field, index) == ('data', None)
            elif topic == COMMANDS:
                assert field == 'data'
                assert int(index) < len(named[JOINT_STATES][0])
            else:
                names, fields = named[topic]
                assert field in fields
                assert int(index) < len(names)
            count += 1
    assert count > 20
