# SPDX-License-Identifier: Apache-2.0
"""Masses for a URDF that has none, often one for display only.

It tells the kinematics, and that is all identification needs of it: inertias enter the regressor
nowhere. They are where a consistent model begins from.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from adaptive_blf_control.arms.urdf_source import select_joints, urdf_joints
from adaptive_blf_control.arms.urdf_text import UrdfText

__all__ = ['with_inertials']

_MASS = '<mass value="1.0"/>'
_INERTIA = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'


def with_inertials(xml: str, joints: Sequence[str] | None) -> tuple[str, tuple[str, ...]]:
    """Give the link that a joint moves a mass where no link behind the joint has one.

    Args:
        xml: URDF text.
        joints: Those of the arm; all that can be driven where None.

    Returns:
        The text, unchanged where every joint moves a mass, and the links that were given 1 kg and
        0.01 kg·m² about each axis.

    Raises:
        ArmError: as `urdf_joints` and `select_joints`.
    """
    chosen = select_joints(urdf_joints(xml), joints)
    text = UrdfText(xml)
    links = {text.elements[i].attributes.get('name'): i for i in text.children(0, 'link')}
    children: dict[str | None, list[str | None]] = {}
    moved: dict[str | None, str | None] = {}
    for joint in text.children(0, 'joint'):
        parent, child = (_linked(text, joint, end) for end in ('parent', 'child'))
        children.setdefault(parent, []).append(child)
        moved[text.elements[joint].attributes.get('name')] = child
    filled: list[str] = []
    for name in chosen:
        link = moved[name]
        if not any(_has_mass(text, links[behind]) for behind in _behind(link, children)):
            _fill(text, links[link])
            filled.append(str(link))
    return str(text) if filled else xml, tuple(filled)


def _linked(text: UrdfText, joint: int, end: str) -> str | None:
    found = text.children(joint, end)
    return text.elements[found[0]].attributes.get('link') if found else None


def _behind(link: str | None, children: Mapping[str | None, Sequence[str | None]]
            ) -> Iterator[str | None]:
    """Yield a link and all that hang on it; each once, also where joints form a loop."""
    waiting, seen = [link], {link}
    while waiting:
        link = waiting.pop()
        yield link
        fresh = [child for child in children.get(link, ()) if child not in seen]
        waiting += fresh
        seen.update(fresh)


def _has_mass(text: UrdfText, link: int) -> bool:
    masses = [mass for inertial in text.children(link, 'inertial')
              for mass in text.children(inertial, 'mass')]
    return any(float(text.elements[mass].attributes['value']) > 0.0 for mass in masses)


def _fill(text: UrdfText, link: int) -> None:
    inertials = text.children(link, 'inertial')
    if not inertials:
        text.append(link, ['<inertial>', f'  {_MASS}', f'  {_INERTIA}', '</inertial>'])
        return
    for tag, line in (('mass', _MASS), ('inertia', _INERTIA)):
        for element in text.children(inertials[0], tag):
            text.replace(element, line)
