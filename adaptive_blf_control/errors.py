# SPDX-License-Identifier: Apache-2.0
"""Errors of the package: one root, a few domain classes that carry their data."""

from __future__ import annotations

import array
from collections.abc import Iterable, Mapping
import difflib
import functools
from typing import Any, TYPE_CHECKING, TypeVar

from adaptive_blf_control.synonyms import same_meaning

__all__ = ['GIT_LFS_POINTER', 'ArmError', 'BagError', 'BlfError', 'LogError', 'MissingExtra',
           'ParameterError', 'SetViolation', 'TypeWithHints', 'UnknownParameter', 'check_open',
           'close_names', 'close_when_made', 'nearest', 'no_array', 'shortened', 'shown',
           'with_hints', 'without_attribute']

Kind = TypeVar('Kind')
# How the file begins that Git leaves in place of a large one that was not fetched.
GIT_LFS_POINTER = b'version https://git-lfs'
_LONGEST = 400  # characters of a value in a message
_SHOWN = 12  # elements of an array or list, or names, that a message shows
_FEW = 8  # names that a message lists beside a suggestion
_NEAREST = 5  # names that it lists of many
_CLOSE = 0.7  # likeness of a name that is suggested


def shortened(text: str) -> str:
    """Return a text for a message: without its middle where it is long."""
    return text if len(text) <= _LONGEST else f'{text[:_LONGEST // 2]} ... {text[-40:]}'


def shown(value: object) -> str:
    """Return a value as a message shows it; of a long array or list its shape and its ends."""
    size = getattr(value, 'size', None)
    if isinstance(size, int) and size > _SHOWN and hasattr(value, 'flat'):
        return f'an array of shape {value.shape}, {_ends(value.flat, size)}'  # type: ignore
    if isinstance(value, (list, tuple, array.array)) and len(value) > _SHOWN:
        kind = 'tuple' if isinstance(value, tuple) else 'list'
        return f'a {kind} of {len(value)} elements, {_ends(value, len(value))}'
    if isinstance(value, (str, bytes)) and len(value) > 2 * _LONGEST:  # a million take long
        return f'{shortened(repr(value[:_LONGEST // 2]))} and so on, {len(value)} in all'
    return shortened(' '.join(repr(value).split()))


def _ends(values: Any, count: int) -> str:
    first, second, last = (shown(getattr(values[k], 'item', lambda k=k: values[k])())
                           for k in (0, 1, count - 1))
    return f'{first}, {second} ... {last}'


def without_attribute(subject: object, name: str) -> AttributeError:
    """Return the error for an attribute that an object does not have, with the one that is meant.

    It is raised by ``__getattr__`` of a class, or of the type of a class.

    Args:
        subject: The object, or the class itself. The class may say in ``_instead`` what to write
            for some names, and in ``_settings_names`` which names are settings.
        name: What was asked for.
    """
    kind = subject if isinstance(subject, type) else type(subject)
    settings = getattr(kind, '_settings_names', ())
    if name in getattr(kind, '_instead', {}):
        hint = f': {kind._instead[name]}'  # type: ignore[attr-defined]
    elif name in settings:
        hint = f': settings.{name} has it, retune({name}=...) changes it'
    else:
        public = [] if name.startswith('_') else sorted(
            other for other in (dir(kind) if kind is subject else object.__dir__(subject))
            if not other.startswith('_') and not hasattr(tuple, other))
        close = close_names(name, [*public, *(f'settings.{other}' for other in settings)])
        hint = f': did you mean {" or ".join(close)}?' if close else nearest(
            name, public, 'dir(...)')
    return AttributeError(f'{kind.__name__} has no attribute {name!r}{hint}')


def nearest(name: str, known: Iterable[str], lister: str) -> str:
    """Return for a message the names that there are, of many those that are most alike.

    Args:
        name: What was written.
        known: The names.
        lister: What lists all of them.
    """
    names = sorted(known)
    if len(names) <= _SHOWN:
        return f': it has {", ".join(names)}' if names else ''
    most = difflib.get_close_matches(name, names, _NEAREST, 0.0)
    return f': the nearest are {", ".join(most)}; {lister} lists all {len(names)}'


def no_array(subject: object) -> TypeError:
    """Return the error for an object of which an array was to be made, with what it has.

    Only attributes that cost nothing are looked at: those of a result may be computed.
    """
    kind = type(subject)
    has = [name for name in ('theta', 'nominal', 't', 'q', 'qd', 'tau', 'torque')
           if hasattr(kind, name) or name in getattr(subject, '__dict__', ())]
    return TypeError(f'{kind.__name__} is no array'
                     + (f': its {", ".join(has)} {"are" if len(has) > 1 else "is"}' if has
                        else ''))


def check_open(subject: object, name: str) -> None:
    """Raise AttributeError where a public attribute of an object is set that is closed.

    It is called by ``__setattr__`` of a class; the class may say in ``_instead['name =']`` what
    changes an attribute, and in ``_settable`` which may be set. See `close_when_made`.
    """
    if (name.startswith('_') or not getattr(subject, '_closed', False)
            or name in getattr(subject, '_settable', ())):
        return
    if not hasattr(subject, name):
        raise without_attribute(subject, name)
    kind = type(subject)
    raise AttributeError(f'{kind.__name__}.{name} cannot be set: ' + getattr(
        kind, '_instead', {}).get(f'{name} =', f'make another {kind.__name__}'))


def close_when_made(cls: type) -> None:
    """Let the objects of a class of this package be closed once they have been made.

    Those of a user's subclass stay open, and so does a dataclass, which may be frozen itself.
    """
    begin = vars(cls).get('__init__')
    if begin is None or not cls.__module__.startswith('adaptive_blf_control.'):
        return

    @functools.wraps(begin)
    def __init__(self: Any, *arguments: Any, **named: Any) -> None:
        begin(self, *arguments, **named)
        if type(self) is cls:
            vars(self)['_closed'] = True

    cls.__init__ = __init__  # type: ignore[misc]


class TypeWithHints(type):
    """Type of classes that answer as their objects do where they lack an attribute."""

    if not TYPE_CHECKING:
        def __getattr__(cls, name: str) -> Any:
            """Raise AttributeError for what is not there, with what is meant."""
            # Python itself asks a class for these, many times, while it is made.
            if name.startswith('_') or name in vars(cls).get('__annotations__', ()):
                raise AttributeError(f'{cls.__name__} has no attribute {name!r}')
            raise without_attribute(cls, name)


def with_hints(cls: type[Kind], instead: Mapping[str, str] | None = None) -> type[Kind]:
    """Decorate a class that inherits from nothing of ours: see `without_attribute`."""
    def __getattr__(self: Kind, name: str) -> Any:
        raise without_attribute(self, name)

    cls.__getattr__ = __getattr__  # type: ignore[attr-defined]
    cls._instead = dict(instead or {})  # type: ignore[attr-defined]
    return cls


class BlfError(Exception):
    """Root of every error this package raises on purpose; any can be copied and pickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes the same error: its arguments are the message, not those it took."""
        return _made_again, (type(self), self.args, vars(self))


def _made_again(kind: type[BlfError], arguments: tuple[Any, ...],
                attributes: Mapping[str, Any]) -> BlfError:
    error = kind.__new__(kind, *arguments)
    vars(error).update(attributes)
    return error


class ParameterError(BlfError, ValueError):
    """A parameter has a value that cannot be used.

    Attributes:
        name: Fully qualified parameter name, e.g. ``controller.k1``.
        value: The value that was given.
        expected: What would have been accepted, in words.
    """

    def __init__(self, name: str, value: object, expected: str) -> None:
        super().__init__(f'parameter {name!r} is {shown(value)}: expected {expected}')
        self.name = name
        self.value = value
        self.expected = expected


class UnknownParameter(ParameterError):
    """A parameter is given that is not declared; ``expected`` lists those that are.

    Attributes:
        known: Names of those that are declared.
    """

    def __init__(self, name: str, value: object, known: Iterable[str]) -> None:
        names = sorted(set(known))
        self.known = tuple(names)
        inner = [] if _head_misspelt(name, names) else _members(name, names)
        if inner:
            members = ', '.join(f'{each!r}: ...' for each in inner[:_FEW])
            more = ', ...' * (len(inner) > _FEW)
            expected = f'its members by name: {{{members}{more}}}'
            super().__init__(name, value, expected)
            said = f': it is a group, expected {expected}'
        else:
            super().__init__(name, value, f'one of {", ".join(names)}')
            close = close_names(name, names)
            beside = name.rpartition('.')[0]
            siblings = [f'{beside.rpartition(".")[2]}.{each}' for each in _members(beside, names)]
            said = (f' (did you mean {" or ".join(close)}?)' if close else '') + _listed(
                name, siblings or names, bool(close))
        self.args = (f'parameter {name!r} is {shown(value)}: no such parameter{said}',)

    def beside(self, arguments: Iterable[str]) -> UnknownParameter:
        """Return the same where arguments of a call may be meant as well."""
        return UnknownParameter(self.name, self.value, [*self.known, *arguments])


def _members(name: str, known: Iterable[str]) -> list[str]:
    """Return the names inside of a group; [] of anything else.

    Either side may begin with the name of a node.
    """
    known = list(known)
    for group in (name, name.partition('.')[2]):
        for names in (known, [other.partition('.')[2] for other in known]):
            inner = [other.removeprefix(f'{group}.').partition('.')[0] for other in names
                     if group and other.startswith(f'{group}.')]
            if inner:
                return list(dict.fromkeys(inner))
    return []


def _head_misspelt(name: str, known: Iterable[str]) -> bool:
    """Return whether a name is a known one but for its first part, as of a node: no group then."""
    head, _, tail = name.partition('.')
    parts = [other.partition('.') for other in known if tail]
    heads = [first for first, _, rest in parts if rest == tail]
    return head not in heads and bool(difflib.get_close_matches(head, heads, 1, _CLOSE))


def _listed(name: str, names: list[str], suggested: bool) -> str:
    if len(names) <= (_FEW if suggested else _SHOWN):
        return f'; known: {", ".join(names)}'
    own = name.partition('.')[2] or name  # behind the kind of node
    return '' if suggested else nearest(own, names, 'python -m adaptive_blf_control parameters')


def close_names(name: str, known: Iterable[str]) -> list[str]:
    """Return the names that a person may have meant, the closest first, at most three.

    Those that mean the same come first (see `same_meaning`), then those that look alike.

    Args:
        name: What was written; ``__`` counts as a dot.
        known: Dotted names, which may begin with the name of a node, as ``name`` may.
    """
    known = list(known)
    groups = sorted({other.rpartition('.')[0] for other in known} - {''})
    typed = name.replace('__', '.').lower()
    scores = {other: _likeness(typed, other.lower()) for other in (*known, *groups)}
    best = max(scores.values(), default=0.0)
    alike = [other for other, score in scores.items() if score >= max(_CLOSE, best - 0.05)]
    same = [each for written in (name, name.rpartition('.')[2])
            for each in same_meaning(written, [*known, *groups])]
    beside = typed.rpartition('.')[0]  # a group that may be misspelt
    near = [each for each in same if beside and _likeness(
        beside, each.rpartition('.')[0].lower()) >= _CLOSE]
    same = [*near, *([] if near else same)]
    return list(dict.fromkeys([*same, *sorted(alike, key=lambda other: -scores[other])]))[:3]


def _likeness(name: str, other: str) -> float:
    """Return how much alike two dotted names are, from 0 to 1, with or without their first part.

    Names that only end alike count for less.
    """
    def ratio(first: str, second: str) -> float:
        return difflib.SequenceMatcher(None, first, second).ratio()

    inner = [text.partition('.')[2] or text for text in (name, other)]
    ends = [text.rpartition('.')[2] for text in (name, other)]
    return max(ratio(name, other), ratio(inner[0], other), ratio(name, inner[1]),
               0.9 * ratio(*ends))


class SetViolation(BlfError, ValueError):
    """A joint or body lies outside a set, or one set exceeds another.

    Attributes:
        joint: Name of the joint or body.
        value: Offending value [rad], or in ``unit``.
        bound: Bound that is violated, likewise.
        unit: Of both.
    """

    def __init__(self, joint: str, value: float, bound: float, what: str, *, unit: str = 'rad',
                 kind: str = 'joint', recovery: str = '') -> None:
        super().__init__(f'{kind} {joint!r}: {what}: {value:.6g} {unit} against {bound:.6g} '
                         f'{unit}' + (f': {recovery}' if recovery else ''))
        self.joint = joint
        self.value = value
        self.bound = bound
        self.unit = unit


class ArmError(BlfError, ValueError):
    """An arm cannot be built from what was given (URDF, joints, inertias)."""


class LogError(BlfError, ValueError):
    """A measured log cannot be read or does not hold what is needed."""


class BagError(BlfError, ValueError):
    """A bag cannot be written or read."""


class MissingExtra(BlfError, ImportError):
    """An optional dependency is needed and not installed."""

    def __init__(self, module: str, extra: str, purpose: str) -> None:
        super().__init__(
            f'{purpose} needs the Python module {module!r}: '
            f'pip install "adaptive_blf_control[{extra}]"')
