# SPDX-License-Identifier: Apache-2.0
"""Objects that say what is meant where a program reads or sets an attribute they do not have."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from typing import Any, ClassVar, NoReturn, TYPE_CHECKING

from adaptive_blf_control.errors import (
    check_open,
    close_when_made,
    no_array,
    TypeWithHints,
    without_attribute,
)
from adaptive_blf_control.parameters.settings import Settings

__all__ = ['Guided']


def _not_called(subject: Guided, *_: Any, **__: Any) -> NoReturn:
    raise TypeError(f"{type(subject).__name__!r} object is not callable: {subject._instead['()']}")


class Guided(metaclass=TypeWithHints):
    """Base of what a program holds: a wrong attribute is refused with the one that is meant.

    A subclass names its settings, ``class Controller(Guided, settings=ControllerSettings)``: these
    cannot be set as attributes, which would change nothing, but by ``retune``.
    """

    _closed: ClassVar[bool] = False
    _settings_names: ClassVar[frozenset[str]] = frozenset()
    _instead: ClassVar[Mapping[str, str]] = {}
    """What to write, by names that the object does not have; ``()`` where it is called."""

    def __init_subclass__(cls, settings: type[Settings] | None = None,
                          instead: Mapping[str, str] | None = None, **options: Any) -> None:
        """Take the settings of a class, and what to write for names that it does not have."""
        super().__init_subclass__(**options)
        if settings is not None:
            cls._settings_names = frozenset(item.name for item in dataclasses.fields(settings))
            instead = {'settings =': 'retune(settings=...) changes them', **(instead or {})}
        cls._instead = {**cls._instead, **(instead or {})}
        close_when_made(cls)
        if '()' in (instead or {}):  # no other object of ours looks as if it could be called
            cls.__call__ = _not_called  # type: ignore[method-assign, assignment]

    def __array__(self, *_: Any, **__: Any) -> NoReturn:
        """Raise TypeError: NumPy would make an array of the object itself."""
        raise no_array(self)

    if not TYPE_CHECKING:  # type checkers go on to refuse unknown names
        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError for what is not there, with the one that is meant."""
            raise without_attribute(self, name)

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute; AttributeError where that would change nothing, or half of it."""
        if name in self._settings_names:
            raise AttributeError(f'{type(self).__name__}.{name} cannot be set: '
                                 f'retune({name}=...) changes it')
        check_open(self, name)
        try:
            super().__setattr__(name, value)
        except AttributeError:  # computed, or an object that nothing can be set on
            hint = self._instead.get(f'{name} =', 'it follows from the rest')
            raise AttributeError(
                f'{type(self).__name__}.{name} cannot be set: {hint}') from None
