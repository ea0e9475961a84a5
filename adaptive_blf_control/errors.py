# SPDX-License-Identifier: Apache-2.0
"""Errors of the package: one root, a few domain classes that carry their data."""

from __future__ import annotations

from collections.abc import Iterable
import difflib

__all__ = ['GIT_LFS_POINTER', 'ArmError', 'BagError', 'BlfError', 'LogError', 'MissingExtra',
           'ParameterError', 'SetViolation', 'UnknownParameter', 'shortened']

# How the file begins that Git leaves in place of a large one that was not fetched.
GIT_LFS_POINTER = b'version https://git-lfs'
_LONGEST = 400  # characters of a value in a message


def shortened(text: str) -> str:
    """Return a text for a message: without its middle where it is long."""
    return text if len(text) <= _LONGEST else f'{text[:_LONGEST // 2]} ... {text[-40:]}'


def _short(value: object) -> str:
    # The text of a million numbers takes half a second in which nothing else runs.
    if isinstance(value, (list, tuple, str, bytes)) and len(value) > _LONGEST:
        return f'{shortened(repr(value[:10]))} and so on, {len(value)} in all'
    return shortened(' '.join(repr(value).split()))


class BlfError(Exception):
    """Root of every error this package raises on purpose."""


class ParameterError(BlfError, ValueError):
    """A parameter has a value that cannot be used.

    Attributes:
        name: Fully qualified parameter name, e.g. ``controller.k1``.
        value: The value that was given.
        expected: What would have been accepted, in words.
    """

    def __init__(self, name: str, value: object, expected: str) -> None:
        super().__init__(f'parameter {name!r} is {_short(value)}: expected {expected}')
        self.name = name
        self.value = value
        self.expected = expected


class UnknownParameter(ParameterError):
    """A parameter is given that is not declared; ``expected`` lists those that are."""

    def __init__(self, name: str, value: object, known: Iterable[str]) -> None:
        names = sorted(known)
        super().__init__(name, value, f'one of {", ".join(names)}')
        close = _closest(name, names)
        hint = f' (did you mean {close}?)' if close else ''
        self.args = (f'parameter {name!r} is {_short(value)}: no such parameter{hint}; known: '
                     f'{", ".join(names)}',)


def _closest(name: str, known: list[str]) -> str | None:
    own = name.rpartition('.')[2]
    same = [other for other in known if other.rpartition('.')[2] == own]
    return next(iter(same or difflib.get_close_matches(name.partition('.')[2] or name, known)
                     or difflib.get_close_matches(own, known)), None)


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
