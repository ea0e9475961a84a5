# SPDX-License-Identifier: Apache-2.0
"""Settings classes: a parameter is declared once, as a typed field of a frozen dataclass.

The attribute path is the parameter's name: ``settings.history.size`` is ``history.size`` in YAML
and in ROS. The declaration carries unit, range and description, so that ROS descriptors, checks
of parameter files and the pages of the docs all follow from it:

    @dataclass(frozen=True, kw_only=True, eq=False, repr=False)
    class HistorySettings(Settings, where='identifier.history'):
        size: int = parameter(20, 'Number of recorded pairs, P.', minimum=1, live=True)

Two settings are equal where all their values are; arrays in them cannot be written.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import dataclasses
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, TYPE_CHECKING, TypeVar

import numpy as np

from adaptive_blf_control.arrays import check_unmasked
from adaptive_blf_control.errors import (
    ParameterError,
    TypeWithHints,
    UnknownParameter,
    without_attribute,
)
from adaptive_blf_control.parameters.declaration import declared, GROUP, is_usual, PER_JOINT
from adaptive_blf_control.parameters.table import (
    bounds_of,
    broadcast,
    declares,
    JOINT,
    Parameter,
    plain,
    Table,
    value_problem,
)
from adaptive_blf_control.spelling import setting

__all__ = ['Settings', 'changed_names', 'listed']

_Self = TypeVar('_Self', bound='Settings')


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Settings(metaclass=TypeWithHints):
    """Base of all settings; makes every value usable or refuses it with ParameterError."""

    _where: ClassVar[str] = ''
    _instead: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(('from_yaml', 'from_file', 'load', 'read', 'from_dict'),
                        'from_values(values) takes them by name, simulate(file, 0.001) builds '
                        'identifier and controller of a parameter file'),
        **dict.fromkeys(('update', 'set', 'copy'), 'replace(name=...) returns a changed copy'),
        **dict.fromkeys(('to_dict', 'as_dict', 'asdict', 'dict', 'items', 'keys', 'to_yaml',
                         'save', 'dump'), 'values() returns all of them by name'),
        **dict.fromkeys(('describe', 'description', 'doc', 'defaults', 'names', 'info'),
                        'help(...) of the class says what each one is, values() returns all')}

    def __init_subclass__(cls, where: str = '', **options: Any) -> None:
        """Take the prefix for the names in messages, e.g. ``identifier.history``."""
        super().__init_subclass__(**options)
        cls._where = where

    def __new__(cls, *unnamed: Any, **given: Any) -> Settings:
        """Refuse names that are not declared, as every other name and value is refused."""
        if unnamed:
            raise ParameterError(cls.__name__, unnamed[0], 'parameters by name: '
                                 f'{cls.__name__}({dataclasses.fields(cls)[0].name}=...)')
        # In place of that of `dataclass`, which does not say what to do instead.
        type.__setattr__(cls, '__setattr__', _cannot_be_set)
        own = {item.name for item in dataclasses.fields(cls)}
        for name, value in given.items():
            if name not in own:
                raise cls._unknown(name, value)
        return super().__new__(cls)

    @classmethod
    def _unknown(cls, name: str, value: Any) -> UnknownParameter:
        return UnknownParameter(f'{cls._where}.{name}'.lstrip('.'), value,
                                [row.name for row in cls.table()])

    if not TYPE_CHECKING:
        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError for what is not there, with the one that is meant."""
            raise without_attribute(self, name)

    def __post_init__(self) -> None:
        """Convert lists, integers and float32 arrays; ParameterError names what cannot be used."""
        for item in dataclasses.fields(self):
            object.__setattr__(self, item.name, self._usable(item, getattr(self, item.name)))
        self._check()

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what a copy or a pickle is made of again: mappings as such have neither."""
        values = {item.name: getattr(self, item.name) for item in dataclasses.fields(self)}
        return _made_again, (type(self), {
            name: dict(value) if isinstance(value, MappingProxyType) else value
            for name, value in values.items()})

    def _check(self) -> None:
        """Refuse values that do not fit each other; subclasses say which."""

    def _usable(self, item: dataclasses.Field[Any], value: Any) -> Any:
        name = f'{self._where}.{item.name}'.lstrip('.')
        if GROUP in item.metadata:
            return _as_group(item.metadata[GROUP], value, name)
        if PER_JOINT in item.metadata:
            kind = item.metadata[PER_JOINT]
            if not isinstance(value, Mapping):
                raise ParameterError(name, value, f'a mapping from joints to {kind.__name__}')
            return MappingProxyType({str(joint): _as_group(kind, each, f'{name}.{joint}')
                                     for joint, each in value.items()})
        row = self._declarations()[item.name]
        check_unmasked(name, value)
        given, value = value, plain(row.kind, value)
        problem = value_problem(row, value, {})
        if problem:
            raise ParameterError(name, given, problem)
        if row.kind == 'double_array' and not isinstance(value, str):
            return _frozen(np.array(value, dtype=float))
        return tuple(value) if row.is_array and not isinstance(value, str) else value

    @classmethod
    def _declarations(cls) -> dict[str, Parameter]:
        return declared(cls, cls._where)

    @classmethod
    def table(cls) -> Table:
        """Return the declarations of all parameters, groups included, in their order."""
        if '_table' not in cls.__dict__:
            type.__setattr__(cls, '_table', tuple(_rows(cls, cls(), '')))
        return cls.__dict__['_table']  # type: ignore[no-any-return]

    @classmethod
    def from_values(cls: type[_Self], values: Mapping[str, Any]) -> _Self:
        """Build from values by parameter name; what is not given has its default."""
        arguments: dict[str, Any] = {}
        for item in dataclasses.fields(cls):
            kind = item.metadata.get(GROUP)
            if kind is not None:
                inner = _below(f'{item.name}.', values)
                if inner:
                    given = dict(_default(item).values(), **inner)
                    arguments[item.name] = kind.from_values(given)
            elif PER_JOINT in item.metadata:
                single = {other.name for other in dataclasses.fields(cls)}
                joints = dict.fromkeys(name.rpartition('.')[0] for name in values
                                       if '.' in name and name.partition('.')[0] not in single)
                arguments[item.name] = {
                    joint: item.metadata[PER_JOINT].from_values(_below(f'{joint}.', values))
                    for joint in joints}
            elif item.name in values:
                arguments[item.name] = values[item.name]
        return cls(**arguments)

    @classmethod
    def taken(cls: type[_Self], settings: _Self | Mapping[str, Any] | None,
              changes: Mapping[str, Any], of_any_arm: bool = False) -> _Self:
        """Return the settings that a constructor is given: the defaults where None, changed.

        Args:
            settings: What is given.
            changes: Values by name in place of theirs.
            of_any_arm: Whether they may have been resolved for another arm, so that one element
                of what is the default stands for all.

        Raises:
            ParameterError: they are of another kind, or a change cannot be made.
        """
        if settings is None:
            settings = cls()
        elif isinstance(settings, Mapping):
            settings = cls.from_values(cls._by_name(settings))
        elif not isinstance(settings, cls):
            raise ParameterError('settings', settings, f'{cls.__name__} or a mapping; an '
                                 'estimate is given as initial_estimate=..., and '
                                 'simulate(file, 0.001) has the controller and the identifier of '
                                 'a parameter file')
        try:
            return (settings._of_any_arm() if of_any_arm else settings).replace(**changes)
        except UnknownParameter as error:  # may also be meant for the argument
            raise error.beside(['settings']) from None

    def values(self) -> dict[str, Any]:
        """Return all values by parameter name, arrays as lists: what YAML and ROS hold."""
        flat: dict[str, Any] = {}
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, Settings):
                flat.update({f'{item.name}.{name}': v for name, v in value.values().items()})
            elif isinstance(value, Mapping):
                flat.update({f'{joint}.{name}': v for joint, each in value.items()
                             for name, v in each.values().items()})
            else:
                flat[item.name] = (value.tolist() if isinstance(value, np.ndarray)
                                   else list(value) if isinstance(value, tuple) else value)
        return flat

    def replace(self: _Self, **changes: Any) -> _Self:
        """Return a copy with other values by parameter name.

        ``replace(**{'history.size': 30})`` and ``replace(history={'size': 30})`` mean the same;
        ``replace(history=HistorySettings(size=30))`` replaces the whole group.

        Raises:
            ParameterError: a name is not declared, or a value cannot be used.
        """
        groups = {name: value for name, value in changes.items() if isinstance(value, Settings)}
        changed = dataclasses.replace(self, **groups)
        others = self._by_name({name: value for name, value in changes.items()
                                if name not in groups})
        return type(self).from_values({**changed.values(), **others}) if others else changed

    @classmethod
    def _by_name(cls, nested: Mapping[str, Any]) -> dict[str, Any]:
        """Return nested mappings by parameter name, as ``from_values`` takes them.

        Raises:
            ParameterError: a name is not declared.
        """
        flat = dict(cls._flat(nested))
        table = cls.table()
        for name, value in flat.items():
            if not any(declares(row, name) for row in table):
                raise cls._unknown(name, value)
        return flat

    @classmethod
    def _flat(cls, nested: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
        fields = {item.name: item.metadata for item in dataclasses.fields(cls)}
        of_joint = next((data[PER_JOINT] for data in fields.values() if PER_JOINT in data), None)
        for name, value in nested.items():
            metadata: Mapping[Any, Any] = fields.get(name, {})
            kind = metadata.get(GROUP, None if name in fields else of_joint)
            if isinstance(value, Mapping) and PER_JOINT in metadata:
                yield from cls._flat(value)
            elif isinstance(value, Settings):
                yield from ((f'{name}.{inner}', each) for inner, each in value.values().items())
            elif kind is not None and (given := _members(kind, value)) is not None:
                yield from ((f'{name}.{inner}', each) for inner, each in kind._flat(given))
            else:
                yield name, value

    def resolved(self: _Self, **sizes: int) -> _Self:
        """Return a copy whose arrays have their full length, e.g. ``joints=7, parameters=50``.

        Raises:
            ParameterError: an array has neither one element nor that many.
        """
        full: dict[str, Any] = {}
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, Settings):
                full[item.name] = value.resolved(**sizes)
            elif isinstance(value, np.ndarray):
                row = self._declarations()[item.name]
                problem = value_problem(row, value.tolist(), sizes)
                if problem:
                    raise ParameterError(row.name, value.tolist(), problem)
                length = sizes.get(str(row.length), value.size)
                full[item.name] = value if value.size == length else broadcast(value, length)
        longer = {name: value for name, value in full.items() if value is not getattr(self, name)}
        return dataclasses.replace(self, **longer) if longer else self

    def _of_any_arm(self: _Self) -> _Self:
        """Return a copy in which one element stands for all, where all are the default.

        Settings of an arm with as many joints or parameters then fit another one.
        """
        short: dict[str, Any] = {}
        for item in dataclasses.fields(self):
            value = getattr(self, item.name)
            if isinstance(value, Settings):
                short[item.name] = value._of_any_arm()
            elif isinstance(value, np.ndarray) and value.size > 1 and is_usual(
                    self._declarations()[item.name], value):
                short[item.name] = value[:1]
        other = {name: value for name, value in short.items() if value is not getattr(self, name)}
        return dataclasses.replace(self, **other) if other else self

    def __eq__(self, other: object) -> bool:
        """Whether ``other`` is of the same class with the same values."""
        if type(other) is not type(self):
            return NotImplemented
        return self._key() == other._key()

    def __hash__(self) -> int:
        """Agree with ``==``."""
        return hash(self._key())

    def _key(self) -> tuple[Any, ...]:
        return tuple(value.tobytes() if isinstance(value, np.ndarray)
                     else tuple(sorted((joint, each._key()) for joint, each in value.items()))
                     if isinstance(value, Mapping) else value
                     for value in (getattr(self, item.name) for item in dataclasses.fields(self)))

    def __repr__(self) -> str:
        """Show what differs from the defaults."""
        usual = type(self)()
        parts = []
        for item in dataclasses.fields(self):
            value, default = getattr(self, item.name), getattr(usual, item.name)
            same = (np.array_equal(value, default) if isinstance(default, np.ndarray)
                    else value == default)
            if not same:
                shown = value.tolist() if isinstance(value, np.ndarray) else value
                parts.append(f'{item.name}={shown!r}')
        return f'{type(self).__name__}({", ".join(parts)})'


def _cannot_be_set(settings: Settings, name: str, value: Any) -> None:
    if name not in {item.name for item in dataclasses.fields(settings)}:
        raise without_attribute(settings, name)
    written = setting('.'.join([*settings._where.split('.')[1:], name]), '...')
    raise dataclasses.FrozenInstanceError(
        f'{type(settings).__name__}.{name} cannot be set: replace({written}) of the settings '
        f'returns a changed copy, retune({written}) of an Identifier or a Controller changes them')


def listed(cls: type[_Self]) -> type[_Self]:
    """Decorate a settings class: its docstring lists every parameter, for notebooks."""
    lines = []
    for row in cls.table():
        shape = f', shape ({row.length},)' * row.is_array * (row.length is not None)
        unit = f' [{row.unit}]' * bool(row.unit)
        lines.append(f'    {row.name}: {row.description} Default {row.default}{unit}{shape}.')
    cls.__doc__ = '\n'.join([f'{cls.__doc__}\n', 'Parameters, by name:', *lines])
    return cls


def changed_names(before: Settings, after: Settings) -> set[str]:
    """Return the names of the parameters that differ between two settings of one class."""
    old = before.values()
    return {name for name, value in after.values().items()
            if name not in old or old[name] != value}


def _default(group_field: dataclasses.Field[Any]) -> Settings:
    """Return the default of a field that is a group."""
    make: Any = group_field.default_factory
    return make()  # type: ignore[no-any-return]


def _rows(cls: type[Settings], usual: Settings, prefix: str) -> Iterator[Parameter]:
    values = usual.values()
    for item in dataclasses.fields(cls):
        if GROUP in item.metadata:
            yield from _rows(item.metadata[GROUP], getattr(usual, item.name),
                             f'{prefix}{item.name}.')
        elif PER_JOINT in item.metadata:
            kind = item.metadata[PER_JOINT]
            yield from _rows(kind, kind(), f'{prefix}{JOINT}.')
        else:
            yield dataclasses.replace(cls._declarations()[item.name], name=f'{prefix}{item.name}',
                                      default=values[item.name])


def _as_group(kind: type[Settings], value: Any, name: str) -> Settings:
    if isinstance(value, kind):
        return value
    given = _members(kind, value)
    if given is not None:
        return kind.from_values(kind._by_name(given))
    names = ', '.join(f'{item.name!r}: ...' for item in dataclasses.fields(kind))
    raise ParameterError(name, value, f'{kind.__name__} or a mapping of its fields: {{{names}}}')


def _members(kind: type[Settings], value: Any) -> Mapping[str, Any] | None:
    """Return what a caller gave for a group as a mapping; None where it is none.

    Bounds may be a pair with zero between: ``safety=(-1.0, 1.0)``.
    """
    if isinstance(value, Mapping):
        return value
    bounds = {'lower', 'upper'} == {item.name for item in dataclasses.fields(kind)}
    return bounds_of(value) if bounds else None


def _below(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    return {name.removeprefix(prefix): value for name, value in values.items()
            if name.startswith(prefix)}


def _frozen(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array


def _made_again(kind: type[Settings], values: dict[str, Any]) -> Settings:
    return kind(**values)
