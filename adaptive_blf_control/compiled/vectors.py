# SPDX-License-Identifier: Apache-2.0
"""Sums and products of contiguous vectors, in lanes.

A sum that a loop adds up one by one waits for every addition, and a compiler may not change its
order. Here the order is fixed to one that does not wait, so that the sum has the same bits
wherever it is compiled into, and on every processor. Where a loop changes several arrays, a
compiler does not know that they do not overlap, and takes one element at a time; here they do not.
"""

from __future__ import annotations

from collections.abc import Callable
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

__all__ = ['add_multiple', 'dot', 'fold_row']

LANES = 4


def dot(x: np.ndarray, y: np.ndarray, size: int) -> float:
    """Return Σ x_i y_i over the first ``size`` elements of two contiguous vectors.

    Products 0, 8, 16 …, 1, 9, 17 … to 7, 15, 23 … are added up apart, the last whole four to the
    first four of these sums; then the sums, then what is left.
    """
    pairs, whole, products = size - size % (2 * LANES), size - size % LANES, x[:size] * y[:size]
    lanes = np.add.reduce(products[:pairs].reshape(-1, 2 * LANES))
    even, odd = lanes[:LANES], lanes[LANES:]
    if pairs < whole:
        even = even + products[pairs:whole]
    a, b, c, d = even + odd
    total = (a + c) + (b + d)
    for product in products[whole:]:
        total += product
    return float(total)


def add_multiple(target: np.ndarray, factor: float, x: np.ndarray, size: int) -> None:
    """Add ``factor`` times the first ``size`` elements of x to those of another vector."""
    target[:size] += factor * x[:size]


def fold_row(row: np.ndarray, a: float, w: np.ndarray, b: float, v: np.ndarray, total: np.ndarray,
             c: float, size: int) -> None:
    """Subtract a w + b v from the first ``size`` elements of a row, and add c row to ``total``."""
    row[:size] -= a * w[:size] + b * v[:size]
    total[:size] += c * row[:size]


if COMPILED:
    _WORD, _NUMBER = ir.IntType(64), ir.DoubleType()
    _LANES = ir.VectorType(_NUMBER, LANES)
    _ARRAY, _FLOAT, _SIZE = numba.types.Array, numba.types.float64, numba.types.intp

    class _OfVectors(AbstractTemplate):  # type: ignore[misc]
        """Types of a function of contiguous vectors and numbers, the last one their size."""

        result = numba.types.none

        def generic(self, arguments: Any, keywords: Any) -> Any:
            arrays = [each for each in arguments if isinstance(each, numba.types.Array)]
            if any((each.ndim, each.layout, each.dtype) != (1, 'C', _FLOAT) for each in arrays):
                return None
            *others, _ = arguments
            return signature(self.result, *(each if each in arrays else _FLOAT
                                            for each in others), _SIZE)

    @infer_global(dot)
    class _Dot(_OfVectors):
        result = numba.types.float64

    @infer_global(add_multiple)
    class _AddMultiple(_OfVectors):
        pass

    @infer_global(fold_row)
    class _FoldRow(_OfVectors):
        pass

    def _data(context: Any, builder: Any, signature: Any, arguments: Any) -> list[Any]:
        """Return arguments with the addresses of their first elements in place of arrays."""
        return [context.make_array(kind)(context, builder, value).data
                if isinstance(kind, numba.types.Array) else value
                for kind, value in zip(signature.args, arguments)]

    def _place(builder: Any, data: Any, first: Any, kind: Any) -> Any:
        where = builder.gep(data, [first], inbounds=True)
        return builder.bitcast(where, kind.as_pointer())

    def _load(builder: Any, data: Any, first: Any, kind: Any) -> Any:
        loaded = builder.load(_place(builder, data, first, kind))
        loaded.align = 8
        return loaded

    def _add_to(builder: Any, data: Any, first: Any, kind: Any, value: Any,
                subtract: bool = False) -> Any:
        """Add to elements, and return the sums."""
        before = _load(builder, data, first, kind)
        after = builder.fsub(before, value) if subtract else builder.fadd(before, value)
        builder.store(after, _place(builder, data, first, kind)).align = 8
        return after

    def _times(builder: Any, factor: Any, value: Any) -> Any:
        """Return the product of a number and a number or lanes."""
        if value.type == _LANES:
            one = builder.insert_element(ir.Constant(_LANES, ir.Undefined), factor,
                                         ir.IntType(32)(0))
            factor = builder.shuffle_vector(one, ir.Constant(_LANES, ir.Undefined), ir.Constant(
                ir.VectorType(ir.IntType(32), LANES), [0] * LANES))
        return builder.fmul(factor, value)

    def _whole(builder: Any, size: Any, lanes: int) -> Any:
        """Return the largest multiple of a power of two up to ``size``."""
        return builder.and_(size, _WORD(-lanes))

    def _for_each(builder: Any, size: Any, change: Callable[[Any, Any], None]) -> None:
        """Change elements, four at a time, then the rest one by one."""
        whole = _whole(builder, size, LANES)
        for begin, end, step, kind in ((_WORD(0), whole, LANES, _LANES),
                                       (whole, size, 1, _NUMBER)):
            with cgutils.for_range_slice(builder, begin, end, _WORD(step), _WORD) as (i, _):
                change(i, kind)

    @lower_builtin(add_multiple, _ARRAY, _FLOAT, _ARRAY, _SIZE)
    def _lower_add_multiple(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        target, factor, x, size = _data(context, builder, signature, arguments)

        def change(i: Any, kind: Any) -> None:
            _add_to(builder, target, i, kind,
                    _times(builder, factor, _load(builder, x, i, kind)))

        _for_each(builder, size, change)
        return context.get_dummy_value()

    @lower_builtin(fold_row, _ARRAY, _FLOAT, _ARRAY, _FLOAT, _ARRAY, _ARRAY, _FLOAT, _SIZE)
    def _lower_fold_row(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        row, a, w, b, v, total, c, size = _data(context, builder, signature, arguments)

        def change(i: Any, kind: Any) -> None:
            both = builder.fadd(_times(builder, a, _load(builder, w, i, kind)),
                                _times(builder, b, _load(builder, v, i, kind)))
            folded = _add_to(builder, row, i, kind, both, subtract=True)
            _add_to(builder, total, i, kind, _times(builder, c, folded))

        _for_each(builder, size, change)
        return context.get_dummy_value()

    @lower_builtin(dot, _ARRAY, _ARRAY, _SIZE)
    def _lower_dot(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        x, y, size = _data(context, builder, signature, arguments)

        def add_to(total: Any, first: Any, kind: Any = _LANES) -> None:
            product = builder.fmul(_load(builder, x, first, kind), _load(builder, y, first, kind))
            builder.store(builder.fadd(builder.load(total), product), total)

        even, odd = (cgutils.alloca_once_value(builder, ir.Constant(_LANES, [0.0] * LANES))
                     for _ in range(2))
        pairs, whole = _whole(builder, size, 2 * LANES), _whole(builder, size, LANES)
        with cgutils.for_range_slice(builder, _WORD(0), pairs, _WORD(2 * LANES), _WORD) as (i, _):
            add_to(even, i)
            add_to(odd, builder.add(i, _WORD(LANES)))
        with builder.if_then(builder.icmp_signed('<', pairs, whole)):
            add_to(even, pairs)
        sums = builder.fadd(builder.load(even), builder.load(odd))
        a, b, c, d = (builder.extract_element(sums, ir.IntType(32)(k)) for k in range(LANES))
        total = cgutils.alloca_once_value(
            builder, builder.fadd(builder.fadd(a, c), builder.fadd(b, d)))
        with cgutils.for_range_slice(builder, whole, size, _WORD(1), _WORD) as (i, _):
            add_to(total, i, _NUMBER)
        return builder.load(total)
