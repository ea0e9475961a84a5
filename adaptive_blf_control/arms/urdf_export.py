# SPDX-License-Identifier: Apache-2.0
"""A URDF with identified inertials and friction, everything else in it untouched.

A torque shows the sum of a moving link and of all that is fixed to it or locked: tool flanges,
covers, the fingers of a gripper. These keep their own inertials; the moving link gets the rest.
Where the rest would not be a body, theirs are scaled down together until it is one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import functools
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.base_parameters import INERTIAL_NAMES
from adaptive_blf_control.arms.joint_friction import FRICTION_KINDS
from adaptive_blf_control.arms.pseudo_inertia import inertial_parameters, pseudo_inertias
from adaptive_blf_control.arms.urdf import UrdfArm
from adaptive_blf_control.arms.urdf_text import UrdfText
from adaptive_blf_control.errors import ArmError, with_hints

__all__ = ['ExportedUrdf', 'export_urdf']

_TENSOR = tuple(name for name in INERTIAL_NAMES if name.startswith('I'))


@functools.partial(with_hints, instead=dict.fromkeys(
    ('text', 'string', 'save', 'write', 'write_text', 'to_file', 'dump'),
    'xml is the text; identify(...).urdf(path) writes it'))
class ExportedUrdf(NamedTuple):
    """A URDF with identified values; ``load_arm(exported, coulomb=True)`` is the arm of it.

    Attributes:
        xml: Its text.
        scaled: Links whose own mass and inertia had to be scaled down, with the factor.
        missing: What of the model a URDF has no place for, by parameter name.
    """

    xml: str
    scaled: dict[str, float]
    missing: dict[str, float]

    def __str__(self) -> str:
        """Return the text."""
        return self.xml

    def __repr__(self) -> str:
        """Show what is not as the model has it."""
        return (f'<ExportedUrdf of {len(self.xml)} characters: scaled {self.scaled}, '
                f'missing {self.missing}>')


def export_urdf(arm: UrdfArm, theta: np.ndarray, inertial: np.ndarray,
                rotor: np.ndarray | None = None) -> ExportedUrdf:
    """Write identified values into the text of the URDF that an arm was made of.

    Read again, it predicts Y θ less what a URDF cannot say: rotor inertias, constant torques and
    square-root friction. Viscous and Coulomb friction become ``<dynamics damping friction>``
    where θ has them.

    Args:
        arm: The arm.
        theta: Parameters, shape (m,).
        inertial: Ten inertial parameters per joint with the dynamics of ``theta``, each set
            physically consistent, shape (n, 10); see `ConsistentModel`.
        rotor: Inertia of each joint's rotor in that model, shape (n,) [kg·m²], also of those that
            no column of θ tells from their link; None: those of θ.

    Raises:
        ArmError: ``inertial`` is not physically consistent.
    """
    bodies = pseudo_inertias(np.asarray(inertial, dtype=float))
    least = np.linalg.eigvalsh(bodies)[:, 0]
    if not np.all(least > 0.0):
        joint = arm.joints[int(np.argmin(least))]
        raise ArmError(f'the inertial parameters of the body behind {joint!r} are not physically '
                       f'consistent: the smallest eigenvalue of its pseudo-inertia is '
                       f'{least.min():.3g}')
    tree = _Tree(UrdfText(arm.xml))
    scaled: dict[str, float] = {}
    for joint, body, described in zip(arm.joints, bodies, pseudo_inertias(arm.inertial)):
        link = tree.child(joint)
        carried = described - tree.pseudo_inertia(link)
        factor = _factor(body, carried)
        tree.set_inertial(link, body - factor * carried)
        if factor < 1.0:
            for other in tree.carried(link, arm.joints):
                tree.scale(other, factor)
                scaled[other] = factor
    friction = dict(zip(FRICTION_KINDS, arm.friction(theta), strict=True))
    for place, joint in enumerate(arm.joints):
        values = {attribute: friction[kind][place] for kind, attribute in (
            ('viscous', 'damping'), ('coulomb', 'friction'))
            if f'{FRICTION_KINDS[kind]}_{joint}' in arm.parameters}
        tree.set_dynamics(joint, values)
    missing = {name: float(value) for name, value in zip(arm.parameters, theta, strict=True)
               if name.startswith(('Ia_', 'f0_', 'fs_'))}
    if rotor is not None:
        missing.update((f'Ia_{joint}', float(value))
                       for joint, value in zip(arm.joints, rotor, strict=True) if value)
    return ExportedUrdf(str(tree.text), scaled, missing)


def _factor(body: np.ndarray, carried: np.ndarray) -> float:
    """Return 1 where ``body`` − ``carried`` is a body, else half of what may be taken away."""
    inverse = np.linalg.inv(np.linalg.cholesky(body))
    largest = float(np.linalg.eigvalsh(inverse @ carried @ inverse.T)[-1])
    return 1.0 if largest < 1.0 - 1e-6 else 0.5 / largest


class _Tree:
    """Links and joints of a URDF's text."""

    def __init__(self, text: UrdfText) -> None:
        self.text = text
        self._links = {text.elements[index].attributes.get('name', ''): index
                       for index in text.children(0, 'link')}
        self._joints = {text.elements[index].attributes.get('name', ''): index
                        for index in text.children(0, 'joint')}
        self._ends = {name: (self._end(index, 'parent'), self._end(index, 'child'))
                      for name, index in self._joints.items()}

    def _end(self, joint: int, tag: str) -> str:
        found = self.text.children(joint, tag)
        return self.text.elements[found[0]].attributes.get('link', '') if found else ''

    def child(self, joint: str) -> str:
        """Return the link that a joint moves."""
        link = self._ends.get(joint, ('', ''))[1]
        if link not in self._links:
            raise ArmError(f'URDF has no joint {joint!r} with a child link')
        return link

    def carried(self, link: str, driven: tuple[str, ...]) -> Iterator[str]:
        """Yield the links with inertials that ``link`` carries through joints that do not move."""
        for joint, (parent, child) in self._ends.items():
            if parent == link and joint not in driven:
                if self._inertial(child) is not None:
                    yield child
                yield from self.carried(child, driven)

    def _inertial(self, link: str) -> int | None:
        found = self.text.children(self._links[link], 'inertial')
        return found[0] if found else None

    def _values(self, parent: int, tag: str) -> Mapping[str, str]:
        found = self.text.children(parent, tag)
        return self.text.elements[found[0]].attributes if found else {}

    def pseudo_inertia(self, link: str) -> np.ndarray:
        """Return what the link's own ``<inertial>`` says, shape (4, 4); zero without one."""
        result = np.zeros((4, 4))
        inertial = self._inertial(link)
        if inertial is None:
            return result
        origin = self._values(inertial, 'origin')
        centre = _numbers(origin.get('xyz', '0 0 0'))
        turn = _rotation(_numbers(origin.get('rpy', '0 0 0')))
        mass = float(self._values(inertial, 'mass').get('value', '0'))
        tensor = self._values(inertial, 'inertia')
        about_centre = [float(tensor.get(name.lower(), '0')) for name in _TENSOR]
        second = pseudo_inertias(np.array([[0.0] * 4 + about_centre]))[0, :3, :3]
        result[:3, :3] = turn @ second @ turn.T + mass * np.outer(centre, centre)
        result[:3, 3] = result[3, :3] = mass * centre
        result[3, 3] = mass
        return result

    def set_inertial(self, link: str, pseudo: np.ndarray) -> None:
        """Write a pseudo-inertia as the link's ``<inertial>``."""
        mass = pseudo[3, 3]
        centre = pseudo[:3, 3] / mass
        about_centre = pseudo.copy()
        about_centre[:3, :3] -= mass * np.outer(centre, centre)
        tensor = inertial_parameters(about_centre[None])[0, 4:]
        self._write(link, {  # along the link's axes: MuJoCo does not look at this rpy
            'origin': {'xyz': ' '.join(map(_text, centre)), 'rpy': '0 0 0'},
            'mass': {'value': _text(mass)},
            'inertia': {name.lower(): _text(value)
                        for name, value in zip(_TENSOR, tensor, strict=True)}})

    def scale(self, link: str, factor: float) -> None:
        """Scale mass and inertia of a link."""
        inertial = self._inertial(link)
        if inertial is not None:
            self._write(link, {tag: {name: _text(factor * float(value)) for name, value
                                     in self._values(inertial, tag).items()}
                               for tag in ('mass', 'inertia')})

    def _write(self, link: str, values: Mapping[str, Mapping[str, str]]) -> None:
        lines = {tag: f'<{tag} ' + ' '.join(f'{name}="{value}"' for name, value in each.items())
                 + '/>' for tag, each in values.items()}
        inertial = self._inertial(link)
        if inertial is None:
            self.text.append(self._links[link], [
                '<inertial>', *(f'  {line}' for line in lines.values()), '</inertial>'])
            return
        found = {tag: self.text.children(inertial, tag) for tag in values}
        for tag, places in found.items():
            if places:
                self.text.set_attributes(places[0], values[tag])
        absent = [lines[tag] for tag, places in found.items() if not places]
        if absent:
            self.text.append(inertial, absent)

    def set_dynamics(self, joint: str, values: Mapping[str, float]) -> None:
        """Write ``<dynamics>`` of a joint."""
        if not values:
            return
        texts = {name: _text(value) for name, value in values.items()}
        found = self.text.children(self._joints[joint], 'dynamics')
        if found:
            self.text.set_attributes(found[0], texts)
        else:
            line = ' '.join(f'{name}="{value}"' for name, value in texts.items())
            self.text.append(self._joints[joint], [f'<dynamics {line}/>'])


def _text(value: float) -> str:
    """Return the shortest text that reads back to the last bit."""
    return repr(float(value))


def _numbers(text: str) -> np.ndarray:
    return np.array([float(part) for part in text.split()])


def _rotation(rpy: np.ndarray) -> np.ndarray:
    """Return the rotation of a URDF's ``rpy``: about fixed x, then y, then z."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    result: np.ndarray = (np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
                          @ np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
                          @ np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]]))
    return result

