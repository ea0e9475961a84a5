# SPDX-License-Identifier: Apache-2.0
"""Calls with wrong arguments, refused like wrong values: by an error that says what is meant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import functools
import inspect
import re
from typing import Any, cast, TypeVar

from adaptive_blf_control.errors import close_names, ParameterError, UnknownParameter

__all__ = ['argument_names', 'checked_call', 'without_argument']

Function = TypeVar('Function', bound=Callable[..., Any])


class _Words:
    """What stands where a message shows a value, in words."""

    def __init__(self, text: str) -> None:
        self._text = text

    def __repr__(self) -> str:
        return self._text


def checked_call(function: Function) -> Function:
    """Decorate a function or method: wrong arguments are a ParameterError, not a TypeError.

    The message names the argument and has what the docstring says of it. A TypeError from inside
    the function passes unchanged.
    """
    @functools.wraps(function)
    def checked(*arguments: Any, **named: Any) -> Any:
        try:
            return function(*arguments, **named)
        except TypeError:
            problem = _problem(function, arguments, named)
            if problem is None:
                raise
            raise problem from None

    return cast(Function, checked)


def argument_names(function: Callable[..., Any]) -> list[str]:
    """Return the names of the arguments that a call may give."""
    return _takable(inspect.signature(function).parameters)


def without_argument(function: Callable[..., Any], name: str) -> ParameterError:
    """Return the error for a call without an argument that is needed after all."""
    about = _about(function).get(name, '')
    return ParameterError(name, _Words('missing'),
                          f'{_spelt(function)}' + (f', {name}: {about}' if about else ''))


def _problem(function: Callable[..., Any], arguments: tuple[Any, ...],
             named: Mapping[str, Any]) -> ParameterError | None:
    """Return what is wrong with the arguments of a call; None where they fit."""
    signature = inspect.signature(function)
    try:
        signature.bind(*arguments, **named)
        return None
    except TypeError:
        pass
    declared = {name: each for name, each in signature.parameters.items() if name != 'self'}
    open_ended = any(each.kind is each.VAR_KEYWORD for each in declared.values())
    for name, value in named.items():
        if name not in declared and not open_ended:
            return UnknownParameter(name, value, _takable(declared))
    given = len(arguments) - ('self' in signature.parameters)
    places = [name for name, each in declared.items() if each.kind in (
        inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)]
    if given > len(places):
        return ParameterError(_name(function), _Words(f'given {given} arguments in order'),
                              f'at most {len(places)} of them: {_spelt(function, True)}'
                              + _first(function, places))
    for name in places[:given]:
        if name in named:
            return ParameterError(name, named[name], f'one value, not two: {_spelt(function)}')
    missing = next((name for name, each in declared.items() if name not in named
                    and name not in places[:given] and each.default is each.empty
                    and each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)), None)
    for name, value in named.items():
        if missing is not None and name not in declared and close_names(name, [missing]):
            return UnknownParameter(name, value, [missing])
    return None if missing is None else without_argument(function, missing)


def _first(function: Callable[..., Any], places: list[str]) -> str:
    """Return what the first argument is: too many are given where it would hold them all."""
    about = _about(function).get(places[0], '') if places else ''
    return f', {places[0]}: {about.partition("; ")[0]}' if about else ''


def _takable(declared: Mapping[str, inspect.Parameter]) -> list[str]:
    return [name for name, each in declared.items()
            if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)]


def _name(function: Callable[..., Any]) -> str:
    """Return what a caller calls a function: of a constructor the name of its class."""
    first, _, last = function.__qualname__.rpartition('.')
    return first.rpartition('.')[2] if last == '__init__' else last


def _spelt(function: Callable[..., Any], in_order: bool = False) -> str:
    """Return a call with the names of its arguments: ``learn(t, q, qd, tau)``.

    Args:
        function: What is called.
        in_order: Whether arguments that are given by name alone are left out.
    """
    parts: list[str] = []
    star = False
    for name, each in inspect.signature(function).parameters.items():
        if name == 'self' or each.kind in (each.VAR_POSITIONAL, each.VAR_KEYWORD):
            continue
        if each.kind is each.KEYWORD_ONLY and not star:
            parts, star = [*parts, '*'], True
            if in_order:
                parts.append('...')
                break
        parts.append(name if each.default is each.empty else f'{name}=...')
    return f'{_name(function)}({", ".join(parts)})'


def _about(function: Callable[..., Any]) -> dict[str, str]:
    """Return the first sentence of what a docstring says of each argument."""
    text = inspect.getdoc(function) or ''
    section = re.search(r'^Args:\n((?:[ ]+.*\n?|\n)*)', text, re.MULTILINE)
    found = re.findall(r'^ {4}(\w+): (.*(?:\n {8}.*)*)', section[1] if section else '',
                       re.MULTILINE)
    end = re.compile(r'(?<!e\.g)\.(?:\s|$)')
    return {name: end.split(' '.join(said.split()))[0] for name, said in found}
