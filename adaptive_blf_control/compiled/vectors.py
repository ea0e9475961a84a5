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

__all__ = ['add_four', 'add_multiple', 'combine_rows', 'dot', 'fold_row']

LANES = 4  # of which a sum of products has twice as many
WIDTHS = 2 * LANES, LANES, 1  # elements that are changed at once, as long as so many are left


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


def add_four(target: np.ndarray, a: float, w: np.ndarray, b: float, x: np.ndarray, c: float,
             y: np.ndarray, d: float, z: np.ndarray, size: int) -> None:
    """Add (a w + b x) + (c y + d z) to the first ``size`` elements of a vector."""
    target[:size] += (a * w[:size] + b * x[:size]) + (c * y[:size] + d * z[:size])


def combine_rows(result: np.ndarray, matrix: np.ndarray, x: np.ndarray, size: int) -> None:
    """Set ``result`` to Aᵀ x for the first ``size`` rows and columns of A, four rows at a time."""
    result[:size] = 0.0
    for i in range(0, size - size % 4, 4):
        add_four(result, x[i], matrix[i], x[i + 1], matrix[i + 1], x[i + 2], matrix[i + 2],
                 x[i + 3], matrix[i + 3], size)
    for i in range(size - size % 4, size):
        add_multiple(result, x[i], matrix[i], size)


def fold_row(row: np.ndarray, a: float, w: np.ndarray, b: float, v: np.ndarray, total: np.ndarray,
             c: float, size: int) -> None:
    """Subtract a w + b v from the first ``size`` elements of a row, and add c row to ``total``."""
    row[:size] -= a * w[:size] + b * v[:size]
    total[:size] += c * row[:size]


if COMPILED:
    _WORD, _NUMBER = ir.IntType(64), ir.DoubleType()
    _ARRAY, _FLOAT, _SIZE = numba.types.Array, numba.types.float64, numba.types.intp

    class _OfVectors(AbstractTemplate):  # type: ignore[misc]
        """Types of a function of contiguous vectors and numbers, the last one their size.

        Attributes:
            result: Type of what it returns.
            matrix: Place among the arguments of a matrix, −1 for none.
        """

        result = numba.types.none
        matrix = -1

        def generic(self, arguments: Any, keywords: Any) -> Any:
            kinds = []
            for place, each in enumerate(arguments[:-1]):
                dimensions = 2 if place == self.matrix else 1
                if not isinstance(each, numba.types.Array):
                    kinds.append(_FLOAT)
                elif (each.ndim, each.layout, each.dtype) == (dimensions, 'C', _FLOAT):
                    kinds.append(each)
                else:
                    return None
            return signature(self.result, *kinds, _SIZE)

    @infer_global(dot)
    class _Dot(_OfVectors):
        result = numba.types.float64

    @infer_global(add_multiple)
    class _AddMultiple(_OfVectors):
        pass

    @infer_global(fold_row)
    class _FoldRow(_OfVectors):
        pass

    @infer_global(add_four)
    class _AddFour(_OfVectors):
        pass

    @infer_global(combine_rows)
    class _CombineRows(_OfVectors):
        matrix = 1

    def _data(context: Any, builder: Any, signature: Any, arguments: Any) -> list[Any]:
        """Return arguments with the addresses of their first elements in place of arrays."""
        return [context.make_array(kind)(context, builder, value).data
                if isinstance(kind, numba.types.Array) else value
                for kind, value in zip(signature.args, arguments)]

    def _kind(lanes: int) -> Any:
        return ir.VectorType(_NUMBER, lanes) if lanes > 1 else _NUMBER

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
        if value.type != _NUMBER:
            nothing = ir.Constant(value.type, ir.Undefined)
            one = builder.insert_element(nothing, factor, ir.IntType(32)(0))
            factor = builder.shuffle_vector(one, nothing, _places([0] * value.type.count))
        return builder.fmul(factor, value)

    def _places(numbers: list[int]) -> Any:
        return ir.Constant(ir.VectorType(ir.IntType(32), len(numbers)), numbers)

    def _two_pairs(builder: Any, factors: list[Any], values: list[Any]) -> Any:
        """Return (a w + b x) + (c y + d z)."""
        a, b, c, d = (_times(builder, *each) for each in zip(factors, values))
        return builder.fadd(builder.fadd(a, b), builder.fadd(c, d))

    def _whole(builder: Any, size: Any, lanes: int) -> Any:
        """Return the largest multiple of a power of two up to ``size``."""
        return builder.and_(size, _WORD(-lanes))

    def _for_each(builder: Any, size: Any, change: Callable[[Any, Any], None],
                  widths: tuple[int, ...] = WIDTHS) -> None:
        """Change elements, as many at a time as there are in the first width, then in the next."""
        begin = _WORD(0)
        for width in widths:
            end = _whole(builder, size, width)
            with cgutils.for_range_slice(builder, begin, end, _WORD(width), _WORD) as (i, _):
                change(i, _kind(width))
            begin = end

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

    @lower_builtin(add_four, _ARRAY, *(_FLOAT, _ARRAY) * 4, _SIZE)
    def _lower_add_four(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        target, a, w, b, x, c, y, d, z, size = _data(context, builder, signature, arguments)

        def change(i: Any, kind: Any) -> None:
            values = [_load(builder, each, i, kind) for each in (w, x, y, z)]
            _add_to(builder, target, i, kind, _two_pairs(builder, [a, b, c, d], values))

        _for_each(builder, size, change)
        return context.get_dummy_value()

    @lower_builtin(combine_rows, _ARRAY, _ARRAY, _ARRAY, _SIZE)
    def _lower_combine_rows(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        result, matrix, x, size = _data(context, builder, signature, arguments)
        _, columns = cgutils.unpack_tuple(builder, context.make_array(signature.args[1])(
            context, builder, arguments[1]).shape)
        fours = _whole(builder, size, 4)

        def change(k: Any, kind: Any) -> None:
            """Keep the elements that are added to where no other is changed, for all rows."""
            total = cgutils.alloca_once_value(builder, ir.Constant(
                kind, 0.0 if kind == _NUMBER else [0.0] * kind.count))

            def pair(i: Any) -> tuple[Any, Any]:
                first = builder.add(builder.mul(i, columns), k)
                return _load(builder, x, i, _NUMBER), _load(builder, matrix, first, kind)

            def add(value: Any) -> None:
                builder.store(builder.fadd(builder.load(total), value), total)

            with cgutils.for_range_slice(builder, _WORD(0), fours, _WORD(4), _WORD) as (i, _):
                pairs = [pair(builder.add(i, _WORD(row))) for row in range(4)]
                add(_two_pairs(builder, *map(list, zip(*pairs))))
            with cgutils.for_range_slice(builder, fours, size, _WORD(1), _WORD) as (i, _):
                add(_times(builder, *pair(i)))
            builder.store(builder.load(total), _place(builder, result, k, kind)).align = 8

        _for_each(builder, size, change, (2 * WIDTHS[0], *WIDTHS))
        return context.get_dummy_value()

    @lower_builtin(dot, _ARRAY, _ARRAY, _SIZE)
    def _lower_dot(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        x, y, size = _data(context, builder, signature, arguments)
        wide = _kind(2 * LANES)

        def add_to(total: Any, first: Any, kind: Any) -> Any:
            product = builder.fmul(_load(builder, x, first, kind), _load(builder, y, first, kind))
            builder.store(builder.fadd(builder.load(total), product), total)

        lanes = cgutils.alloca_once_value(builder, ir.Constant(wide, [0.0] * 2 * LANES))
        pairs, whole = _whole(builder, size, 2 * LANES), _whole(builder, size, LANES)
        with cgutils.for_range_slice(builder, _WORD(0), pairs, _WORD(2 * LANES), _WORD) as (i, _):
            add_to(lanes, i, wide)
        even, odd = (builder.shuffle_vector(builder.load(lanes), ir.Constant(wide, ir.Undefined),
                                            _places(list(range(first, first + LANES))))
                     for first in (0, LANES))
        even = cgutils.alloca_once_value(builder, even)
        with builder.if_then(builder.icmp_signed('<', pairs, whole)):
            add_to(even, pairs, _kind(LANES))
        sums = builder.fadd(builder.load(even), odd)
        a, b, c, d = (builder.extract_element(sums, ir.IntType(32)(k)) for k in range(LANES))
        total = cgutils.alloca_once_value(
            builder, builder.fadd(builder.fadd(a, c), builder.fadd(b, d)))
        with cgutils.for_range_slice(builder, whole, size, _WORD(1), _WORD) as (i, _):
            add_to(total, i, _NUMBER)
        return builder.load(total)
