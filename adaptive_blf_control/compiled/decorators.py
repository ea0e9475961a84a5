# SPDX-License-Identifier: Apache-2.0
"""Decorators that compile pure array functions, and functions chosen by type."""

from __future__ import annotations

from collections.abc import Callable
from functools import singledispatch
from typing import Any, Protocol, TypeVar

from adaptive_blf_control.compiled.library import COMPILED
from adaptive_blf_control.machine_code import cache_folder

if COMPILED:
    from adaptive_blf_control.compiled.dispatchers import Entry, Part
    from adaptive_blf_control.compiled.library import (
        AbstractTemplate,
        CPUDispatcher,
        infer_global,
        lower_builtin,
        numba,
    )
    from adaptive_blf_control.compiled.vector_arguments import argument_kind

__all__ = ['by_type', 'ByType', 'entry_for', 'jit', 'jit_apart', 'jit_without_gil', 'jitable',
           'uncompiled']

Function = TypeVar('Function', bound=Callable[..., Any])

if COMPILED:
    def _stands_for(function: Any, chosen: Callable[[Any], Any]) -> None:
        """Let compiled functions that call ``function`` call another one.

        Args:
            function: What they call.
            chosen: Returns a `Part` for the type of the first argument, or None.
        """
        class _Chosen(AbstractTemplate):  # type: ignore[misc]
            key = function

            def generic(self, arguments: Any, keywords: Any) -> Any:
                part = chosen(arguments[0])
                return None if part is None else numba.types.Dispatcher(part).get_call_type(
                    self.context, arguments, keywords)

        infer_global(function, numba.types.Function(_Chosen))

        @lower_builtin(function, numba.types.VarArg(numba.types.Any))
        def _call(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            part = numba.types.Dispatcher(chosen(signature.args[0]))
            return context.get_function(part, signature)(builder, arguments)


def jit(function: Function) -> Function:
    """Compile a module-level function; the machine code is cached on disk."""
    return _compiled(function)


def jit_without_gil(function: Function) -> Function:
    """Compile as `jit`; other threads of Python run while the function does.

    For what takes long: where a call is short, giving the interpreter away costs more.
    """
    return _compiled(function, nogil=True)


def jit_apart(function: Function) -> Function:
    """Compile as `jit`, but not once more in every compiled function that calls it.

    For what is large and called with the same types from many places: they call its machine code
    instead of holding a copy of it, which is kept on disk like theirs. It returns a
    number or nothing and gets references, see `borrowed`.
    """
    return _compiled(function, apart=True)


def _compiled(function: Function, apart: bool = False, **options: bool) -> Function:
    if not COMPILED:
        return function
    return Entry(function, {'nopython': True, 'error_model': 'numpy', **options},  # type: ignore
                  cache_folder(function.__module__), apart=apart)


def entry_for(function: Function, *arguments: Any) -> Function:
    """Return a compiled function for arguments of these types, which are not looked at any more.

    A call from Python looks at the type of each argument to find the machine code for it, which
    takes 0.3 µs for a `Handle` alone. Who calls with the same types for each sample asks once.
    An array of another type of numbers is a TypeError; that arrays are as long as they have to be
    is up to the caller.

    Args:
        function: One that was made by `jit`. It uses contiguous vectors of float64, and bytes,
            as ``borrowed(q)``.
        arguments: Examples.
    """
    if not COMPILED:
        return function
    kinds = tuple(map(argument_kind, arguments))
    done = function.overloads.get(kinds)  # type: ignore[attr-defined]
    return (function.compile(kinds) if done is None  # type: ignore[attr-defined,no-any-return]
            else done.entry_point)


def jitable(function: Function) -> Function:
    """Let compiled functions call a module-level function; Python calls it as it stands.

    For what is less work than a call from Python into compiled code, see `Handle`.
    """
    if COMPILED:
        part = Part(function, targetoptions={'nopython': True, 'error_model': 'numpy'})
        _stands_for(function, lambda kind: part)
    return function


class ByType(Protocol):
    """A function with one implementation per type of its first argument."""

    def __call__(self, *arguments: Any) -> Any:
        """Call the implementation for the type of the first argument."""
        ...

    def register(self, cls: type, func: Callable[..., Any]) -> None:
        """Name the implementation for a type, a function made by `jit`.

        Raises:
            TypeError: Another type of the same name has one. Compiled functions tell NamedTuples
                apart by the names of the class and its fields only.
        """
        ...


def by_type(function: Callable[..., Any]) -> ByType:
    """Make a function that is implemented per type of its first argument, a NamedTuple.

    A compiled function that calls it is compiled once per such type, with the implementation of
    that type in line, and cached on disk. Neither holds for a function that takes the
    implementation as an argument or closes over it. The cache knows the sources of this package:
    who changes an implementation outside of it has to clear the cache of what calls it.

    Args:
        function: What is called for a type without an implementation; it is not compiled.
    """
    generic: Any = singledispatch(function)
    add = generic.register

    def register(cls: type, func: Callable[..., Any]) -> None:
        if any(known is not cls and known.__name__ == cls.__name__ for known in generic.registry):
            raise TypeError(f'a type named {cls.__name__} has an implementation of '
                            f'{function.__name__}: expected another name')
        add(cls, func)

    generic.register = register
    if COMPILED:
        def implementation(first: Any) -> Any:
            chosen = generic.dispatch(getattr(first, 'instance_class', object))
            own = chosen if isinstance(chosen, CPUDispatcher) else None  # a user's, by numba.njit
            return getattr(chosen, 'part', own)

        _stands_for(generic, implementation)
    result: ByType = generic
    return result


def uncompiled(function: Function) -> Function:
    """Return the Python function behind a compiled one, for arguments that numba does not know."""
    return getattr(function, 'py_func', function)
