# SPDX-License-Identifier: Apache-2.0
"""How messages spell an option: as a Python program writes it, or as its command does."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ['argument', 'as_command', 'option', 'setting', 'spelled']

_COMMAND: ContextVar[bool] = ContextVar('command', default=False)


@contextmanager
def as_command() -> Iterator[None]:
    """Spell options as a command line has them, while this context lasts."""
    token = _COMMAND.set(True)
    try:
        yield
    finally:
        _COMMAND.reset(token)


def spelled(python: str, command: str) -> str:
    """Return a value as Python or as the command line has it."""
    return command if _COMMAND.get() else python


def argument(name: str) -> str:
    """Return the name of an argument: ``effort_delay`` or ``--effort-delay``."""
    return f'--{name.replace("_", "-")}' if _COMMAND.get() else name


def option(name: str, value: str = 'True', command: str | None = None) -> str:
    """Return an argument with a value: ``effort_delay=0.02`` or ``--effort-delay 0.02``.

    Args:
        name: Name of the argument in Python.
        value: Its value there.
        command: Its value on the command line where it differs, '' for none.
    """
    if not _COMMAND.get():
        return f'{name}={value}'
    text = ('' if value == 'True' else value) if command is None else command
    return f'{argument(name)} {text}'.rstrip()


def setting(name: str, value: str) -> str:
    """Return a parameter with a value: ``filter={'gap': 1}`` or ``--set filter.gap=1``."""
    if _COMMAND.get():
        return f'--set {name}={value}'
    group, _, inner = name.rpartition('.')
    return f'{group}={{{inner!r}: {value}}}' if group else f'{name}={value}'
