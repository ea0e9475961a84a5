# SPDX-License-Identifier: Apache-2.0
"""Whose parameters are learned from a log: the arm, and the settings of its identifier."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import copy
import os
from typing import Any, NamedTuple

from adaptive_blf_control.arms.arm import Arm, checked_arm
from adaptive_blf_control.arms.settings import ArmSettings
from adaptive_blf_control.arms.urdf_inertials import with_inertials
from adaptive_blf_control.arms.urdf_source import read_urdf
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.configuration.parameter_file import flattened, node_settings
from adaptive_blf_control.errors import ParameterError, UnknownParameter
from adaptive_blf_control.identification.settings import (
    IdentifierSettings,
    REAL_ROBOT as OF_REAL_ROBOT,
)

__all__ = ['REAL_ROBOT', 'Subject', 'joints_of', 'real_robot_settings', 'subject_of',
           'with_masses']

REAL_ROBOT: dict[str, Any] = {
    'arm': 'urdf',
    'friction': {'viscous': True, 'coulomb': True, 'offset': True, 'square_root': True,
                 'rotor_inertia': True},
    **OF_REAL_ROBOT,
}
"""The identifier's parameters where no ``--config`` is given; ``docs/benchmarks.md`` tells why."""


_NAMED = ('two_link', 'three_link')


class Subject(NamedTuple):
    """Whose parameters are learned, and with which settings.

    Attributes:
        arm: The arm.
        settings: Those of the identifier, and what the arm was made of.
        filled: Links of the URDF that had to be given a mass.
    """

    arm: Arm
    settings: IdentifierNodeSettings
    filled: tuple[str, ...]


def subject_of(urdf: Any, joints: Sequence[str] | None, arm: Arm | str | None,
               settings: IdentifierSettings | None, changes: dict[str, Any],
               arguments: Sequence[str]) -> Subject:
    """Return the arm that `identify` is asked about, and the settings with their changes.

    Args:
        urdf: As `identify` takes it; likewise the others.
        joints: See there.
        arm: See there.
        settings: See there.
        changes: See there.
        arguments: Names that a caller may have meant as well.
    """
    if arm is None and (urdf in _NAMED if isinstance(urdf, str) else hasattr(urdf, 'Y1')):
        urdf, arm = None, urdf
    urdf = getattr(urdf, 'xml', urdf)
    if urdf is not None and not isinstance(urdf, (str, os.PathLike)):
        raise ParameterError('urdf', urdf, 'a path, package://..., XML text or an arm')
    if arm is not None and not isinstance(arm, str):
        _refuse_of_arm(changes, arm)
    given = {'arm': arm if isinstance(arm, str) else None, 'urdf': urdf and os.fspath(urdf),
             'joints': joints}
    changes.update((name, value) for name, value in given.items() if value is not None)
    chosen, filled = with_masses(_changed(_node_settings(settings), changes, arguments),
                                 joints is None and urdf is not None)
    if arm is None or isinstance(arm, str):
        return Subject(_named_arm(chosen), chosen, filled)
    checked_arm('arm', arm)
    if urdf is not None:
        raise ParameterError('urdf', urdf, 'nothing beside an arm')
    if joints is not None and tuple(joints) != tuple(arm.joints):
        raise ParameterError('joints', joints, f'nothing beside an arm, which has {arm.joints}')
    return Subject(arm, chosen, filled)


def _refuse_of_arm(changes: Mapping[str, Any], arm: Any) -> None:
    """Raise ParameterError for a change to the arm, where that is given as it is."""
    for name, value in flattened(changes):
        if name in {row.name for row in ArmSettings.table()}:
            raise ParameterError(name, value, 'nothing: the arm is given as it is, by '
                                 f'{type(arm).__name__}')


def real_robot_settings() -> IdentifierNodeSettings:
    """Return the settings for a measured robot, those of `REAL_ROBOT`."""
    return node_settings({'/**/identifier': {'ros__parameters': copy.deepcopy(REAL_ROBOT)}},
                         IdentifierNodeSettings)


def _node_settings(settings: IdentifierSettings | None) -> IdentifierNodeSettings:
    """Return the settings of the node: with those of the identifier alone, `REAL_ROBOT`'s arm."""
    if settings is None or isinstance(settings, IdentifierNodeSettings):
        return settings or real_robot_settings()
    given = IdentifierSettings.taken(settings, {})
    return real_robot_settings().replace(**given.values())


def _changed(settings: IdentifierNodeSettings, changes: Mapping[str, Any],
             arguments: Sequence[str]) -> IdentifierNodeSettings:
    """Return settings with changes; a name that is unknown may also be one of an argument."""
    try:
        return settings.replace(**changes)
    except UnknownParameter as error:
        name = error.name.removeprefix('identifier.')
        raise UnknownParameter(name, error.value, [*error.known, *arguments]) from None


def _named_arm(settings: IdentifierNodeSettings) -> Arm:
    """Build the arm that the settings name."""
    if settings.arm == 'urdf' and (not settings.urdf or settings.urdf.startswith('topic:')):
        raise ParameterError('urdf', settings.urdf or None, "a file: identify(log, 'robot.urdf'), "
                             'or an arm: identify(log, arm=...)')
    return build_arm(settings)


def with_masses(settings: IdentifierNodeSettings,
                whole: bool) -> tuple[IdentifierNodeSettings, tuple[str, ...]]:
    """Return settings whose URDF has masses, and the links that had to be given one.

    With ``whole`` the joints become all those of the URDF. See `with_inertials`.
    """
    if settings.arm != 'urdf' or not settings.urdf or settings.urdf.startswith('topic:'):
        return settings, ()
    xml, filled = with_inertials(read_urdf(settings.urdf), None if whole else settings.joints)
    if filled:
        settings = settings.replace(urdf=xml)
    if whole:
        settings = settings.replace(joints=joints_of(xml))
    return settings, filled


def joints_of(urdf: str) -> list[str]:
    """Return the joints of a URDF that have one axis and mimic no other, base first."""
    from adaptive_blf_control.arms.urdf_model import reduced_model
    return list(reduced_model(with_inertials(read_urdf(urdf), None)[0], None)[1])
