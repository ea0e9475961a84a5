# SPDX-License-Identifier: Apache-2.0
"""The sets and the reference of a controller as a caller gives them: as settings or as objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from adaptive_blf_control.arrays import are_vectors, checked_array
from adaptive_blf_control.control.reference import Reference, ReferencePoint
from adaptive_blf_control.control.settings import ControllerSettings
from adaptive_blf_control.errors import ParameterError, UnknownParameter
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.parameters.table import bounds_of

__all__ = ['Group', 'given_part', 'given_settings', 'is_group', 'reference_in_arrays']

Group = Mapping[str, Any] | Settings | tuple[float, float]
"""The settings of a set or of the reference; a pair for the bounds of a set."""

# Of a part that is given as an object: what it has to have, and in which other ways it is given.
_ASKED = {'safety': ('lower', 'upper', 'margin'), 'performance': ('lower', 'upper', 'margin'),
          'reference': ('at', 'range')}
_BOUNDS = ("{'lower': ..., 'upper': ...} with numbers or lists, one for each joint, "
           '(-a, b) for all joints, or a part with lower, upper, margin')
_WAYS = {
    'safety': _BOUNDS, 'performance': _BOUNDS,
    'reference': "{'joint1': {'amplitude': 0.5, 'frequency': 1.0, 'offset': 0.0}, ...} by joint, "
                 'a SumOfSinusoids, or an object with at(t), which returns a ReferencePoint of '
                 'position, velocity and acceleration, and range(), the bounds of its positions'}


def is_group(name: str, value: Any) -> bool:
    """Return whether a caller gave settings: a mapping, a group, or bounds as a pair."""
    return isinstance(value, (Mapping, Settings)) or (
        name != 'reference' and bounds_of(value) is not None)


def given_settings(settings: ControllerSettings | None,
                   changes: Mapping[str, Any]) -> ControllerSettings:
    """Return settings with changes by name; UnknownParameter names the arguments, too."""
    try:
        return ControllerSettings.taken(settings, changes, of_any_arm=True)
    except UnknownParameter as error:
        raise error.beside(('settings', 'start', 'velocity')) from None


def given_part(name: str, value: Any) -> Any:
    """Return a set or reference that is given as an object; ParameterError for any other."""
    if isinstance(value, type):
        raise ParameterError(name, value, f'{_WAYS[name]}: {value.__name__}(...), not the class')
    if not all(hasattr(value, each) for each in _ASKED[name]):
        raise ParameterError(name, value, _WAYS[name])
    return value


def reference_in_arrays(reference: Reference, joints: tuple[str, ...]) -> Reference:
    """Return a reference whose points are arrays: itself, where they are.

    Args:
        reference: One of a user's own may have lists, or numbers of one joint.
        joints: Names of the joints.

    Raises:
        ParameterError: it answers with something else than points for these joints.
    """
    values = [*_points(reference, 0.0, joints), *_range(reference, joints)]
    as_given = [*reference.at(0.0), *reference.range()]
    return reference if are_vectors((len(joints),), *as_given) else _InArrays(
        reference, joints, np.array(values[3:]))


class _InArrays:
    """A reference of a user's own whose points hold lists or numbers."""

    def __init__(self, reference: Reference, joints: tuple[str, ...], ends: np.ndarray) -> None:
        self._reference, self._joints, self._ends = reference, joints, ends

    def __repr__(self) -> str:
        """Show the reference as it was given."""
        return repr(self._reference)

    def at(self, t: float) -> ReferencePoint:
        """Evaluate at ``t`` [s]."""
        return _points(self._reference, t, self._joints)

    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the range that is never left."""
        return self._ends[0].copy(), self._ends[1].copy()


def _points(reference: Reference, t: float, joints: tuple[str, ...]) -> ReferencePoint:
    point = reference.at(t)
    if not isinstance(point, ReferencePoint):
        raise ParameterError(f'reference.at({t})', point, 'a ReferencePoint')
    return ReferencePoint(*(checked_array(f'reference.{name}', value, (len(joints),), joints)
                            for name, value in point._asdict().items()))


def _range(reference: Reference, joints: tuple[str, ...]) -> list[np.ndarray]:
    return [checked_array(f'reference.{name}', value, (len(joints),), joints)
            for name, value in zip(('lower', 'upper'), reference.range())]
