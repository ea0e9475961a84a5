# SPDX-License-Identifier: Apache-2.0
"""A parameter, declared once: type, default, unit, range, length, description, and its checks."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Set
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from adaptive_blf_control.arrays import by_name
from adaptive_blf_control.errors import ParameterError, UnknownParameter
from adaptive_blf_control.parameters.plugin import is_plugin

__all__ = ['JOINT', 'LONGEST_LIST', 'NOMINAL', 'Parameter', 'Table', 'bounds_of', 'broadcast',
           'declares', 'per_joint', 'plain', 'validated', 'value_problem']

NOMINAL = 'nominal'  # stands for the parameters that an arm has by its URDF or publication
JOINT = '<joint>'  # stands for every joint name in a parameter's name
LONGEST_LIST = 1000
Value = bool | int | float | str | list[bool] | list[int] | list[float] | list[str]

_PYTHON_TYPES: dict[str, tuple[type, str]] = {
    'bool': (bool, 'true or false'),
    'int': (int, 'an integer'),
    'double': (float, 'a floating-point number'),
    'string': (str, 'a string'),
}


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node.

    Attributes:
        name: Dotted lower-snake-case name; may contain ``<joint>``.
        kind: ``bool``, ``int``, ``double``, ``string`` or one of them with ``_array``.
        default: Value when nothing is given.
        description: One sentence for ``ros2 param describe`` and the docs.
        unit: SI unit, '' where there is none.
        minimum: Smallest accepted value of a number or of every array element.
        maximum: Largest accepted value.
        exclusive: Whether ``minimum`` itself is refused.
        length: 'joints' or 'parameters' for arrays of length n or m, where one element stands for
            all; an int for a fixed length; None for any.
        choices: Accepted strings.
        read_only: Structure that cannot change while the node runs.
        plugin: Whether ``module:name`` is accepted beside the choices.
        source: Whether ``nominal`` or a YAML file of an estimate is accepted beside a list.
    """

    name: str
    kind: str
    default: Value
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    exclusive: bool = False
    length: str | int | None = None
    choices: Collection[str] = ()
    read_only: bool = True
    plugin: bool = False
    source: bool = False

    @property
    def is_array(self) -> bool:
        """Whether the value is a list."""
        return self.kind.endswith('_array')

    def named(self, joint: str) -> Parameter:
        """Return this parameter for one joint."""
        return Parameter(**{**self.__dict__, 'name': self.name.replace(JOINT, joint)})

    def choices_text(self) -> str:
        """Return the accepted strings in words, '' where every one is accepted."""
        return ', '.join([*self.choices, *(['module:name'] if self.plugin else []),
                          *(['a list', NOMINAL, 'a .yaml file'] if self.source else [])])

    def range_text(self) -> str:
        """Return the accepted range in words, '' where every value is accepted."""
        parts = []
        if self.minimum is not None:
            parts.append(f'{">" if self.exclusive else ">="} {self.minimum:g}')
        if self.maximum is not None:
            parts.append(f'<= {self.maximum:g}')
        return ' and '.join(parts) + (f' {self.unit}' if parts and self.unit else '')


Table = tuple[Parameter, ...]


def per_joint(table: Iterable[Parameter], joints: Iterable[str]) -> dict[str, Parameter]:
    """Expand ``<joint>`` in the names of a table; return it by name."""
    joints = list(joints)
    expanded: dict[str, Parameter] = {}
    for parameter in table:
        copies = [parameter.named(j) for j in joints] if JOINT in parameter.name else [parameter]
        expanded.update((copy.name, copy) for copy in copies)
    return expanded


def declares(parameter: Parameter, name: str) -> bool:
    """Return whether ``name`` is that of a parameter, whatever the joint."""
    before, joint, after = parameter.name.partition(JOINT)
    if not joint:
        return name == before
    return name.startswith(before) and name.endswith(after) and bool(
        name[len(before):-len(after) or None])


def plain(kind: str, value: Any) -> Any:
    """Return what a Python caller gave as the plain value of ``kind`` where it is one.

    Scalars and arrays of any real type become lists of floats, integers floats; a pandas Series
    with names a mapping, as nobody knows here whose order is wanted.
    """
    if kind == 'double_array':
        value = by_name(value)
        try:
            array = np.atleast_1d(np.asarray(value))
        except (TypeError, ValueError):  # rows of different lengths
            return value
        return array.astype(float).tolist() if array.dtype.kind in 'iuf' else value
    if kind == 'string_array':
        return list(value) if isinstance(value, (tuple, list)) else value
    if kind == 'double' and isinstance(value, (int, np.integer, np.floating)) and not isinstance(
            value, bool):
        return float(value)
    if kind == 'int' and isinstance(value, np.integer):
        return int(value)
    if kind == 'bool' and isinstance(value, np.bool_):
        return bool(value)
    return value


def bounds_of(value: Any) -> dict[str, float] | None:
    """Return ``(-1.0, 1.0)`` as the bounds that it can only mean: ``lower`` and ``upper``.

    None for everything else: two numbers of one sign could be one bound for each of two joints,
    rows could be joints or bounds.
    """
    if not isinstance(value, (tuple, list, np.ndarray)) or len(value) != 2:
        return None
    if not all(isinstance(each, (int, float, np.integer, np.floating))
               and not isinstance(each, bool) for each in value):
        return None
    lower, upper = (float(each) for each in value)
    return {'lower': lower, 'upper': upper} if lower < 0.0 < upper else None


def _element_problem(parameter: Parameter, value: Any) -> str | None:
    kind = parameter.kind.removesuffix('_array')
    python_type, words = _PYTHON_TYPES[kind]
    number: Any = value
    if kind == 'double' and type(value) is int:
        return f'a floating-point number: write {value}.0'
    if type(value) is not python_type:
        return f'one of {parameter.choices_text()}' if parameter.choices else words
    if kind == 'double' and math.isnan(number):
        return 'a number, not NaN'
    if kind == 'double' and math.isinf(number):
        return 'a finite number'
    if kind in ('int', 'double'):
        low, high = parameter.minimum, parameter.maximum
        if low is not None and (number < low or (parameter.exclusive and number == low)):
            return parameter.range_text()
        if high is not None and number > high:
            return parameter.range_text()
    # The default is one of them: it is accepted without asking, which may load a module.
    if value != parameter.default and parameter.choices and value not in parameter.choices \
            and not (parameter.plugin and is_plugin(value)):
        return f'one of {parameter.choices_text()}'
    return None


def value_problem(parameter: Parameter, value: Any, sizes: Mapping[str, int]) -> str | None:
    """Return what is expected instead of ``value``, or None where it is accepted.

    Args:
        parameter: Its declaration.
        value: Candidate value, as YAML or ROS gives it.
        sizes: Known lengths, e.g. ``{'joints': 7}``; a missing one is not checked.
    """
    if not parameter.is_array:
        return _element_problem(parameter, value)
    kind = parameter.kind.removesuffix('_array')
    if parameter.source and isinstance(value, str):
        known = value == NOMINAL or value.endswith(('.yaml', '.yml'))
        return None if known else f'one of {parameter.choices_text()}'
    if isinstance(value, (str, bytes, type, Mapping, Set)) or not hasattr(value, '__len__'):
        whole = isinstance(getattr(value, 'theta', None), np.ndarray)
        return f'a list of {kind}s' + ': its theta' * whole
    if len(value) > LONGEST_LIST:
        return f'at most {LONGEST_LIST} elements'
    for element in value:
        if isinstance(element, (Mapping, list, tuple)):
            return f'one flat list of {kind}s: {parameter.description.removesuffix(".")}'
        problem = _element_problem(parameter, element)
        if problem:
            return f'a list in which every element is {problem}'
    length = sizes.get(parameter.length) if isinstance(parameter.length, str) else parameter.length
    if length is not None:
        accepted = (length,) if isinstance(parameter.length, int) else (1, length)
        if len(value) not in accepted:
            what = ' or '.join(str(n) for n in dict.fromkeys(accepted))
            per = f' (one for each of the {parameter.length})' * isinstance(parameter.length, str)
            return f'a list of length {what}{per}'
    return None


def validated(table: Iterable[Parameter], given: Mapping[str, Any], where: str,
              sizes: Mapping[str, int] | None = None) -> dict[str, Any]:
    """Return every parameter of an (expanded) table with its given or default value.

    Args:
        table: Declarations without ``<joint>``.
        given: Values by name.
        where: Prefix for messages, e.g. the node's name.
        sizes: Lengths by name, see :func:`value_problem`.

    Raises:
        ParameterError: a name is unknown, or a value has the wrong type, length or range.
    """
    by_name = {parameter.name: parameter for parameter in table}
    for name in given:
        if name not in by_name:
            raise UnknownParameter(f'{where}.{name}', given[name], by_name)
    values = {}
    for name, parameter in by_name.items():
        value = given.get(name, parameter.default)
        problem = value_problem(parameter, value, sizes or {})
        if problem:
            raise ParameterError(f'{where}.{name}', value, problem)
        values[name] = value
    return values


def broadcast(value: Iterable[float], length: int) -> np.ndarray:
    """Return a list of length 1 or ``length`` as an array of shape (length,)."""
    array = np.array(list(value), dtype=float)
    return np.full(length, array[0]) if array.size == 1 else array
