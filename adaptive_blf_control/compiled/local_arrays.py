# SPDX-License-Identifier: Apache-2.0
"""Arrays that only one call of a compiled function needs."""

from __future__ import annotations

from typing import Any

import numpy as np

from adaptive_blf_control.compiled.library import COMPILED

if COMPILED:
    from adaptive_blf_control.compiled.library import (
        AbstractTemplate,
        cgutils,
        infer_global,
        ir,
        lower_builtin,
        numba,
        signature,
    )

__all__ = ['local_zeros']


def local_zeros(shape: int | tuple[int, ...]) -> Any:
    """Return an array of zeros, which in a compiled function lies on its stack.

    Nothing is allocated, and no owners are counted: both cost as much as the arithmetic on small
    arrays. It is gone when the function returns, so neither the array nor a part of it may be
    returned or kept; what other functions write into is passed to them. Nor is it made in a
    loop, where the stack would grow with each pass. It has to be small, some kB.

    Args:
        shape: Of the array; a number for a vector.
    """
    return np.zeros(shape)


if COMPILED:
    _FLOAT, _COUNT = numba.types.float64, numba.types.intp

    @infer_global(local_zeros)
    class _LocalZeros(AbstractTemplate):  # type: ignore[misc]
        def generic(self, arguments: Any, keywords: Any) -> Any:
            shape, = arguments
            counts = tuple(shape) if isinstance(shape, numba.types.BaseTuple) else (shape,)
            if not all(isinstance(each, numba.types.Integer) for each in counts):
                return None
            wanted = numba.types.UniTuple(_COUNT, len(counts))
            return signature(numba.types.Array(_FLOAT, len(counts), 'C'),
                             wanted if isinstance(shape, numba.types.BaseTuple) else _COUNT)

    @lower_builtin(local_zeros, numba.types.Any)
    def _lower_local_zeros(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind, word = signature.return_type, ir.IntType(64)
        counts = cgutils.unpack_tuple(builder, arguments[0]) if kind.ndim > 1 or isinstance(
            signature.args[0], numba.types.BaseTuple) else [arguments[0]]
        strides: list[Any] = []
        size: Any = word(8)
        for count in reversed(counts):
            strides.insert(0, size)
            size = builder.mul(size, count)
        data = builder.alloca(ir.IntType(8), size=size)
        data.align = 64
        cgutils.memset(builder, data, size, 0)
        array = context.make_array(kind)(context, builder)
        number = context.get_data_type(_FLOAT)
        array.meminfo = context.get_constant_null(numba.types.MemInfoPointer(_FLOAT))
        array.parent = context.get_constant_null(numba.types.pyobject)
        array.itemsize = word(8)
        array.nitems = builder.sdiv(size, word(8))
        array.data = builder.bitcast(data, number.as_pointer())
        array.shape = cgutils.pack_array(builder, counts)
        array.strides = cgutils.pack_array(builder, strides)
        return array._getvalue()
