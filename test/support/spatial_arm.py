# SPDX-License-Identifier: Apache-2.0
"""A small arm in space with a tool, and pairs of its equation, for tests of what is learned."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.arms.urdf import UrdfArm

JOINTS = ('turn', 'lift', 'bend')
URDF = """<?xml version="1.0"?>
<!-- an arm with a tool: this comment stays -->
<robot name="spatial">
  <link name="base"/>
  <link name="column">
    <inertial> <!-- measured on a scale -->
      <mass value="4.0"/>
      <origin xyz="0 0 0.1" rpy="0.1 0.2 0.3"/>
      <inertia ixx="0.05" ixy="0.002" ixz="0" iyy="0.06" iyz="0.001" izz="0.03"/>
    </inertial>
    <visual><geometry><box size="0.1 0.1 0.3"/></geometry></visual>
  </link>
  <link name="upper"><inertial><origin xyz="0.2 0 0.02"/><mass value="3"/>
    <inertia ixx='0.01' ixy='0' ixz='0' iyy='0.06' iyz='0' izz='0.06'/></inertial></link>
  <link name="fore"/>
  <link name="tool"><inertial><origin xyz="0 0 0.03"/><mass value="0.4"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.0008"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="column"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="90" velocity="2"/></joint>
  <joint name="lift" type="revolute"><parent link="column"/><child link="upper"/>
    <origin xyz="0 0 0.3" rpy="0 0.1 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="90" velocity="2"/>
    <dynamics damping="0.7" friction="0.2" other="kept"/></joint>
  <joint name="bend" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0.4 0 0" rpy="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="40" velocity="3"/></joint>
  <joint name="mount" type="fixed"><parent link="fore"/><child link="tool"/>
    <origin xyz="0.3 0 0" rpy="0 1.2 0"/></joint>
</robot>
"""


def spatial_arm(xml: str = URDF, **changes: Any) -> UrdfArm:
    """Return the arm with all friction and rotor inertias; ``changes`` are those of `UrdfArm`."""
    return UrdfArm(xml, JOINTS, **({'friction_coulomb': True, 'friction_offset': True,
                                    'friction_square_root': True, 'rotor_inertia': True}
                                   | changes))


def true_theta(arm: UrdfArm) -> np.ndarray:
    """Return parameters of a possible robot that is not the described one, shape (m,)."""
    inertial = arm.inertial * np.array([1.3, 0.8, 1.2])[:, None]
    friction = np.where(arm.dissipates, 0.4, -0.3)
    return np.concatenate([arm.base_from_inertial(inertial, np.array([0.2, 0.15, 0.1])),
                           friction])


def pairs(arm: UrdfArm, theta: np.ndarray, count: int = 300, noise: float = 0.0,
          seed: int = 3, still: tuple[str, ...] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Return regressors (count, n, m) and torques (count, n) of random states.

    Joints named in ``still`` stand at zero.
    """
    random = np.random.default_rng(seed)
    moves = np.array([joint not in still for joint in arm.joints])
    states = random.uniform(-1.5, 1.5, (count, 3, arm.n)) * np.array([1.0, 1.0, 3.0])[:, None]
    regressors = np.array([arm.Y(*(state * moves)) for state in states])
    return regressors, regressors @ theta + random.normal(scale=noise, size=(count, arm.n)) \
        if noise else regressors @ theta
