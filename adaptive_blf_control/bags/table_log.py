# SPDX-License-Identifier: Apache-2.0
"""Rows of a measured log in a table of named columns: a data frame, a structured array, a mapping.

Columns are recognised as those of a CSV file are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from adaptive_blf_control.arrays import check_unmasked
from adaptive_blf_control.bags.csv_log import raw_log
from adaptive_blf_control.bags.log_columns import find_columns
from adaptive_blf_control.bags.raw_log import RawLog
from adaptive_blf_control.bags.written_times import nanoseconds_of
from adaptive_blf_control.errors import LogError, ParameterError

__all__ = ['DataFrame', 'columns_of', 'is_table', 'table_log']


class DataFrame(Protocol):
    """A table of pandas, polars or their like."""

    @property
    def columns(self) -> Any:
        """Names of the columns."""
        ...

    def __getitem__(self, name: Any, /) -> Any:
        """Return a column."""
        ...


def columns_of(source: Any) -> Mapping[str, Any] | None:
    """Return the columns of a data frame or a structured array by name; None for anything else."""
    if isinstance(source, np.ndarray):
        return {name: source[name] for name in source.dtype.names or ()} or None
    names = getattr(source, 'columns', None)
    if names is None or isinstance(source, type) or not hasattr(source, '__getitem__'):
        return None
    found = {_flat(name): np.asanyarray(source[name]) for name in names}
    index = getattr(source, 'index', None)  # where pandas has what was made the index
    name = getattr(index, 'name', None)
    return found if name is None else {str(name): np.asarray(index), **found}


def _flat(name: Any) -> str:
    """Return the name of a column, of one on several levels in one word: ``q_joint1``."""
    levels = name if isinstance(name, tuple) else (name,)
    return '_'.join(str(level) for level in levels if level != '')


def is_table(columns: Mapping[str, Any]) -> bool:
    """Return whether every value is a column: one number for each of the same rows."""
    try:
        shapes = {np.shape(column) for column in columns.values()}
    except (TypeError, ValueError):  # rows of different lengths
        return False
    return len(shapes) == 1 and len(shapes.pop()) == 1


def table_log(source: str, columns: Mapping[str, Any], joints: Sequence[str] | None, *,
              velocity: bool, given: Mapping[str, str] | None) -> RawLog:
    """Read the columns of a table; see `read_log`.

    Args:
        source: What messages call the table.
        columns: Columns of N rows by name.
        joints: Joints of the arm, or None.
        velocity: Whether velocities are needed.
        given: Names of columns by kind; others are recognised.

    Raises:
        LogError: names the column.
    """
    header = tuple(map(str, columns))
    try:
        found = find_columns(header, joints, velocity=velocity, given=given)
    except LogError as exc:
        raise LogError(f'{source}: {exc}') from exc
    rows = list(columns.values())
    try:
        for i in (*found.time, *(i for each in found.values.values() for i in each)):
            check_unmasked(header[i], rows[i])
    except ParameterError as exc:
        raise LogError(f'{source}: {exc}') from exc
    times = [_times(source, header[i], rows[i]) for i in found.time]
    origin = int(times[0][0]) if times[0].dtype.kind == 'i' and times[0].size else 0
    clock = (times[0] - origin).astype(float)
    if len(times) == 2:  # seconds and nanoseconds
        clock = clock + 1e-9 * times[1]
    table = np.column_stack([_numbers(source, header[i], rows[i])
                             for kind in ('q', 'qd', 'tau') for i in found.values[kind]])
    return raw_log(found, header, clock, table, origin, None)


def _times(source: str, name: str, column: Any) -> np.ndarray:
    """Return times; those of dates and in words as whole nanoseconds."""
    given = np.asarray(column)
    if given.dtype.kind == 'M':
        return given.astype('datetime64[ns]').astype(np.int64)
    if given.dtype.kind in 'iu':
        return given.astype(np.int64)
    if given.dtype.kind in 'OUT' and len(given) and isinstance(given[0], str):
        in_words = [nanoseconds_of(str(each)) for each in given]
        if None not in in_words:
            return np.array(in_words, dtype=np.int64)
    return _numbers(source, name, given)


def _numbers(source: str, name: str, column: Any) -> np.ndarray:
    try:
        return np.asarray(column).astype(float)
    except (TypeError, ValueError):
        raise LogError(f'{source}: column {name!r} holds something else than numbers') from None
