# SPDX-License-Identifier: Apache-2.0
"""A load at a frame is what the URDF says of a link with that inertia fixed there."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.load_frame import load_frames, load_map
from adaptive_blf_control.arms.two_link import TwoLinkArm
from adaptive_blf_control.errors import ParameterError
from spatial_arm import spatial_arm, URDF

LOAD = """<link name="load"><inertial><mass value="2"/><origin xyz="0.1 -0.2 0.3"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0.002" iyy="0.03" iyz="0.003" izz="0.04"/></inertial>
  </link>
  <joint name="held" type="fixed"><parent link="{parent}"/><child link="load"/></joint>
</robot>"""
MASS, COM = 2.0, np.array([0.1, -0.2, 0.3])
ABOUT = np.array([[0.02, 0.001, 0.002], [0.001, 0.03, 0.003], [0.002, 0.003, 0.04]])


@pytest.mark.parametrize('frame', ['tool', 'upper', 'column'])
def test_a_load_is_a_link_with_its_inertia(frame: str) -> None:
    arm = spatial_arm()
    loaded = spatial_arm(URDF.replace('</robot>', LOAD.format(parent=frame)))
    inertia = ABOUT + MASS * (COM @ COM * np.eye(3) - np.outer(COM, COM))
    load = np.array([MASS, *(MASS * COM), *(inertia[np.tril_indices(3)])])
    np.testing.assert_allclose(arm.nominal + load_map(arm, frame) @ load, loaded.nominal,
                               rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize('frame', ['palm', 'base', ''])
def test_a_frame_that_does_not_move_is_refused_with_those_that_do(frame: str) -> None:
    arm = spatial_arm()
    assert load_frames(arm) == ('column', 'upper', 'fore', 'tool')
    with pytest.raises(ParameterError, match='one of column, upper, fore, tool') as caught:
        load_map(arm, frame)
    assert caught.value.name == 'payload.frame'


def test_an_arm_without_frames_carries_no_load() -> None:
    with pytest.raises(ParameterError, match='TwoLinkArm is not from a URDF'):
        load_map(TwoLinkArm(), 'tool')
