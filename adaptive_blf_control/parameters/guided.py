# SPDX-License-Identifier: Apache-2.0
"""Objects that say what is meant where a program reads or sets an attribute they do not have."""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
from typing import Any, ClassVar, TYPE_CHECKING

from adaptive_blf_control.errors import close_names
from adaptive_blf_control.parameters.settings import Settings

__all__ = ['Guided', 'without_attribute']


def without_attribute(subject: object, name: str) -> AttributeError:
    """Return the error for an attribute that an object does not have, with the one that is meant.

    For a class that cannot inherit from `Guided`: it is raised by ``__getattr__``.

    Args:
        subject: The object. Its class may say in ``_instead`` what to write for some names, and
            in ``_settings_names`` which names are settings.
        name: What was asked for.
    """
    kind = type(subject)
    if name in getattr(kind, '_settings_names', ()):
        hint = f': settings.{name} has it, retune({name}=...) changes it'
    elif name in getattr(kind, '_instead', {}):
        hint = f': {kind._instead[name]}'  # type: ignore[attr-defined]
    else:
        public = [] if name.startswith('_') else [
            other for other in object.__dir__(subject) if not other.startswith('_')]
        close = close_names(name, sorted(public))
        hint = f': did you mean {" or ".join(close)}?' if close else (
            f': it has {", ".join(sorted(public))}' if public else '')
    return AttributeError(f'{kind.__name__} has no attribute {name!r}{hint}')


class Guided:
    """Base of what a program holds: a wrong attribute is refused with the one that is meant.

    A subclass names its settings, ``class Controller(Guided, settings=ControllerSettings)``: these
    cannot be set as attributes, which would change nothing, but by ``retune``.
    """

    _settings_names: ClassVar[frozenset[str]] = frozenset()
    _instead: ClassVar[Mapping[str, str]] = {}
    """What to write, by names that the object does not have."""

    def __init_subclass__(cls, settings: type[Settings] | None = None,
                          instead: Mapping[str, str] | None = None, **options: Any) -> None:
        """Take the settings of a class, and what to write for names that it does not have."""
        super().__init_subclass__(**options)
        if settings is not None:
            cls._settings_names = frozenset(item.name for item in dataclasses.fields(settings))
        cls._instead = {**cls._instead, **(instead or {})}

    if not TYPE_CHECKING:  # type checkers go on to refuse unknown names
        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError for what is not there, with the one that is meant."""
            raise without_attribute(self, name)

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute; AttributeError where it is a setting, which that would not change."""
        if name in self._settings_names:
            raise AttributeError(f'{type(self).__name__}.{name} cannot be set: '
                                 f'retune({name}=...) changes it')
        super().__setattr__(name, value)
