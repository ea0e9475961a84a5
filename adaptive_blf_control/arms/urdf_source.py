# SPDX-License-Identifier: Apache-2.0
"""Where a URDF comes from (path, ``package://``, XML text) and which joints it offers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math
import os
from pathlib import Path
import re
import sys
from typing import NamedTuple, Protocol
import xml.etree.ElementTree as ElementTree

from adaptive_blf_control.errors import ArmError, GIT_LFS_POINTER

__all__ = ['HasXml', 'UrdfJoint', 'UrdfSource', 'package_roots', 'read_urdf', 'resolve_package',
           'select_joints', 'urdf_joints']

SINGLE_DOF = ('revolute', 'continuous', 'prismatic')
MULTI_DOF = ('floating', 'planar')
_XACRO = 'this is a xacro file, not a URDF: run it through xacro first'
_EXPRESSION = re.compile(r'\$[{(]')  # what only xacro evaluates


class UrdfJoint(NamedTuple):
    """One ``<joint>`` of a URDF.

    Attributes:
        name: Joint name.
        kind: URDF type: revolute, continuous, prismatic, fixed, floating or planar.
        mimics: Name of the joint it follows, or None.
    """

    name: str
    kind: str
    mimics: str | None


class HasXml(Protocol):
    """What carries the text of a URDF: an arm made of one, or an exported one."""

    @property
    def xml(self) -> str:
        """The text."""
        ...


UrdfSource = str | os.PathLike[str] | HasXml
"""A URDF as a caller gives it, see `read_urdf`."""


def read_urdf(source: UrdfSource,
              package_dirs: Sequence[str | os.PathLike[str]] = ()) -> str:
    """Return the XML text of a URDF.

    Args:
        source: A path, ``file://path``, ``package://package/path`` (see `resolve_package`), or
            the XML text itself (anything that starts with ``<``, as on ``robot_description``),
            or what carries it as ``xml``.
        package_dirs: Further folders to look for packages in.

    Raises:
        ArmError: If there is no such file or package, or nothing in it.
    """
    source = getattr(source, 'xml', source)
    if not isinstance(source, (str, os.PathLike)):
        raise ArmError(f'URDF source is {source!r}: expected a path, package://... or XML text')
    if not isinstance(package_dirs, (list, tuple)) or not all(
            isinstance(folder, (str, os.PathLike)) for folder in package_dirs):
        raise ArmError(f'package_dirs is {package_dirs!r}: expected a list of folders')
    text = os.fspath(source)
    if not text.strip():
        raise ArmError('URDF source is empty: expected a path, package://... or XML text')
    if text.lstrip('\ufeff \t\r\n').startswith('<'):
        return text.lstrip('\ufeff \t\r\n')
    if text.startswith('package://'):
        path = resolve_package(text, package_dirs)
    else:
        path = Path(text.removeprefix('file://')).expanduser()
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise ArmError(f'URDF file {str(path)!r} does not exist') from None
    except (OSError, ValueError) as error:
        raise ArmError(f'URDF file {str(path)!r} cannot be read: {error}') from error
    if content.startswith(GIT_LFS_POINTER):
        raise ArmError(f'URDF file {str(path)!r} is a Git LFS pointer, not the file: fetch it '
                       'with "git lfs pull"')
    # Only comments and author names are ever outside ASCII: a stray byte there is harmless.
    xml = content.decode('utf-8-sig', errors='replace').lstrip()
    if xml and not xml.startswith('<'):
        swapped = path.suffix in ('.csv', '.tsv', '.txt')
        raise ArmError(f'URDF file {str(path)!r} is not well-formed XML: it begins with '
                       f'{xml[:20]!r}' + ('; a log comes first: identify(log, urdf)' * swapped))
    return xml


def resolve_package(uri: str, package_dirs: Sequence[str | os.PathLike[str]] = ()) -> Path:
    """Return the file that ``package://package/path`` names.

    Looked for in this order: ``package_dirs`` (a folder of packages, or the package itself),
    ``share`` of every prefix in ``AMENT_PREFIX_PATH``, ``share`` of this Python's prefix, the
    ``cmeel.prefix/share`` of PyPI's robotics wheels; in each also among the robots of
    example-robot-data.

    Raises:
        ArmError: If the address is malformed or no such file is found.
    """
    package, _, inside = uri.removeprefix('package://').partition('/')
    if not package or not inside:
        raise ArmError(f'{uri!r} is not an address of the form package://package/path')
    looked = []
    for root in package_roots(package_dirs):
        candidates = [root / package / inside]
        if root.name == package:
            candidates.append(root / inside)
        for candidate in candidates:
            if candidate.is_file():
                return candidate
        looked.append(str(root))
    raise ArmError(f'{uri!r} not found in: {", ".join(looked) or "no folder at all"}')


def package_roots(package_dirs: Sequence[str | os.PathLike[str]]) -> Iterator[Path]:
    """Yield the folders in which packages are looked for, see `resolve_package`."""
    shares = [Path(folder) for folder in package_dirs]
    shares += [Path(prefix) / 'share'
               for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if prefix]
    shares.append(Path(sys.prefix) / 'share')
    shares += [Path(entry) / 'cmeel.prefix' / 'share' for entry in sys.path if entry]
    for share in dict.fromkeys(shares):
        if share.is_dir():
            yield share
            robots = share / 'example-robot-data' / 'robots'
            if robots.is_dir():
                yield robots


def urdf_joints(xml: str) -> tuple[UrdfJoint, ...]:
    """List the joints of a URDF in document order.

    Raises:
        ArmError: If the text is not XML, not a URDF, or its joints do not hang together; or a
            joint or a mass is stated as none can be.
    """
    root = _root(xml)
    for body in root.findall('link'):
        _check_mass(body)
    links = {link.get('name') for link in root.findall('link')}
    joints: list[UrdfJoint] = []
    for element in root.findall('joint'):
        joint = _joint(element)
        if joint.name in {other.name for other in joints}:
            raise ArmError(f'URDF has two joints named {joint.name!r}')
        for end in ('parent', 'child'):
            reference = element.find(end)
            link = None if reference is None else reference.get('link')
            if link not in links:
                raise ArmError(f'joint {joint.name!r} has the {end} link {link!r}, '
                               'which the URDF does not define')
        joints.append(joint)
    return tuple(joints)


def _root(xml: str) -> ElementTree.Element:
    """Return the root of a URDF; ArmError where it is none, or xacro of any dialect."""
    try:
        root = ElementTree.fromstring(xml)
    except (ElementTree.ParseError, ValueError) as error:
        if re.search(r'<xacro:\w', xml):  # without a namespace: the old dialect, or a fragment
            raise ArmError(_XACRO) from error
        raise ArmError(f'URDF is not well-formed XML: {error}') from error
    for element in root.iter():
        if not isinstance(element.tag, str):
            continue  # a comment or an instruction
        texts = (element.text or '', *element.attrib.values())
        if 'xacro' in element.tag.partition('}')[0].lower() or any(
                map(_EXPRESSION.search, texts)):
            raise ArmError(_XACRO)
    if root.tag != 'robot':
        raise ArmError(f'URDF has the root element <{root.tag}>: expected <robot>')
    return root


def _joint(element: ElementTree.Element) -> UrdfJoint:
    name, kind = element.get('name'), element.get('type')
    if not name:
        raise ArmError('URDF has a joint without a name')
    if kind not in (*SINGLE_DOF, *MULTI_DOF, 'fixed'):
        raise ArmError(f'joint {name!r} has the type {kind!r}, which URDF does not know')
    axis = element.find('axis')
    if axis is not None and kind in (*SINGLE_DOF, 'planar'):
        _check_axis(name, axis.get('xyz', '1 0 0'))
    if kind in ('revolute', 'prismatic') and element.find('limit') is None:
        raise ArmError(f'joint {name!r} is {kind} and has no <limit>: expected one with lower, '
                       'upper, effort and velocity')
    for limit in element.findall('limit'):
        _check_limit(name, kind, limit)
    mimic = element.find('mimic')
    return UrdfJoint(name, kind, None if mimic is None else mimic.get('joint', ''))


def _check_mass(link: ElementTree.Element) -> None:
    for mass in link.findall('inertial/mass'):
        text = mass.get('value', '')
        try:
            good = 0.0 <= float(text) < math.inf
        except ValueError:
            good = False
        if not good:
            raise ArmError(f'link {link.get("name")!r} has the mass {text!r}: expected a number '
                           'that is not negative')


    for inertia in link.findall('inertial/inertia'):
        for element, text in inertia.attrib.items():
            if not math.isfinite(_number(text)):
                raise ArmError(f'link {link.get("name")!r} has the inertia {element} = {text!r}: '
                               'expected a finite number')


def _check_limit(joint: str, kind: str, limit: ElementTree.Element) -> None:
    for name in ('lower', 'upper', 'effort', 'velocity'):
        text = limit.get(name, '0')
        if math.isnan(_number(text)):
            raise ArmError(f'joint {joint!r} has the limit {name} = {text!r}: expected a number')
    lower, upper = limit.get('lower', '0'), limit.get('upper', '0')
    if kind in ('revolute', 'prismatic') and _number(lower) > _number(upper):
        raise ArmError(f'joint {joint!r} has the limits {lower} to {upper}: expected '
                       'lower <= upper')


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _check_axis(joint: str, text: str) -> None:
    try:
        x, y, z = map(float, text.split())
        length = math.hypot(x, y, z)
    except ValueError:
        length = math.nan
    if not (math.isfinite(length) and length > 0.0):
        raise ArmError(f'joint {joint!r} has the axis {text!r}: expected three numbers that are '
                       'not all zero')


def select_joints(available: Sequence[UrdfJoint], wanted: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the joints that make the arm.

    Args:
        available: What `urdf_joints` found.
        wanted: Names in the order the arm shall use, or None for every joint with one degree of
            freedom that does not mimic another.

    Raises:
        ArmError: If a name is unknown, given twice, or not a joint that one torque can drive.
    """
    driven = [joint.name for joint in available
              if joint.kind in SINGLE_DOF and joint.mimics is None]
    listing = f'drivable joints of this URDF: {", ".join(driven) or "none"}'
    if wanted is None:
        for joint in available:
            if joint.kind in MULTI_DOF:
                raise ArmError(f'joint {joint.name!r} is {joint.kind}: name the joints of the '
                               f'arm, the others are locked; {listing}')
        wanted = driven
    if (not isinstance(wanted, (list, tuple)) or not wanted
            or not all(isinstance(name, str) for name in wanted)):
        raise ArmError(f'joints is {wanted!r}: expected a list of names; {listing}')
    kinds = {joint.name: joint for joint in available}
    for index, name in enumerate(wanted):
        if name not in kinds:
            raise ArmError(f'no joint {name!r}; {listing}')
        if name in wanted[:index]:
            raise ArmError(f'joint {name!r} is named twice')
        if kinds[name].kind not in SINGLE_DOF:
            raise ArmError(f'joint {name!r} is {kinds[name].kind}, not revolute, continuous or '
                           f'prismatic; {listing}')
        if kinds[name].mimics is not None:
            raise ArmError(f'joint {name!r} mimics {kinds[name].mimics!r} and has no torque of '
                           f'its own; {listing}')
    return tuple(wanted)
