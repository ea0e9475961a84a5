# SPDX-License-Identifier: Apache-2.0
"""The sets and the reference of a controller as a caller gives them: as settings or as objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.settings import Settings
from adaptive_blf_control.parameters.table import bounds_of

__all__ = ['Group', 'given_part', 'is_group']

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


def given_part(name: str, value: Any) -> Any:
    """Return a set or reference that is given as an object; ParameterError where it is none."""
    if isinstance(value, type):
        raise ParameterError(name, value, f'{_WAYS[name]}: {value.__name__}(...), not the class')
    if not all(hasattr(value, each) for each in _ASKED[name]):
        raise ParameterError(name, value, _WAYS[name])
    return value
