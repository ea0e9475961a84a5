# SPDX-License-Identifier: Apache-2.0
"""One decorator that compiles a pure array function with numba where numba is installed.

The laws are written as functions over float64 arrays in the subset numba compiles. Without numba
(or with ``NUMBA_DISABLE_JIT=1``) the very same functions run as plain numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
import copy
import ctypes
from functools import singledispatch
import hashlib
from importlib import import_module
from importlib.util import find_spec
import math
import struct
import sys
from types import ModuleType, SimpleNamespace
from typing import Any, Protocol, TypeVar
import warnings

import numpy as np

from adaptive_blf_control.machine_code import alone_with, cache_folder

__all__ = ['ByType', 'COMPILED', 'Handle', 'all_finite', 'before_each_compilation',
           'before_own_compilations', 'borrowed', 'by_type', 'cos_sin', 'handle', 'jit',
           'jit_apart', 'jit_without_gil', 'jitable', 'uncompiled']

Function = TypeVar('Function', bound=Callable[..., Any])

try:
    import numba
    if find_spec('scipy') is None:  # numba's np.linalg is scipy's LAPACK
        raise ImportError('scipy')
    COMPILED: bool = not numba.config.DISABLE_JIT
except ImportError:  # plain numpy is the documented fallback
    numba = None
    COMPILED = False

if numba is not None:
    try:
        from llvmlite import binding, ir
        from numba.core import cgutils, environment, event as numba_event, sigutils
        from numba.core.caching import CompileResultCacheImpl, FunctionCache
        from numba.core.codegen import JITCodeLibrary
        from numba.core.compiler import compile_extra, Flags
        from numba.core.compiler_lock import global_compiler_lock
        from numba.core.environment import lookup_environment
        from numba.core.imputils import impl_ret_borrowed, lower_builtin, lower_getattr_generic
        from numba.core.registry import CPUDispatcher
        from numba.core.runtime import rtsys
        from numba.core.typing.templates import (
            AbstractTemplate,
            AttributeTemplate,
            infer_getattr,
            infer_global,
            signature,
        )
        from numba.extending import (
            lower_getattr,
            models,
            NativeValue,
            register_model,
            typeof_impl,
            unbox,
        )
    except ImportError as error:  # a version that has it elsewhere
        numba = None
        COMPILED = False
        warnings.warn(f'numba is installed but cannot be used ({error}): the laws run as plain '
                      'numpy, much slower', RuntimeWarning, stacklevel=2)


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


if COMPILED:
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

    class _Part(CPUDispatcher):  # type: ignore[misc]
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

    class _Apart(_Part):
        """A function whose machine code compiled functions call where it is, see `jit_apart`."""

        def __init__(self, function: Any, options: dict[str, Any], folder: str,
                     cache: Any) -> None:
            super().__init__(function, targetoptions=options)
            self._folder, self._cache = folder, cache

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

    class _Entry(CPUDispatcher):  # type: ignore[misc]
        """A function as Python calls it; compiled functions call its part.

        Attributes:
            part: That part.
        """

        def __init__(self, function: Any, options: dict[str, Any], folder: str, *,
                     apart: bool) -> None:
            super().__init__(function, targetoptions=options)
            self._folder = folder
            if folder:
                before = numba.config.CACHE_DIR
                numba.config.CACHE_DIR = folder
                try:
                    self._cache = _CacheOfOurTypes(function)
                finally:
                    numba.config.CACHE_DIR = before
            self.part: Any = (_Apart(function, options, folder, self._cache) if apart else
                              _Part(function, targetoptions=options))

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

    def _stands_for(function: Any, chosen: Callable[[Any], Any]) -> None:
        """Let compiled functions that call ``function`` call another one.

        Args:
            function: What they call.
            chosen: Returns a `_Part` for the type of the first argument, or None.
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
    return _Entry(function, {'nopython': True, 'error_model': 'numpy', **options},  # type: ignore
                  cache_folder(function.__module__), apart=apart)


def jitable(function: Function) -> Function:
    """Let compiled functions call a module-level function; Python calls it as it stands.

    For what is less work than a call from Python into compiled code, see `Handle`.
    """
    if COMPILED:
        part = _Part(function, targetoptions={'nopython': True, 'error_model': 'numpy'})
        _stands_for(function, lambda kind: part)
    return function


def borrowed(value: Any) -> Any:
    """Return ``value``, for a compiled function as a reference to where it lies.

    A NamedTuple of arrays is hundreds of numbers, which compiled functions otherwise hand to each
    other one by one, and numba counts the owners of each array. ``pairs = borrowed(pairs)`` at the
    begin of a function makes one address of it: what is taken out of it is read from there, and
    nothing is counted. A NamedTuple in it becomes a reference, too, so that the functions that are
    called get one. The caller keeps it alive; nothing of it may be returned to Python.
    """
    return value


if COMPILED:
    _ADDRESS = ir.IntType(8).as_pointer()
    _WORD = ir.IntType(64)

    class Reference(numba.types.Type):  # type: ignore[misc]
        """numba's type of a reference to a NamedTuple, which does not change while it is used.

        Attributes:
            target: Type of the NamedTuple.
        """

        def __init__(self, target: Any) -> None:
            """Take the type of the NamedTuple; TypeError: a field cannot be read there."""
            _check_fields(target)
            self.target = target
            digest = hashlib.sha256(target.name.encode()).hexdigest()[:16]
            super().__init__(f'{type(self).__name__}({target.instance_class.__name__}_{digest})')

        @property
        def key(self) -> Any:
            """What makes it equal to another type."""
            return self.target

        @property
        def instance_class(self) -> Any:
            """Class of the NamedTuple."""
            return self.target.instance_class

        @property
        def types(self) -> Any:
            """Types of its fields."""
            return tuple(self.target)

    class HandleType(Reference):
        """numba's type of a `Handle`, whose ``value`` is a reference."""

    @register_model(Reference)
    @register_model(HandleType)
    class _ReferenceModel(models.PrimitiveModel):  # type: ignore[misc]
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, _ADDRESS)

    def _check_fields(target: Any) -> None:
        """Raise TypeError, naming the field, where a value is not what `_words` counts."""
        known = (numba.types.Array, numba.types.Boolean, numba.types.Integer, HandleType,
                 numba.types.NumPyRandomGeneratorType)
        for name, kind in zip(target.fields, target):
            if isinstance(kind, numba.types.BaseNamedTuple):
                _check_fields(kind)
            elif not isinstance(kind, known) and kind != numba.types.float64:
                raise TypeError(f'{target.instance_class.__name__}.{name} is of type {kind}: '
                                'expected a float, an int, a bool, an array, a numpy Generator, '
                                'a Handle or a NamedTuple of such')

    def _words(kind: Any) -> int:
        """Return how many words of 64 bits a value of a type takes where references point to."""
        if isinstance(kind, numba.types.Array):
            return 2 + 2 * int(kind.ndim)  # size, address of the data, shape, strides
        if isinstance(kind, numba.types.BaseNamedTuple):
            return sum(map(_words, kind))
        return 8 if isinstance(kind, numba.types.NumPyRandomGeneratorType) else 1

    def _field(kind: Any, name: str) -> tuple[Any, int]:
        """Return the type of a field of a NamedTuple, and how many words are before it."""
        place = kind.fields.index(name)
        return kind[place], sum(map(_words, tuple(kind)[:place]))

    @infer_getattr
    class _FieldOfReference(AttributeTemplate):  # type: ignore[misc]
        key = Reference

        def generic_resolve(self, kind: Any, name: str) -> Any:
            if isinstance(kind, HandleType):
                return Reference(kind.target) if name == 'value' else None
            if name not in kind.target.fields:
                return None
            field, _ = _field(kind.target, name)
            return Reference(field) if isinstance(field, numba.types.BaseNamedTuple) else field

    @lower_getattr_generic(Reference)
    def _read_field(context: Any, builder: Any, kind: Any, value: Any, name: str) -> Any:
        field, before = _field(kind.target, name)
        words = builder.bitcast(value, _WORD.as_pointer())
        if isinstance(field, numba.types.BaseNamedTuple):
            return builder.bitcast(cgutils.gep_inbounds(builder, words, before), _ADDRESS)
        if isinstance(field, numba.types.Array):
            return _read_array(context, builder, field, words, before)
        result = _read(builder, words, before, context.get_value_type(field))
        if isinstance(field, numba.types.NumPyRandomGeneratorType):  # without its owner
            result = builder.insert_value(result, result.type.elements[1](None), 1)
        return result

    @lower_getattr(HandleType, 'value')
    def _open_handle(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        return value

    def _read(builder: Any, words: Any, place: int, kind: Any = None) -> Any:
        """Load what does not change, so that it may be loaded once for a whole loop."""
        where = cgutils.gep_inbounds(builder, words, place)
        if kind is not None:
            where = builder.bitcast(where, kind.as_pointer())
        loaded = builder.load(where)
        loaded.set_metadata('invariant.load', builder.module.add_metadata([]))
        return loaded

    def _read_array(context: Any, builder: Any, kind: Any, words: Any, first: int) -> Any:
        """Load an array without its owner."""
        array = context.make_array(kind)(context, builder)
        array.meminfo = context.get_constant_null(numba.types.MemInfoPointer(kind.dtype))
        array.parent = context.get_constant_null(numba.types.pyobject)
        array.itemsize = context.get_constant(
            numba.types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
        array.nitems = _read(builder, words, first)
        array.data = _read(builder, words, first + 1,
                           context.get_data_type(kind.dtype).as_pointer())
        numbers = [_read(builder, words, first + 2 + i) for i in range(2 * kind.ndim)]
        array.shape = cgutils.pack_array(builder, numbers[:kind.ndim])
        array.strides = cgutils.pack_array(builder, numbers[kind.ndim:])
        return array._getvalue()

    def _write(context: Any, builder: Any, kind: Any, value: Any, words: Any, first: int) -> None:
        """Put a value where references point to."""
        if isinstance(kind, numba.types.BaseNamedTuple):
            for place, inner in enumerate(kind):
                part = builder.extract_value(value, place)
                _write(context, builder, inner, part, words, first)
                first += _words(inner)
            return
        if not isinstance(kind, numba.types.Array):
            where = cgutils.gep_inbounds(builder, words, first)
            builder.store(value, builder.bitcast(where, value.type.as_pointer()))
            return
        array = context.make_array(kind)(context, builder, value)
        numbers = [array.nitems, builder.ptrtoint(array.data, _WORD),
                   *cgutils.unpack_tuple(builder, array.shape),
                   *cgutils.unpack_tuple(builder, array.strides)]
        for place, number in enumerate(numbers):
            builder.store(number, cgutils.gep_inbounds(builder, words, first + place))

    @infer_global(borrowed)
    class _Borrowing(AbstractTemplate):  # type: ignore[misc]
        def generic(self, arguments: Any, keywords: Any) -> Any:
            kind, = arguments
            named = isinstance(kind, numba.types.BaseNamedTuple)
            return signature(Reference(kind) if named else kind, kind)

    @lower_builtin(borrowed, numba.types.BaseNamedTuple)
    def _borrow_tuple(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Put a tuple into the frame of the function; what is there must not seem to change."""
        kind = signature.args[0]
        words = cgutils.alloca_once(builder, _WORD, _words(kind))
        _write(context, builder, kind, arguments[0], words, 0)
        return builder.asm(ir.FunctionType(_ADDRESS, [_ADDRESS]), '', '=r,0,~{memory}',
                           [builder.bitcast(words, _ADDRESS)], side_effect=True)

    @lower_builtin(borrowed, numba.types.Any)
    def _borrow_reference(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return impl_ret_borrowed(context, builder, signature.return_type, arguments[0])


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


class Handle:
    """A NamedTuple that compiled functions get as one argument; ``value`` is `borrowed` there.

    Each array in an argument costs a call from Python 0.2 µs, whether it is used or not, and who
    takes many of them takes long to compile.

    Attributes:
        value: The NamedTuple.
    """

    def __init__(self, value: Any) -> None:
        """Take the NamedTuple; its arrays are shared, its scalars are those of now."""
        self.value = value
        if COMPILED:
            words: list[int] = []
            key = _pack(value, words)
            if key not in _handle_types:
                _handle_types[key] = HandleType(numba.typeof(value))
            self._numba_type_ = _handle_types[key]
            self._words = np.array(words, dtype=np.uint64)
            self.address = int(self._words.ctypes.data)

    def __reduce__(self) -> Any:
        """Return what a copy or a pickle makes: a handle of the copied tuple."""
        return Handle, (self.value,)


if COMPILED:
    _handle_types: dict[Any, Any] = {}

    def _pack(value: Any, words: list[int]) -> Any:
        """Add the words of a value, and return what tells its type."""
        if isinstance(value, tuple):
            return (type(value), *[_pack(each, words) for each in value])
        if isinstance(value, np.ndarray):
            given, flags = value.__array_interface__, value.flags
            words += (value.size, given['data'][0], *value.shape,
                      *(stride % 2**64 for stride in value.strides))
            return (value.dtype, value.ndim, flags.c_contiguous, flags.f_contiguous,
                    flags.writeable, flags.aligned)
        if isinstance(value, Handle):
            words.append(value.address)
            return value._numba_type_
        if isinstance(value, np.random.Generator):
            words += (0, *_addresses(value), 0, 0)
        elif isinstance(value, (float, np.floating)):
            words += struct.unpack('Q', struct.pack('d', value))
        elif isinstance(value, (int, np.integer, np.bool_)):
            words.append(int(value) % 2**64)
        else:
            words.append(0)  # refused for its type, by name
        return type(value)

    def _addresses(generator: np.random.Generator) -> list[int]:
        """Return what compiled functions call for random numbers, in numba's order."""
        given = generator.bit_generator.ctypes
        functions = (given.next_uint64, given.next_uint32, given.next_double)
        return [given.state_address, given.state.value,
                *(ctypes.cast(each, ctypes.c_void_p).value or 0 for each in functions)]

    @typeof_impl.register(Handle)
    def _type_of_handle(value: Handle, context: Any) -> Any:
        return value._numba_type_

    @unbox(HandleType)
    def _unbox_handle(kind: Any, value: Any, context: Any) -> Any:
        number = context.pyapi.object_getattr_string(value, 'address')
        address = context.pyapi.long_as_voidptr(number)
        context.pyapi.decref(number)
        return NativeValue(address)


def handle(value: Any) -> Handle:
    """Return a `Handle` of a NamedTuple."""
    return Handle(value)


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


@jit
def cos_sin(angle: float) -> tuple[float, float]:
    """Return cosine and sine of an angle [rad]; NaN where it is not finite, with numba or without.

    Python's own raise ValueError for an infinite one.
    """
    if not math.isfinite(angle):
        return math.nan, math.nan
    return math.cos(angle), math.sin(angle)
