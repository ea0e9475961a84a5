# SPDX-License-Identifier: Apache-2.0
"""Vectors and bytes that Python hands to a compiled function without an owner.

numba makes an owner for every array argument and gives it back after the call, 0.05 to 0.1 µs for
each. What `entry_for` returns reads where the numbers lie out of the object itself.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from adaptive_blf_control.compiled.library import COMPILED

if COMPILED:
    from adaptive_blf_control.compiled.library import (
        binding,
        cgutils,
        ir,
        models,
        NativeValue,
        numba,
        register_model,
        unbox,
    )

__all__ = ['argument_kind']

if COMPILED:
    _ADDRESS, _WORD, _INT = ir.IntType(8).as_pointer(), ir.IntType(64), ir.IntType(32)

    # Where an ndarray of numpy's C API has what, in bytes.
    _KIND, _DATA, _DIMENSIONS, _SHAPE, _NUMBERS, _FLAGS = 8, 16, 24, 32, 56, 64
    _COUNT, _CONTENT = 16, 32  # of bytes
    _TYPE = 24  # in the description of its numbers: kind, letter, byte order, flags, number
    _FLOAT64 = int.from_bytes(b'fd=\0' + (12).to_bytes(4, 'little'), 'little')
    _TOLD = 0xFFFFFFFF00FFFFFF  # all but those flags
    _STANDS = 0x101  # contiguous and aligned

    _SYMBOL = 'adaptive_blf_control.ndarray'
    binding.add_symbol(_SYMBOL, id(np.ndarray))

    class BorrowedType(numba.types.Type):  # type: ignore[misc]
        """numba's type of an object of Python that `borrowed` opens.

        Attributes:
            opened: Type of the array that it becomes.
        """

        def __init__(self, name: str, opened: Any) -> None:
            """Name the type."""
            super().__init__(name)
            self.opened = opened

    class VectorType(BorrowedType):
        """That of a contiguous array of float64, shape (k,)."""

        def __init__(self) -> None:
            """There is one such type."""
            super().__init__('Vector', numba.types.Array(numba.types.float64, 1, 'C'))

    class BytesType(BorrowedType):
        """That of bytes."""

        def __init__(self) -> None:
            """There is one such type."""
            super().__init__('BorrowedBytes', numba.types.Array(
                numba.types.uint8, 1, 'C', readonly=True))

    _VECTOR, _BYTES = VectorType(), BytesType()

    @register_model(VectorType)
    @register_model(BytesType)
    class _BorrowedModel(models.PrimitiveModel):  # type: ignore[misc]
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, _ADDRESS)

    def _load(builder: Any, start: Any, place: int, kind: Any) -> Any:
        where = builder.gep(start, [ir.Constant(_WORD, place)])
        return builder.load(builder.bitcast(where, kind.as_pointer()))

    def _is_of(builder: Any, given: Any, symbol: str) -> Any:
        """Whether an object is of a type of Python, no other that inherits from it."""
        known = builder.module.globals.get(symbol)
        if known is None:
            known = cgutils.add_global_variable(builder.module, ir.IntType(8), symbol)
        return builder.icmp_unsigned('==', _load(builder, given, _KIND, _ADDRESS), known)

    def _is_vector(builder: Any, given: Any) -> Any:
        """Whether an ndarray is contiguous, of native float64, and of one dimension."""
        numbers = _load(builder, _load(builder, given, _NUMBERS, _ADDRESS), _TYPE, _WORD)
        flags = _load(builder, given, _FLAGS, _INT)
        checks = ((_load(builder, given, _DIMENSIONS, _INT), _INT(1)),
                  (builder.and_(numbers, _WORD(_TOLD)), _WORD(_FLOAT64)),
                  (builder.and_(flags, _INT(_STANDS)), _INT(_STANDS)))
        first, second, third = (builder.icmp_unsigned('==', *pair) for pair in checks)
        return builder.and_(first, builder.and_(second, third))

    @unbox(VectorType)
    def _unbox_vector(kind: Any, value: Any, context: Any) -> Any:
        builder = context.builder
        given = builder.bitcast(value, _ADDRESS)
        wrong = cgutils.alloca_once_value(builder, cgutils.true_bit)
        with builder.if_then(_is_of(builder, given, _SYMBOL), likely=True):
            builder.store(builder.not_(_is_vector(builder, given)), wrong)
        is_wrong = builder.load(wrong)
        with builder.if_then(is_wrong, likely=False):
            context.pyapi.err_set_string('PyExc_TypeError',
                                         'expected a contiguous array of float64, shape (k,)')
        return NativeValue(given, is_error=is_wrong)

    @unbox(BytesType)
    def _unbox_bytes(kind: Any, value: Any, context: Any) -> Any:
        builder = context.builder
        given = builder.bitcast(value, _ADDRESS)
        is_wrong = builder.not_(_is_of(builder, given, 'PyBytes_Type'))
        with builder.if_then(is_wrong, likely=False):
            context.pyapi.err_set_string('PyExc_TypeError', 'expected bytes')
        return NativeValue(given, is_error=is_wrong)

    def opened(context: Any, builder: Any, kind: Any, given: Any) -> Any:
        """Return an object of a `BorrowedType` as an array without an owner."""
        array = context.make_array(kind.opened)(context, builder)
        array.meminfo = context.get_constant_null(numba.types.MemInfoPointer(kind.opened.dtype))
        array.parent = context.get_constant_null(numba.types.pyobject)
        number = context.get_data_type(kind.opened.dtype)
        array.itemsize = context.get_constant(numba.types.intp, context.get_abi_sizeof(number))
        if isinstance(kind, BytesType):
            array.nitems = _load(builder, given, _COUNT, _WORD)
            array.data = builder.gep(given, [ir.Constant(_WORD, _CONTENT)])
        else:
            array.nitems = _load(builder, _load(builder, given, _SHAPE, _ADDRESS), 0, _WORD)
            array.data = _load(builder, given, _DATA, number.as_pointer())
        array.shape = cgutils.pack_array(builder, [array.nitems])
        array.strides = cgutils.pack_array(builder, [array.itemsize])
        return array._getvalue()

    def _lies_as_expected() -> bool:
        """Whether arrays of this numpy have it where it is looked for."""
        sample, text = np.zeros(3), b'some text'
        at = id(sample)

        def word(place: int, size: Any = ctypes.c_uint64) -> int:
            return int(size.from_address(place).value)

        return (word(at + _KIND) == id(np.ndarray) and word(at + _DATA) == sample.ctypes.data
                and word(at + _DIMENSIONS, ctypes.c_uint32) == 1
                and word(word(at + _SHAPE)) == 3
                and word(at + _NUMBERS) == id(sample.dtype)
                and word(id(sample.dtype) + _TYPE) & _TOLD == _FLOAT64
                and word(at + _FLAGS, ctypes.c_uint32) & _STANDS == _STANDS
                and word(id(text) + _COUNT) == len(text)
                and ctypes.string_at(id(text) + _CONTENT) == text)

    _OPENED = _lies_as_expected()

    def argument_kind(value: Any) -> Any:
        """Return numba's type of an argument of an entry, if possible one to be `borrowed`."""
        kind = numba.typeof(value)
        if not _OPENED:
            return kind
        return (_BYTES if type(value) is bytes else
                _VECTOR if kind == _VECTOR.opened else kind)
