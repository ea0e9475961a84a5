# SPDX-License-Identifier: Apache-2.0
"""A planar arm of two links as a URDF."""

from __future__ import annotations

from xml.sax.saxutils import escape

__all__ = ['planar_urdf']


def planar_urdf(shoulder: str = 'shoulder', elbow: str = 'elbow') -> str:
    """Return its text with joints of these names."""
    return f"""<robot name="planar">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0.03 0"/><mass value="2.5"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.15 0 0"/><mass value="1.2"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="{escape(shoulder)}" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
  <joint name="{escape(elbow)}" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
</robot>
"""
