# SPDX-License-Identifier: Apache-2.0
"""What a launch file asks of a parameter file: the text to draw the arm from, and its root."""

from __future__ import annotations

from pathlib import Path

import pytest

from adaptive_blf_control.configuration.robot_description import description_in_file, root_link
from adaptive_blf_control.errors import ArmError

CHAIN = ('<robot name="r"><link name="tip"/><link name="foot"/><joint name="j" type="continuous">'
         '<parent link="foot"/><child link="tip"/></joint></robot>')


def _file(folder: Path, urdf: str) -> Path:
    path = folder / 'arm.yaml'
    path.write_text('/**:\n  ros__parameters:\n    arm: urdf\n    joints: [j]\n'
                    f'    urdf: {urdf}\n')
    return path


def test_the_text_is_that_of_the_urdf_file(tmp_path: Path) -> None:
    (tmp_path / 'arm.urdf').write_text(CHAIN)
    assert description_in_file(_file(tmp_path, str(tmp_path / 'arm.urdf'))) == CHAIN


def test_there_is_none_where_a_topic_brings_it(tmp_path: Path) -> None:
    assert description_in_file(_file(tmp_path, 'topic:robot_description')) is None


def test_a_planar_arm_gets_a_chain_that_begins_at_base_link(repository: Path) -> None:
    text = description_in_file(repository / 'config' / 'three_link.yaml')
    assert text is not None
    assert root_link(text) == 'base_link'


def test_the_root_is_the_link_that_is_no_child() -> None:
    assert root_link(CHAIN) == 'foot'


def test_a_urdf_with_two_roots_is_refused_by_their_names() -> None:
    with pytest.raises(ArmError, match='root links foot, loose: expected one'):
        root_link(CHAIN.replace('<link name="foot"/>', '<link name="foot"/><link name="loose"/>'))
