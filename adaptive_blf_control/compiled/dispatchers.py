# SPDX-License-Identifier: Apache-2.0
"""Functions as numba compiles them here: whole, in parts, or apart, and kept on disk.

numba optimises a function on its own and once more in each that calls it. A *part* is optimised
in its callers only; a function *apart* is machine code that its callers jump to.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import copy
import hashlib
from importlib import import_module
import sys
from types import ModuleType, SimpleNamespace
from typing import Any

from adaptive_blf_control.compiled.library import COMPILED
from adaptive_blf_control.machine_code import alone_with

if COMPILED:
    from adaptive_blf_control.compiled.library import (
        binding,
        compile_extra,
        CompileResultCacheImpl,
        CPUDispatcher,
        environment,
        Flags,
        FunctionCache,
        global_compiler_lock,
        JITCodeLibrary,
        lookup_environment,
        numba,
        numba_event,
        rtsys,
        sigutils,
    )

__all__ = ['Entry', 'Part']


def _is_ours(kind: Any) -> bool:
    """Return whether a numba type is made of types that every process of this package knows."""
    named = getattr(kind, 'instance_class', None)
    if named is not None and not named.__module__.startswith('adaptive_blf_control.'):
        return False
    fields = getattr(kind, 'types', None) or getattr(kind, 'field_dict', {}).values()
    return all(map(_is_ours, fields))


if COMPILED:
    @contextmanager
    def _without_imports() -> Iterator[None]:
        """Return a context in which code is loaded without the modules that it was compiled from.

        numba imports them for their names, which only Python functions look up.
        """
        before = environment.importlib
        environment.importlib = SimpleNamespace(
            import_module=lambda name: sys.modules.get(name) or ModuleType(name))
        try:
            yield
        finally:
            environment.importlib = before

    _apart: dict[str, tuple[str, str, Any]] = {}  # by symbol: module, name, types of arguments

    class _WithCalled(CompileResultCacheImpl):  # type: ignore[misc]
        """Keeps, beside the machine code of a function, what it calls of `jit_apart`."""

        def reduce(self, cres: Any) -> Any:
            """Return what is kept."""
            called = [_apart[function.name] for function in cres.library._final_module.functions
                      if function.is_declaration and function.name in _apart]
            return called, super().reduce(cres)

        def rebuild(self, target_context: Any, payload: Any) -> Any:
            """Return what was kept, once all that it calls is there."""
            called, kept = payload
            for module, name, arguments in called:
                getattr(import_module(module), name).part.compile(arguments)
            return super().rebuild(target_context, kept)

    class _CacheOfOurTypes(FunctionCache):  # type: ignore[misc]
        """Keeps no machine code for types of a user's program.

        numba's index of a function names all types that it was compiled for, and cannot be read
        by a program that does not know one of them.
        """

        _impl_class = _WithCalled

        def __init__(self, function: Any) -> None:
            """Keep the code of a function."""
            super().__init__(function)
            self._is_ours = function.__module__.startswith('adaptive_blf_control.')

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            """Return what was compiled before, or None.

            numba loads its implementations of everything, and scipy, before it looks. What is
            machine code already needs none of them; others may call what they bring.
            """
            if not self._is_ours:
                return super().load_overload(sig, target_context)
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors(), _without_imports():
                return self._load_overload(sig, target_context)

        def save_overload(self, sig: Any, data: Any) -> None:
            """Keep what was compiled for a signature."""
            arguments, _ = sigutils.normalize_signature(sig)
            if all(map(_is_ours, arguments)):
                super().save_overload(sig, data)

    class _WithoutWrapper(_WithCalled):
        """Keeps code without a wrapper for Python in files of its own."""

        def get_filename_base(self, *arguments: Any) -> str:
            """Return how the names of the files begin."""
            return f'{super().get_filename_base(*arguments)}.apart'

    class _CacheOfApart(_CacheOfOurTypes):
        """The cache of `_Apart`: Python would crash in code that only compiled functions call."""

        _impl_class = _WithoutWrapper

    class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]
        """Code that is optimised, and made machine code, in the functions that it is linked to.

        numba does both for every function on its own and again in each that calls it, so that a
        call tree costs its depth times as much.
        """

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._finalized = True

    class Part(CPUDispatcher):  # type: ignore[misc]
        """A function as compiled functions call it."""

        def compile(self, sig: Any) -> Any:
            """Compile for a signature, and return what stands for it in compiled functions."""
            arguments, result = sigutils.normalize_signature(sig)
            arguments = tuple(arguments)
            with global_compiler_lock:
                if arguments not in self.overloads:
                    self.overloads[arguments] = self._found(arguments, result)
                return self.overloads[arguments].entry_point

        def _found(self, arguments: Any, result: Any) -> Any:
            library = _PartLibrary(self.targetctx.codegen(), self.py_func.__qualname__)
            return self._stand_in(self._compiled(arguments, result, library), [library])

        def _compiled(self, arguments: Any, result: Any, library: Any = None) -> Any:
            flags = Flags()
            self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
            flags = self._compiler._customize_flags(flags)
            flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
            flags.no_compile = library is not None
            data = {'dispatcher': self, 'args': arguments, 'return_type': result}
            with self._compiling_counter, numba_event.trigger_event('numba:compile', data):
                return compile_extra(self.typingctx, self.targetctx, self.py_func, args=arguments,
                                     return_type=result, flags=flags, locals=self.locals,
                                     library=library)

        def _stand_in(self, found: Any, libraries: list[Any]) -> Any:
            """Make what compiled functions call, the code of which is in some libraries."""
            key = object()
            self.targetctx.insert_user_function(key, found.fndesc, libraries)
            return found._replace(entry_point=key)

    def _cache_in(folder: str, kind: type[FunctionCache], function: Any) -> FunctionCache:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = folder
        try:
            return kind(function)
        finally:
            numba.config.CACHE_DIR = before

    class _Apart(Part):
        """A function whose machine code compiled functions call where it is, see `jit_apart`."""

        def __init__(self, function: Any, options: dict[str, Any], folder: str) -> None:
            super().__init__(function, targetoptions=options)
            self._folder = folder
            if folder:
                self._cache = _cache_in(folder, _CacheOfApart, function)

        def _found(self, arguments: Any, result: Any) -> Any:
            name = self.py_func.__name__
            with alone_with(self._folder, f'{name}.apart'):
                found = self._cache.load_overload(arguments, self.targetctx)
                if found is None:
                    found = self._compiled(arguments, result)
                    self._cache.save_overload(arguments, found)
            _show_environments(found.library)
            digest = hashlib.sha256(str(arguments).encode()).hexdigest()[:16]
            symbol = f'{self.py_func.__module__}.{name}.{digest}'
            _apart[symbol] = self.py_func.__module__, name, arguments
            binding.add_symbol(symbol, found.library.get_pointer_to_function(
                found.fndesc.llvm_func_name))
            description = copy.copy(found.fndesc)
            description.mangled_name = symbol
            return self._stand_in(found._replace(fndesc=description), [])

    def _show_environments(library: Any) -> None:
        """Show code where its parts find what they need."""
        for variable in library._final_module.global_variables:
            environment = lookup_environment(variable.name)
            if environment is not None:
                library.codegen.set_env(variable.name, environment)

    class Entry(CPUDispatcher):  # type: ignore[misc]
        """A function as Python calls it; compiled functions call its part.

        Attributes:
            part: That part.
        """

        def __init__(self, function: Any, options: dict[str, Any], folder: str, *,
                     apart: bool) -> None:
            super().__init__(function, targetoptions=options)
            self._folder = folder
            if folder:
                self._cache = _cache_in(folder, _CacheOfOurTypes, function)
            self.part: Any = (_Apart(function, options, folder) if apart else
                              Part(function, targetoptions=options))

        @property
        def _numba_type_(self) -> Any:
            return numba.types.Dispatcher(self.part)

        def compile(self, sig: Any) -> Any:
            """Compile for a signature, or wait for the process that does and take its result."""
            with alone_with(self._folder, self.py_func.__name__):
                return super().compile(sig)

        def add_overload(self, cres: Any) -> None:
            """Take what was compiled."""
            _show_environments(cres.library)
            super().add_overload(cres)
