# SPDX-License-Identifier: Apache-2.0
"""An arm of two joints from a URDF of its own."""

from __future__ import annotations

import pytest

from adaptive_blf_control.arms.load import load_arm
from adaptive_blf_control.arms.urdf import UrdfArm

URDF = """<robot name="arm">
<link name="base"/>
<link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="3"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
<inertia ixx="0.004" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<link name="tip"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="40"/>
<dynamics damping="0.5"/></joint>
<joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
<origin xyz="0.4 0 0"/><axis xyz="0 1 0"/><limit velocity="3" effort="10"/></joint>
<joint name="end" type="fixed"><parent link="lower"/><child link="tip"/>
<origin xyz="0.3 0 0"/></joint></robot>"""


@pytest.fixture(scope='session')
def urdf() -> str:
    return URDF


@pytest.fixture(scope='session')
def arm() -> UrdfArm:
    pytest.importorskip('pinocchio')
    return load_arm(URDF)
