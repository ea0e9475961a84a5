# SPDX-License-Identifier: Apache-2.0
"""Parts that are not ours: ``module:name`` in a parameter names a class or a function to call."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
import importlib
import inspect
from typing import Any, TypeVar

from adaptive_blf_control.errors import BlfError, ParameterError

__all__ = ['CALLED_AS', 'NamesIn', 'is_plugin', 'load_plugin', 'made', 'require',
           'require_call', 'to_be_written']


CALLED_AS = {
    'answer': 'answer(sample) -> LawAnswer(torque, e2, regressor)',
    'bounded': 'bounded(state) -> Bounded(value, lower, upper)',
    'step': 'step(theta, dt, evidence) -> theta',
    'measure': 'measure(q, qd, torque, dt) -> Measurement(q, qd, torque)'}
"""How what a user writes most often is called and what it returns, for messages."""

Method = TypeVar('Method', bound=Callable[..., Any])


class NamesIn(Collection[str]):
    """The names that a module lists, which is imported when they are asked for.

    A node that only declares what other nodes have does not load their laws for it.
    """

    def __init__(self, module: str, constant: str) -> None:
        """Take where they are: the module below this package, and the constant in it."""
        self._module, self._constant = f'{__package__.partition(".")[0]}.{module}', constant

    def _names(self) -> tuple[str, ...]:
        names: tuple[str, ...] = getattr(importlib.import_module(self._module), self._constant)
        return names

    def __contains__(self, name: object) -> bool:
        """Return whether it lists ``name``."""
        return name in self._names()

    def __iter__(self) -> Iterator[str]:
        """Go through the names in order."""
        return iter(self._names())

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self._names())


def is_plugin(text: object) -> bool:
    """Return whether a parameter's value has the form ``module:name``."""
    module, colon, name = str(text).partition(':')
    return bool(colon) and name.isidentifier() and all(
        part.isidentifier() for part in module.split('.'))


def load_plugin(parameter: str, text: str) -> Any:
    """Return what ``module:name`` names.

    Args:
        parameter: Name of the parameter, for the message.
        text: Its value; the module is imported from Python's path.

    Raises:
        ParameterError: no such module or name, or the module fails while it is imported.
    """
    if not is_plugin(text):
        raise ParameterError(parameter, text, 'module:name')
    module, _, name = text.partition(':')
    try:
        return getattr(importlib.import_module(module), name)
    except Exception as error:  # a plug-in's module may raise anything
        raise ParameterError(parameter, text, f'a module and a name in it that can be imported '
                             f'({type(error).__name__}: {error})') from error


def _check_call(given: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """Raise TypeError where a call does not fit; one of a builtin is not known before."""
    try:
        signature = inspect.signature(given)
    except ValueError:
        return
    signature.bind(*arguments)


def made(parameter: str, value: object, given: Any, names: Sequence[str], *arguments: Any,
         base: str = '') -> Any:
    """Return a part: as it is given, or what a class or function that is given makes.

    Args:
        parameter: Name of the parameter or argument, for messages.
        value: Its value, likewise.
        given: The part, or what is called with ``arguments``, or with nothing where it takes
            none, and returns it.
        names: What its protocol asks for.
        arguments: See ``given``.
        base: See `require`.

    Raises:
        ParameterError: it cannot be made, or lacks what its protocol asks for.
    """
    part = given
    if callable(given) and (isinstance(given, type)
                            or not all(hasattr(given, name) for name in names)):
        try:
            if _takes_nothing(given, arguments):
                arguments = ()
            _check_call(given, arguments)
            part = given(*arguments)
        except BlfError:
            raise
        except Exception as error:  # a plug-in's constructor may raise anything
            kinds = ', '.join(type(argument).__name__ for argument in arguments)
            raise ParameterError(parameter, value, 'an object, or what can be called with '
                                 f'{kinds} ({type(error).__name__}: {error}) and returns one, '
                                 f'with {_spelt(names)}{_inherited(base)}') from error
    require(parameter, value, part, names, base)
    return part


def require(parameter: str, value: object, part: object, names: Sequence[str],
            base: str = '') -> None:
    """Raise ParameterError where a part lacks one of the attributes its protocol asks for.

    Args:
        parameter: Name of the parameter or argument, for the message.
        value: Its value, likewise.
        part: What it stands for.
        names: What the protocol asks for.
        base: Class of the package that has most of them, for who inherits from it.
    """
    missing = [name for name in names if _lacks(part, name)]
    if isinstance(part, type):
        raise ParameterError(parameter, value, f'a part with {", ".join(names)}: '
                             f'an object such as {part.__name__}(), not the class')
    if missing:
        raise ParameterError(parameter, value, f'a part with {_spelt(names)}: '
                             f'{type(part).__name__} has no {", ".join(missing)}'
                             + _inherited('' if base in [
                                 each.__name__ for each in type(part).__mro__] else base))


def require_call(parameter: str, value: object, part: object, method: str,
                 *arguments: str) -> None:
    """Raise ParameterError where a method of a part cannot be called as its protocol calls it.

    Args:
        parameter: Name of the parameter or argument, for the message.
        value: Its value, likewise.
        part: What it stands for.
        method: Name of the method.
        arguments: Names of what it is called with.
    """
    try:
        _check_call(getattr(part, method), arguments)
    except TypeError as error:
        raise ParameterError(parameter, value, f'a part whose {method} is called as '
                             f'{method}({", ".join(arguments)}): {error}') from None


def _takes_nothing(given: Callable[..., Any], arguments: tuple[Any, ...]) -> bool:
    """Return whether a call has to be one without arguments, as of a class with no constructor."""
    if isinstance(given, type) and not any(
            getattr(vars(each).get(name), '__module__', 'typing') != 'typing'  # of protocols
            for each in given.__mro__ if each is not object for name in ('__init__', '__new__')):
        return True
    try:
        _check_call(given, arguments)
        return False
    except TypeError:
        pass
    try:
        inspect.signature(given).bind()
        return True
    except (TypeError, ValueError):
        return False


def to_be_written(method: Method) -> Method:
    """Decorate a method that a class of the user's has to have: the inherited one is none."""
    method.__dict__['to_be_written'] = True
    return method


def _lacks(part: object, name: str) -> bool:
    return not hasattr(part, name) or getattr(getattr(part, name), 'to_be_written', False)


def _spelt(names: Sequence[str]) -> str:
    """Return the names that a protocol asks for, of the best known with arguments and result."""
    return ', '.join(CALLED_AS.get(name, name) for name in names)


def _inherited(base: str) -> str:
    """Return what is said of the class of the package that a part may inherit from."""
    return f'; a class that inherits from {base} has most of them' if base else ''
