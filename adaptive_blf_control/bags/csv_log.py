# SPDX-License-Identifier: Apache-2.0
"""Rows of a measured log in a CSV file, read in one pass."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence
import csv
import math
from pathlib import Path
import re

import numpy as np

from adaptive_blf_control.bags.csv_format import CsvFile, number_of, open_csv, opened
from adaptive_blf_control.bags.log_columns import Columns, find_columns
from adaptive_blf_control.bags.raw_log import RawLog
from adaptive_blf_control.bags.row_store import RowStore
from adaptive_blf_control.bags.written_times import nanoseconds_of
from adaptive_blf_control.errors import LogError
from adaptive_blf_control.time_units import epoch_unit, period_unit, UNITS

__all__ = ['csv_log', 'raw_log']

_DEGREES = re.compile(r'.*[\[(<]\s*(?:°|deg(?:rees?)?)\s*(?:/\s*s\w*)?\s*[\])>]\s*'
                      r'|.*_deg(?:rees?)?(?:_?(?:per_?)?s(?:ec)?)?(?:_.*)?', re.IGNORECASE)
_SHOWN = 12  # names of columns in a message
_CELL = 40  # letters of a cell in a message
_FIRST = 2000  # rows that tell the unit of the time


def csv_log(path: Path, joints: Sequence[str] | None, *, velocity: bool,
            columns: Mapping[str, str] | None) -> RawLog:
    """Read a CSV file; see `read_log`.

    Raises:
        LogError: names the file, and row and column.
    """
    try:
        with opened(path) as stream:
            return _read(path, open_csv(path, stream), joints, velocity, columns)
    except (OSError, UnicodeError, csv.Error) as exc:
        raise LogError(f'{path}: cannot be read: {exc}') from exc


def _read(path: Path, file: CsvFile, joints: Sequence[str] | None, velocity: bool,
          given: Mapping[str, str] | None) -> RawLog:
    first = next(file.rows, None)
    header = file.header
    if not header and first and given:  # numbers alone, and --columns that counts them
        header = tuple(str(i + 1) for i in range(len(first[1])))
    try:
        found = find_columns(header, joints, velocity=velocity, given=given)
    except LogError as exc:
        where = f'row {file.line}' if header or not first else 'no header'
        raise LogError(f'{path}: {where}: {exc}' + _columns_shown(header)) from exc
    places = [*found.time, *(i for kind in ('q', 'qd', 'tau') for i in found.values[kind])]
    store, clock, problem = RowStore(len(places) - len(found.time)), array('d'), None
    rows = _with_last(file.rows if first is None else _again(first, file.rows))
    if first is not None and _time_in_words(first[1], found):
        rows, found = _in_nanoseconds(rows, found.time[0]), found._replace(unit='ns')
    origin: int | None = None
    for number, row, is_last in rows:
        try:
            values = _numbers(path, header, row, places, number)
            origin, time = _time_of(row, found, values, origin)
        except LogError as exc:
            if not is_last:
                raise
            problem = f'{exc}: the last row is left out'
            break
        clock.append(time)
        store.append(values[len(found.time):])
    table = store.table()
    return raw_log(found, header, np.frombuffer(clock) if clock else np.empty(0), table,
                   origin or 0, problem)


def _columns_shown(header: Sequence[str]) -> str:
    names = [repr(name[:40]) for name in header[:_SHOWN]]
    more = [f'{len(header) - _SHOWN} more'] if len(header) > _SHOWN else []
    return f'; the columns are {", ".join([*names, *more])}' if names else ''


def _again(first: tuple[int, list[str]], rows: Iterator[tuple[int, list[str]]]
           ) -> Iterator[tuple[int, list[str]]]:
    yield first
    yield from rows


def _time_in_words(row: list[str], found: Columns) -> bool:
    return (len(found.time) == 1 and found.time[0] < len(row)
            and nanoseconds_of(row[found.time[0]]) is not None)


def _in_nanoseconds(rows: Iterator[tuple[int, list[str], bool]], place: int
                    ) -> Iterator[tuple[int, list[str], bool]]:
    """Yield rows with the time in a column that has words as a whole number [ns]."""
    for number, row, is_last in rows:
        if place < len(row) and (time := nanoseconds_of(row[place])) is not None:
            row = [*row[:place], str(time), *row[place + 1:]]
        yield number, row, is_last


def _with_last(rows: Iterator[tuple[int, list[str]]]
               ) -> Iterator[tuple[int, list[str], bool]]:
    """Yield line number, cells and whether the row is the last of the file."""
    before = next(rows, None)
    while before is not None:
        following = next(rows, None)
        yield *before, following is None
        before = following


def _numbers(path: Path, header: Sequence[str], row: list[str], places: Sequence[int],
             line: int) -> list[float]:
    """Return the numbers of a row; NaN for an empty cell."""
    if len(row) != len(header) and any(row[len(header):] or [len(row) < len(header)]):
        raise LogError(f'{path}: row {line} has {len(row)} cells: expected {len(header)}')
    try:
        return [float(row[i]) for i in places]
    except ValueError:  # empty, with a decimal comma, or no number
        pass
    numbers = []
    for i in places:
        try:
            numbers.append(number_of(row[i]))
        except ValueError as exc:
            raise LogError(f'{path}: row {line}, column {header[i]!r}: {row[i][:_CELL]!r} is '
                           'not a number') from exc
    return numbers


def _time_of(row: list[str], found: Columns, values: list[float], origin: int | None
             ) -> tuple[int | None, float]:
    """Return the time of a row after ``origin``, the time of the first row if that is whole.

    Nanoseconds since 1970 do not fit a double, so whole numbers are subtracted as integers.
    """
    if len(found.time) == 2:
        seconds, nanoseconds = values[:2]
        if origin is None and math.isfinite(seconds):
            origin = int(seconds)
        return origin, seconds - (origin or 0) + 1e-9 * nanoseconds
    text = row[found.time[0]].strip()
    if origin is None and math.isfinite(values[0]):
        origin = int(text) if text.isdecimal() else 0
    return origin, float(int(text) - origin) if origin and text.isdecimal() else (
        values[0] - (origin or 0))


def raw_log(found: Columns, header: Sequence[str], clock: np.ndarray, table: np.ndarray,
            origin: int, problem: str | None) -> RawLog:
    """Return what columns hold as a log, in s and rad where their names or values tell the unit.

    Args:
        found: Where the values are.
        header: Names of the columns.
        clock: Times after ``origin``, shape (N,).
        table: Positions, velocities and torques side by side, shape (N, 3 n) or (N, 2 n); those
            in degrees are converted in place.
        origin: Time that was taken off the clock.
        problem: Why the source ends early, or None.
    """
    n = len(found.values['q'])
    notes = list(found.notes)
    start = next((value for value in clock[:_FIRST] if math.isfinite(value)), 0.0) + origin
    unit = found.unit or epoch_unit(start)
    if unit is None:
        head = table[:_FIRST][np.isfinite(table[:_FIRST]).all(axis=1)
                              & np.isfinite(clock[:_FIRST])]
        times = clock[:_FIRST][np.isfinite(table[:_FIRST]).all(axis=1)
                               & np.isfinite(clock[:_FIRST])]
        unit, reason = period_unit(times, head[:, :n],
                                   head[:, n:2 * n] if found.values['qd'] else None)
        if reason:
            notes.append(f'the time is taken to be in {unit}: {reason}')
    for kind, part in (('q', slice(0, n)), ('qd', slice(n, 2 * n))):
        if found.values[kind] and all(_DEGREES.fullmatch(header[i]) for i in found.values[kind]):
            table[:, part] *= np.pi / 180.0
            notes.append(f'{kind} is converted from degrees, as its columns say')
    return RawLog(found.joints, clock, UNITS[unit], table, n, bool(found.values['qd']), 0,
                  tuple(notes), problem)
