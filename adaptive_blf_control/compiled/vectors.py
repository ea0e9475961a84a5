# SPDX-License-Identifier: Apache-2.0
"""Inner products of contiguous vectors, in four lanes.

A sum that a loop adds up one by one waits for every addition, and a compiler may not change its
order. Here the order is fixed to one that does not wait, so that the sum has the same bits
wherever it is compiled into, and on every processor.
"""

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

__all__ = ['dot']

LANES = 4


def dot(x: np.ndarray, y: np.ndarray, size: int) -> float:
    """Return Σ x_i y_i over the first ``size`` elements of two contiguous vectors.

    Compiled functions add up elements 0, 8, 16 …, 1, 9, 17 … to 7, 15, 23 … apart, then these
    sums, then what is left behind the last whole four.
    """
    return float(np.dot(x[:size], y[:size]))


if COMPILED:
    @infer_global(dot)
    class _Dot(AbstractTemplate):  # type: ignore[misc]
        def generic(self, arguments: Any, keywords: Any) -> Any:
            x, y, size = arguments
            for each in (x, y):
                if not (isinstance(each, numba.types.Array) and each.ndim == 1
                        and each.layout == 'C' and each.dtype == numba.types.float64):
                    return None
            return signature(numba.types.float64, x, y, numba.types.intp)

    @lower_builtin(dot, numba.types.Array, numba.types.Array, numba.types.intp)
    def _lower_dot(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        x, y = (context.make_array(kind)(context, builder, value).data
                for kind, value in zip(signature.args[:2], arguments))
        size = arguments[2]
        word, number = size.type, ir.DoubleType()
        lanes = ir.VectorType(number, LANES)

        def product(first: Any, kind: Any) -> Any:
            factors = []
            for data in (x, y):
                where = builder.gep(data, [first], inbounds=True)
                loaded = builder.load(builder.bitcast(where, kind.as_pointer()))
                loaded.align = 8
                factors.append(loaded)
            return builder.fmul(*factors)

        def add_to(total: Any, first: Any, kind: Any = lanes) -> None:
            builder.store(builder.fadd(builder.load(total), product(first, kind)), total)

        even, odd = (cgutils.alloca_once_value(builder, ir.Constant(lanes, [0.0] * LANES))
                     for _ in range(2))
        pairs = builder.and_(size, word(-2 * LANES))
        with cgutils.for_range_slice(builder, word(0), pairs, word(2 * LANES), word) as (i, _):
            add_to(even, i)
            add_to(odd, builder.add(i, word(LANES)))
        whole = builder.and_(size, word(-LANES))
        with builder.if_then(builder.icmp_signed('<', pairs, whole)):
            add_to(even, pairs)
        sums = builder.fadd(builder.load(even), builder.load(odd))
        a, b, c, d = (builder.extract_element(sums, ir.IntType(32)(k)) for k in range(LANES))
        total = cgutils.alloca_once_value(
            builder, builder.fadd(builder.fadd(a, c), builder.fadd(b, d)))
        with cgutils.for_range_slice(builder, whole, size, word(1), word) as (i, _):
            add_to(total, i, number)
        return builder.load(total)
