# SPDX-License-Identifier: Apache-2.0
"""What a schedule can change, by name; of the built-in arm the forces, in MuJoCo all of it.

=============================  ===================================================================
payload                        kg, a point mass at the tip
payload.LINK                   kg on a link, with its centre of mass at the link's origin, unless:
payload.LINK.x, .y, .z         m, centre of mass in the frame of the link
payload.LINK.ixx ... .izz      kg·m², inertia about that centre, axes of the link
fv_JOINT, fc_JOINT, f0_JOINT   viscous [N·m·s/rad], Coulomb and constant friction [N·m]
fs_JOINT                       friction that grows with √|q̇| [N·m·(s/rad)^½]
force.LINK.x, .y, .z           N, at the origin of a link, axes of the base
torque.LINK.x, .y, .z          N·m, on a link, axes of the base
contact, contact.GEOM          1 or 0: the obstacle, or a geom of the model, is there or not
=============================  ===================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import math
from typing import NamedTuple

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.schedule import Change, PAYLOAD

__all__ = ['AXES', 'CENTRE', 'CONTACT', 'FORCE', 'FRICTION', 'INERTIA', 'MASS', 'TIP', 'Target',
           'TimedChange', 'payload_links', 'pushes', 'row_of_wrench', 'timed_changes',
           'timed_pushes']

TIP = ''
"""The link of a payload that is asked for without one."""
CONTACT, FORCE, TORQUE = 'contact', 'force', 'torque'
AXES = ('x', 'y', 'z')
MASS, CENTRE, INERTIA = 'mass', AXES, ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')
FRICTION = ('fv', 'fc', 'f0', 'fs')


class Target(NamedTuple):
    """What a change sets.

    Attributes:
        kind: payload, force, torque, contact, fv, fc, f0 or fs.
        name: Link, geom or joint.
        component: Which of its values; '' where there is one.
    """

    kind: str
    name: str
    component: str = ''

    @property
    def of_the_arm(self) -> bool:
        """Whether it changes the dynamics of the arm, not what acts on it from outside."""
        return self.kind == PAYLOAD or self.kind in FRICTION


class TimedChange(NamedTuple):
    """From ``t`` [s] on ``target`` has ``value``, in the unit of the module's docstring."""

    t: float
    target: Target
    value: float


def payload_links(changes: Sequence[Change]) -> list[str]:
    """Return the links that a schedule puts a payload on, the tip not counted."""
    links = [_linked(change.name, (*CENTRE, *INERTIA))[0] for change in changes
             if change.name.startswith(f'{PAYLOAD}.')]
    return list(dict.fromkeys(links))


def pushes(name: str) -> bool:
    """Return whether a change of that name is a force or a torque on a link."""
    return name.partition('.')[0] in (FORCE, TORQUE)


def row_of_wrench(target: Target) -> int:
    """Return which element of a wrench (f, m) a force or torque on a link is."""
    return (0 if target.kind == FORCE else len(AXES)) + AXES.index(target.component)


def timed_pushes(changes: Sequence[Change], links: Sequence[str]) -> tuple[TimedChange, ...]:
    """Return the forces and torques of a schedule.

    Args:
        changes: In the order of their times; others than forces and torques are left out.
        links: Names of the links.

    Raises:
        ParameterError: times out of order, a link that is not known, a value that is not finite.
    """
    return _timed(filter(lambda change: pushes(change.name), changes),
                  lambda text: _push(text, links))


def timed_changes(changes: Sequence[Change], joints: Sequence[str], links: Sequence[str],
                  geoms: Sequence[str]) -> tuple[TimedChange, ...]:
    """Return a schedule's changes with what they set.

    Args:
        changes: In the order of their times.
        joints: Joints of the arm.
        links: Bodies of the model that can carry a payload or be pushed.
        geoms: Geoms of the model that can be touched.

    Raises:
        ParameterError: times out of order, a name that is not known, a value that cannot be.
    """
    return _timed(changes, lambda text: _target(text, joints, links, geoms))


def _timed(changes: Iterable[Change], target_of: Callable[[str], Target],
           ) -> tuple[TimedChange, ...]:
    result: list[TimedChange] = []
    for change in changes:
        last = result[-1].t if result else 0.0
        if not (math.isfinite(change.t) and change.t >= last):
            raise ParameterError('arm_driver.schedule.time', change.t,
                                 f'a time not before the one before it, {last:g} s')
        target = target_of(change.name)
        result.append(TimedChange(change.t, target, _value(change, target)))
    return tuple(result)


def _push(text: str, links: Sequence[str]) -> Target:
    link, component = _linked(text, AXES)
    if link in links and component:
        return Target(text.partition('.')[0], link, component)
    raise ParameterError(
        'arm_driver.schedule.parameter', text,
        'force.LINK.x|y|z or torque.LINK.x|y|z with a link of '
        f'{", ".join(links) or "an arm from a URDF: this one has none"}')


def _target(text: str, joints: Sequence[str], links: Sequence[str],
            geoms: Sequence[str]) -> Target:
    kind, _, name = text.partition('.')
    prefix, _, joint = text.partition('_')
    if text == PAYLOAD:
        return Target(PAYLOAD, TIP, MASS)
    if text == CONTACT or (kind == CONTACT and name in geoms):
        return Target(CONTACT, name)
    if prefix in FRICTION and joint in joints:
        return Target(prefix, joint)
    if kind == PAYLOAD:
        link, component = _linked(text, (*CENTRE, *INERTIA))
        if link in links:
            return Target(PAYLOAD, link, component or MASS)
    if pushes(text):
        return _push(text, links)
    raise ParameterError(
        'arm_driver.schedule.parameter', text,
        'payload, payload.LINK[.x|y|z|ixx|...|izz], force.LINK.x|y|z, torque.LINK.x|y|z, contact, '
        f'contact.GEOM, fv_JOINT, fc_JOINT, f0_JOINT or fs_JOINT; links: {", ".join(links)}; '
        f'geoms: {", ".join(geoms) or "none"}; joints: {", ".join(joints)}')


def _linked(text: str, components: Sequence[str]) -> tuple[str, str]:
    """Split ``kind.link[.component]`` into link and component."""
    name = text.partition('.')[2]
    link, _, component = name.rpartition('.')
    return (link, component) if component in components and link else (name, '')


def _value(change: Change, target: Target) -> float:
    value, kind = change.value, target.kind
    positive = target.component == MASS or kind in ('fv', 'fc', 'fs')
    accepted = math.isfinite(value) and not (positive and value < 0.0) and not (
        kind == CONTACT and value not in (0.0, 1.0))
    if not accepted:
        raise ParameterError(
            'arm_driver.schedule.value', value, f'for {change.name} '
            + ('0.0 or 1.0' if kind == CONTACT else 'a finite value'
               + (' >= 0' if positive else '')))
    return value
