# SPDX-License-Identifier: Apache-2.0
"""Arms in MuJoCo: the Panda from its URDF, and two links from an MJCF of our own."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.simulation.settings import PlantSettings

PANDA = 'package://panda_description/urdf/panda.urdf'
JOINTS = [f'panda_joint{i}' for i in range(1, 8)]
POSTURE = [0.0, -0.3, 0.0, -1.9, 0.0, 1.9, 0.5]

# A rod of 1 kg on each of two joints, a locked finger, and a table; MuJoCo computes the inertias.
MJCF = """<mujoco><worldbody><geom name="table" type="box" size="1 1 .1" pos="0 0 -.6"/>
<body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.3"/>
<geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" mass="1"/>
<body name="lower" pos=".5 0 0"><joint name="elbow" axis="0 1 0" damping="0.2" armature="0.01"/>
<geom type="capsule" size=".02" fromto="0 0 0 .4 0 0" mass="1"/>
<body name="hand" pos=".4 0 0"><joint name="finger" type="slide" axis="0 1 0"/>
<geom size=".03" mass=".2"/></body></body></body></worldbody>
<actuator><motor joint="finger"/></actuator>
<keyframe><key name="home" qpos="0 0 0"/></keyframe></mujoco>"""
# The same kinematics with the masses of nobody.
URDF = """<robot name="two"><link name="base"/><link name="a"><inertial><mass value="2"/>
<origin xyz=".2 0 0"/><inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial>
</link><link name="b"><inertial><mass value="1"/><origin xyz=".1 0 0"/>
<inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="a"/>
<origin xyz="0 0 1"/><axis xyz="0 1 0"/></joint>
<joint name="elbow" type="continuous"><parent link="a"/><child link="b"/>
<origin xyz="{length} 0 0"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.fixture(scope='session', autouse=True)
def _installed() -> None:
    pytest.importorskip('mujoco', reason='MuJoCo is not installed: the extra mujoco')


@pytest.fixture(scope='session')
def panda() -> UrdfArm:
    """Return the Panda with every friction there is."""
    return UrdfArm(PANDA, JOINTS, friction_coulomb=True, friction_offset=True)


@pytest.fixture(scope='session')
def two_links() -> UrdfArm:
    """Return an arm with the kinematics of the MJCF."""
    return UrdfArm(URDF.format(length=0.5), ['shoulder', 'elbow'])


@pytest.fixture
def panda_settings() -> PlantSettings:
    """Return the Panda at rest in a usual posture."""
    return PlantSettings(initial_position=POSTURE,
                         torque_limit=[87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])


@pytest.fixture
def mjcf() -> str:
    """Return the MJCF of the two links."""
    return MJCF


@pytest.fixture
def two_link_settings() -> PlantSettings:
    """Return the two links of the MJCF, stretched out and at rest."""
    return PlantSettings(mujoco={'model': MJCF}, torque_limit=[100.0])


@pytest.fixture(scope='session')
def states():
    """Return ``states(n)``: 20 random motions (q, q̇, q̈) of n joints."""
    def draw(n: int) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        random = np.random.default_rng(1)
        return [tuple(random.uniform(-2.5, 2.5, (3, n))) for _ in range(20)]
    return draw
