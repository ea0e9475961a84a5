# SPDX-License-Identifier: Apache-2.0
"""NamedTuples of arrays that compiled functions get by reference, without counting owners."""

from __future__ import annotations

import ctypes
import hashlib
import struct
from typing import Any

import numpy as np

from adaptive_blf_control.compiled.library import COMPILED

if COMPILED:
    from adaptive_blf_control.compiled.library import (
        AbstractTemplate,
        AttributeTemplate,
        cgutils,
        impl_ret_borrowed,
        infer_getattr,
        infer_global,
        ir,
        lower_builtin,
        lower_getattr,
        lower_getattr_generic,
        models,
        NativeValue,
        numba,
        register_model,
        signature,
        typeof_impl,
        unbox,
    )
    from adaptive_blf_control.compiled.vector_arguments import BorrowedType, opened

__all__ = ['borrowed', 'Handle', 'handle']


def borrowed(value: Any) -> Any:
    """Return ``value``, for a compiled function as a reference to where it lies.

    A NamedTuple of arrays is hundreds of numbers, which compiled functions otherwise hand to each
    other one by one, and numba counts the owners of each array. ``pairs = borrowed(pairs)`` at the
    begin of a function makes one address of it: what is taken out of it is read from there, and
    nothing is counted. A NamedTuple in it becomes a reference, too, so that the functions that are
    called get one. The caller keeps it alive; nothing of it may be returned to Python.

    So it is with a vector, or bytes, that Python hands to what `entry_for` returns.
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
            if isinstance(kind, BorrowedType):
                return signature(kind.opened, kind)
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

    @lower_builtin(borrowed, BorrowedType)
    def _borrow_object(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return opened(context, builder, signature.args[0], arguments[0])

    @lower_builtin(borrowed, numba.types.Any)
    def _borrow_reference(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return impl_ret_borrowed(context, builder, signature.return_type, arguments[0])


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
