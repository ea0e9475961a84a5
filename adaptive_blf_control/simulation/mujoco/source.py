# SPDX-License-Identifier: Apache-2.0
"""An editable MuJoCo model of an arm from a URDF or an MJCF, all other joints locked.

What would move the arm besides the joint torques (actuators, tendons, equality constraints) is
left out, and of a URDF the geometry, whose files need not be there.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
import xml.etree.ElementTree as ElementTree

from adaptive_blf_control.arms.urdf_source import (
    read_urdf,
    resolve_package,
    select_joints,
    urdf_joints,
)
from adaptive_blf_control.errors import ArmError, ParameterError
from adaptive_blf_control.simulation.mujoco.inertia import set_inertias
from adaptive_blf_control.simulation.mujoco.library import load_mujoco

__all__ = ['arm_spec']

MODEL = 'arm_driver.mujoco.model'
_OTHER_DRIVES = ('keys', 'sensors', 'actuators', 'tendons', 'equalities')


def arm_spec(source: str, joints: Sequence[str]) -> Any:
    """Return a ``mujoco.MjSpec`` in which only the given joints move.

    Args:
        source: Path, ``package://package/path`` or XML text of a URDF or an MJCF.
        joints: Names of the joints that stay.

    Raises:
        ParameterError: the source cannot be read, or lacks a joint.
        ArmError: MuJoCo cannot read it.
        MissingExtra: MuJoCo is not installed.
    """
    mujoco = load_mujoco()
    text = _text(source)
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ParameterError(MODEL, source, f'well-formed XML: {error}') from None
    if root.tag not in ('robot', 'mujoco'):
        raise ParameterError(MODEL, source, f'a URDF (<robot>) or an MJCF (<mujoco>), not '
                             f'<{root.tag}>')
    try:
        if root.tag == 'robot':
            select_joints(urdf_joints(text), list(joints))
            spec = mujoco.MjSpec.from_string(_without_geometry(root, joints))
            set_inertias(spec, root)
            return spec
        path = _path(source)
        spec = mujoco.MjSpec.from_string(text) if path is None else (
            mujoco.MjSpec.from_file(str(path)))  # which finds what the file includes
    except ValueError as error:
        if isinstance(error, ArmError):
            raise
        raise ArmError(f'MuJoCo cannot read the model: {error}') from error
    _keep_joints(mujoco, spec, joints, source)
    set_inertias(spec, None)
    return spec


def _text(source: str) -> str:
    try:
        return read_urdf(source)
    except ArmError as error:
        raise ParameterError(MODEL, source, f'a readable URDF or MJCF: {error}') from None


def _path(source: str) -> Path | None:
    """Return the file that a source names; None for XML text."""
    if source.lstrip().startswith('<'):
        return None
    if source.startswith('package://'):
        return resolve_package(source)
    return Path(source.removeprefix('file://')).expanduser()


def _without_geometry(root: ElementTree.Element, joints: Sequence[str]) -> str:
    """Return a URDF as MuJoCo is to read it: inertias and joints alone, every link a body."""
    for link in root.findall('link'):
        for shape in (*link.findall('visual'), *link.findall('collision')):
            link.remove(shape)
    for joint in root.findall('joint'):
        if joint.get('name') not in joints:
            joint.set('type', 'fixed')
            for mimic in joint.findall('mimic'):
                joint.remove(mimic)
    for tag in ('transmission', 'gazebo', 'mujoco'):
        for element in root.findall(tag):
            root.remove(element)
    ElementTree.SubElement(
        ElementTree.SubElement(root, 'mujoco'), 'compiler',
        # Links that are fixed to one another stay bodies: the schedule names them.
        {'fusestatic': 'false', 'discardvisual': 'false', 'inertiafromgeom': 'false'})
    return ElementTree.tostring(root, encoding='unicode')


def _keep_joints(mujoco: Any, spec: Any, joints: Sequence[str], source: str) -> None:
    """Delete all joints of an MJCF but those of the arm, and what refers to deleted ones."""
    kinds = {joint.name: joint.type for joint in spec.joints}
    single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    offered = [name for name, kind in kinds.items() if kind in single]
    for name in joints:
        if name not in offered:
            raise ParameterError(MODEL, source, f'a model with the hinge or slide joint {name!r}: '
                                 f'it has {", ".join(offered) or "none"}; mujoco.joints says '
                                 'which are those of the arm')
    for kind in _OTHER_DRIVES:
        for element in list(getattr(spec, kind)):
            spec.delete(element)
    for joint in list(spec.joints):
        if joint.name not in joints:
            spec.delete(joint)
    spec.compiler.fusestatic = False
    spec.compiler.discardvisual = False
