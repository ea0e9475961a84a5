# SPDX-License-Identifier: Apache-2.0
"""The URDF text of an arm, for programs that draw it: the topic ``robot_description``."""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.planar import PlanarArm

__all__ = ['robot_description']

BASE, RADIUS = 'base_link', 0.02  # name of the first link; thickness of the others [m]


def robot_description(arm: Arm) -> str | None:
    """Return the URDF an arm was made from; None for an arm that has none.

    The planar arms have lengths to be drawn with and no other geometry: theirs is a chain of
    cylinders in the x-y plane without inertials, for viewers only.
    """
    xml = getattr(arm, 'xml', None)
    if isinstance(xml, str):
        return xml
    if not isinstance(arm, PlanarArm):
        return None
    points = arm.link_points(np.zeros(arm.n))
    return _planar_chain(type(arm).__name__, arm.joints,
                         np.linalg.norm(np.diff(points, axis=0), axis=1))


def _planar_chain(name: str, joints: Sequence[str], lengths: np.ndarray) -> str:
    parts, parent, reach = [f'  <link name="{BASE}"/>'], BASE, 0.0
    for joint, length in zip(joints, lengths.tolist()):
        link = f'{joint}_link'
        parts += [_link(link, length), _joint(joint, parent, link, reach)]
        parent, reach = link, length
    return f'<robot name={quoteattr(name)}>\n' + '\n'.join(parts) + '\n</robot>\n'


def _link(name: str, length: float) -> str:
    """Return a cylinder along the link's x axis."""
    return (f'  <link name={quoteattr(name)}>\n    <visual>\n'
            f'      <origin xyz="{0.5 * length:g} 0 0" rpy="0 1.5707963267948966 0"/>\n'
            f'      <geometry><cylinder radius="{RADIUS:g}" length="{length:g}"/></geometry>\n'
            '    </visual>\n  </link>')


def _joint(name: str, parent: str, child: str, reach: float) -> str:
    return (f'  <joint name={quoteattr(name)} type="continuous">\n'
            f'    <parent link={quoteattr(parent)}/>\n    <child link={quoteattr(child)}/>\n'
            f'    <origin xyz="{reach:g} 0 0"/>\n    <axis xyz="0 0 1"/>\n  </joint>')
