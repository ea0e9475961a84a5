# SPDX-License-Identifier: Apache-2.0
"""A small arm with limits and bodies that can hit each other."""

from __future__ import annotations

import pytest

URDF = """<robot name="folding">
  <link name="base"><collision><origin xyz="0 0.2 -0.5"/><geometry><box size="0.2 0.2 0.4"/>
    </geometry></collision></link>
  <link name="upper"><inertial><origin xyz="0.2 0.03 0"/><mass value="2.5"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/></inertial>
    <collision><origin xyz="0.2 0 0"/><geometry><box size="0.3 0.05 0.05"/></geometry>
    </collision></link>
  <link name="fore"><inertial><origin xyz="0.15 0 0"/><mass value="1.2"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <collision><origin xyz="0.2 0.2 0"/><geometry><box size="0.4 0.1 0.05"/></geometry>
    </collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-2.5" upper="2.5" effort="50" velocity="5"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" effort="20" velocity="5"/></joint>
</robot>
"""


@pytest.fixture(scope='session')
def folding() -> str:
    return URDF
