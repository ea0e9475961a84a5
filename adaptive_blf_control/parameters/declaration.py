# SPDX-License-Identifier: Apache-2.0
"""Fields of settings classes: each is a parameter, or a group of them, and carries what it is."""

from __future__ import annotations

from collections.abc import Callable, Collection
import dataclasses
from dataclasses import field
import functools
from typing import Any, get_type_hints

import numpy as np

from adaptive_blf_control.parameters.table import Parameter, Value

__all__ = ['declared', 'group', 'GROUP', 'group_per_joint', 'is_usual', 'parameter', 'PER_JOINT']

DECLARATION, GROUP, PER_JOINT = 'declaration', 'group', 'group per joint'
_KINDS: dict[Any, str] = {bool: 'bool', int: 'int', float: 'double', str: 'string',
                          np.ndarray: 'double_array', np.ndarray | str: 'double_array',
                          tuple[str, ...]: 'string_array'}


def parameter(default: Value, description: str, unit: str = '', minimum: float | None = None,
              maximum: float | None = None, *, exclusive: bool = False,
              length: str | int | None = None, choices: Collection[str] = (),
              live: bool = False, plugin: bool = False, source: bool = False) -> Any:
    """Declare a field of a settings class as a parameter.

    Args:
        default: Value when nothing is given, a list for an array.
        description: One sentence for ``ros2 param describe`` and the docs.
        unit: SI unit, '' where there is none.
        minimum: Smallest accepted value of a number or of every array element.
        maximum: Largest accepted value.
        exclusive: Whether ``minimum`` itself is refused.
        length: 'joints' or 'parameters' for arrays of length n or m, where one element stands for
            all; an int for a fixed length; None for any.
        choices: Accepted strings.
        live: Whether it can be changed while a node runs.
        plugin: Whether ``module:name`` is accepted beside the choices.
        source: Whether ``nominal`` or a YAML file of an estimate is accepted beside a list; the
            field then is ``np.ndarray | str``.
    """
    declaration = Parameter('', '', default, description, unit, minimum, maximum, exclusive,
                            length, choices, not live, plugin, source)
    if isinstance(default, list):
        return field(default_factory=lambda: default, metadata={DECLARATION: declaration})
    return field(default=default, metadata={DECLARATION: declaration})


def group(kind: Callable[..., Any], **defaults: Any) -> Any:
    """Declare a field as a nested group of parameters, where given with other defaults."""
    return field(default_factory=functools.partial(kind, **defaults), metadata={GROUP: kind})


def group_per_joint(kind: type[Any]) -> Any:
    """Declare a field as a mapping from joint names to groups; in names it is ``<joint>``."""
    return field(default_factory=dict, metadata={PER_JOINT: kind})


def declared(cls: type[Any], where: str) -> dict[str, Parameter]:
    """Return the declaration of each field of a class, its kind read from its annotation once.

    Args:
        cls: A settings class.
        where: Prefix of the names in messages, e.g. ``identifier.history``.
    """
    if '_declared' in cls.__dict__:
        return cls.__dict__['_declared']  # type: ignore[no-any-return]
    hints = get_type_hints(cls)
    rows = {item.name: dataclasses.replace(item.metadata[DECLARATION],
                                           name=f'{where}.{item.name}'.lstrip('.'),
                                           kind=_KINDS[hints[item.name]])
            for item in dataclasses.fields(cls) if DECLARATION in item.metadata}
    type.__setattr__(cls, '_declared', rows)
    return rows


def is_usual(row: Parameter, value: np.ndarray) -> bool:
    """Return whether all elements of an array are its default, which is one for all."""
    usual = row.default
    return isinstance(usual, list) and len(usual) == 1 and bool(
        value.size and (value == usual).all())
