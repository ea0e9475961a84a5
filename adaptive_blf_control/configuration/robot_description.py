# SPDX-License-Identifier: Apache-2.0
"""The URDF text of the arm in a parameter file, for what a launch file starts to draw it."""

from __future__ import annotations

from pathlib import Path
import xml.etree.ElementTree as ElementTree

from adaptive_blf_control.arms.robot_description import robot_description
from adaptive_blf_control.arms.urdf_source import read_urdf, urdf_joints
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.configuration.parameter_file import load_yaml, node_settings
from adaptive_blf_control.errors import ArmError

__all__ = ['description_in_file', 'root_link']


def description_in_file(path: str | Path) -> str | None:
    """Return the URDF of the driver's arm without Pinocchio; None where a topic brings it.

    Raises:
        BlfError: the file, a parameter in it or the URDF cannot be used.
    """
    settings = node_settings(load_yaml(path), DriverSettings)
    if settings.arm != 'urdf':
        return robot_description(build_arm(settings))
    return None if settings.urdf.startswith('topic:') else read_urdf(settings.urdf)


def root_link(xml: str) -> str:
    """Return the name of the link that is no joint's child.

    Raises:
        ArmError: the text is no URDF, or not exactly one link is the root.
    """
    urdf_joints(xml)  # a clear error for what is no URDF
    robot = ElementTree.fromstring(xml)
    children = {child.get('link') for child in robot.findall('joint/child')}
    roots = [name for link in robot.findall('link') if (name := link.get('name', ''))
             not in children]
    if len(roots) != 1:
        raise ArmError(f'URDF has the root links {", ".join(roots) or "(none)"}: expected one')
    return roots[0]
