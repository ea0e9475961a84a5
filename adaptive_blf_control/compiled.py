# SPDX-License-Identifier: Apache-2.0
"""One decorator that compiles a pure array function with numba where numba is installed.

The laws are written as functions over float64 arrays in the subset numba compiles. Without numba
(or with ``NUMBA_DISABLE_JIT=1``) the very same functions run as plain numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import singledispatch
import math
from typing import Any, Protocol, TypeVar

import numpy as np

from adaptive_blf_control.machine_code import cache_folder

__all__ = ['ByType', 'COMPILED', 'Handle', 'all_finite', 'before_each_compilation',
           'before_own_compilations', 'borrowed', 'by_type', 'handle', 'inlined', 'jit',
           'jit_without_gil', 'jitable', 'uncompiled']

Function = TypeVar('Function', bound=Callable[..., Any])

try:
    import numba
    from numba.core import event as numba_event, sigutils
    from numba.core.caching import FunctionCache
    from numba.experimental import structref
    from numba.extending import intrinsic, overload, register_jitable
    import scipy.linalg  # noqa: F401 (numba's np.linalg is scipy's LAPACK)
    COMPILED: bool = not numba.config.DISABLE_JIT
except ImportError:  # plain numpy is the documented fallback
    numba = None
    COMPILED = False


def _is_ours(kind: Any) -> bool:
    """Return whether a numba type is made of types that every process of this package knows."""
    named = getattr(kind, 'instance_class', None)
    if named is not None and not named.__module__.startswith('adaptive_blf_control.'):
        return False
    fields = getattr(kind, 'types', None) or getattr(kind, 'field_dict', {}).values()
    return all(map(_is_ours, fields))


if COMPILED:
    class _CacheOfOurTypes(FunctionCache):  # type: ignore[misc]
        """Keeps no machine code for types of a user's program.

        numba's index of a function names all types that it was compiled for, and cannot be read
        by a program that does not know one of them.
        """

        def save_overload(self, sig: Any, data: Any) -> None:
            """Keep what was compiled for a signature."""
            arguments, _ = sigutils.normalize_signature(sig)
            if all(map(_is_ours, arguments)):
                super().save_overload(sig, data)


def jit(function: Function) -> Function:
    """Compile a module-level function; the machine code is cached on disk."""
    return _compiled(function)


def jit_without_gil(function: Function) -> Function:
    """Compile as `jit`; other threads of Python run while the function does.

    For what takes long: where a call is short, giving the interpreter away costs more.
    """
    return _compiled(function, nogil=True)


def _compiled(function: Function, **options: bool) -> Function:
    if numba is None:
        return function
    folder = cache_folder(function.__module__) if COMPILED else ''
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = folder or before
    try:
        compiled = numba.njit(cache=bool(folder), error_model='numpy', **options)(function)
        if folder:
            compiled._cache = _CacheOfOurTypes(function)
    finally:
        numba.config.CACHE_DIR = before
    return compiled  # type: ignore[no-any-return]


def inlined(function: Function) -> Function:
    """Compile a module-level function as a part of each compiled one that calls it, never alone.

    For what takes long to compile and has few callers: on its own it would be optimised twice.
    """
    if numba is None:
        return function
    compiled = numba.njit(inline='always', error_model='numpy')(function)
    return compiled  # type: ignore[no-any-return]


def jitable(function: Function) -> Function:
    """Let compiled functions call a module-level function; Python calls it as it stands.

    For what is less work than a call from Python into compiled code, see `Handle`.
    """
    if not COMPILED:
        return function
    return register_jitable(error_model='numpy')(function)  # type: ignore[no-any-return]


def borrowed(value: Any) -> Any:
    """Return ``value``; in a compiled function, without counting the owners of its arrays.

    numba counts the owners of an array each time one is taken out of a tuple and when it is no
    longer used, with atomic operations: with tuples of many arrays that takes most of the time.
    ``pairs = borrowed(pairs)`` at the begin of a function lets numba see that nothing of this
    argument is to be counted. The caller keeps it alive; nothing of it may be returned to Python.
    """
    return value


if COMPILED:
    @overload(borrowed, strict=False)
    def _borrowed(value: Any) -> Callable[..., Any]:
        return lambda value: _ownerless(value)

    @intrinsic  # type: ignore[untyped-decorator]
    def _ownerless(typing: Any, value: Any) -> tuple[Any, Callable[..., Any]]:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            return _without_owner(context, builder, signature.args[0], arguments[0])

        return value(value), generate

    def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, numba.types.Array):
            array = context.make_array(kind)(context, builder, value)
            array.meminfo = context.get_constant_null(numba.types.MemInfoPointer(kind.dtype))
            array.parent = context.get_constant_null(numba.types.pyobject)
            return array._getvalue()
        if isinstance(kind, numba.types.BaseTuple):
            for place, inner in enumerate(kind):
                part = _without_owner(context, builder, inner, builder.extract_value(value, place))
                value = builder.insert_value(value, part, place)
            return value
        context.nrt.incref(builder, kind, value)  # what else has owners, a random generator
        return value


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
        @overload(generic, jit_options={'error_model': 'numpy'}, strict=False)
        def implementation(first: Any, *_: Any) -> Callable[..., Any] | None:
            chosen = generic.dispatch(getattr(first, 'instance_class', object))
            return getattr(chosen, 'py_func', None)
    result: ByType = generic
    return result


class Handle:
    """A NamedTuple that compiled functions get as one argument; ``value`` is it there.

    Each array in an argument costs a call from Python 0.2 µs, whether it is used or not.
    """

    def __init__(self, value: Any) -> None:
        """Take the NamedTuple."""
        self.value = value


if COMPILED:
    @structref.register
    class _HandleType(numba.types.StructRef):  # type: ignore[misc]
        def preprocess_fields(self, fields: Any) -> Any:
            return tuple((name, numba.types.unliteral(kind)) for name, kind in fields)

    class _CompiledHandle(structref.StructRefProxy):  # type: ignore[misc]
        pass

    structref.define_proxy(_CompiledHandle, _HandleType, ['value'])

    @jit
    def _new_handle(value: Any) -> Any:
        return _CompiledHandle(value)


def handle(value: Any) -> Any:
    """Return a `Handle` of a NamedTuple: its arrays are shared, its scalars are those of now."""
    return _new_handle(value) if COMPILED else Handle(value)


def uncompiled(function: Function) -> Function:
    """Return the Python function behind a compiled one, for arguments that numba does not know."""
    return getattr(function, 'py_func', function)


def before_each_compilation(call: Callable[[], None]) -> AbstractContextManager[None]:
    """Return a context in which ``call`` is called before any function is compiled.

    An exception that it raises ends that compilation and those that needed it.
    """
    return nullcontext() if numba is None else _listening(call)


def before_own_compilations(call: Callable[[], None]) -> None:
    """Have ``call`` called before each function of this package that is compiled from now on."""
    if numba is None:
        return

    class Listener(numba_event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            function = getattr(event.data.get('dispatcher'), 'py_func', None)
            if str(getattr(function, '__module__', '')).startswith('adaptive_blf_control.'):
                call()

        def on_end(self, event: object) -> None:
            pass

    numba_event.register('numba:compile', Listener())


@contextmanager
def _listening(call: Callable[[], None]) -> Iterator[None]:
    class Listener(numba_event.Listener):  # type: ignore[misc]
        def on_start(self, event: object) -> None:
            call()

        def on_end(self, event: object) -> None:
            pass

    with numba_event.install_listener('numba:compile', Listener()):
        yield


@jit
def all_finite(array: np.ndarray) -> bool:
    """Return whether every element is finite."""
    finite = True
    for value in array.flat:
        finite = finite and math.isfinite(value)
    return finite
