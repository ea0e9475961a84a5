# SPDX-License-Identifier: Apache-2.0
"""How a file of comma-separated values is written: encoding, separator, decimal comma, header.

The standard library's ``csv`` splits the rows. Its ``Sniffer`` takes decimal commas and digits for
separators, and libraries that guess better (pandas, clevercsv) read whole files into memory or
know neither decimal commas nor cut last lines: little is left to guess where columns are numbers.
"""

from __future__ import annotations

import codecs
from collections.abc import Iterator
import csv
from functools import partial
from itertools import chain, islice, pairwise, takewhile
from pathlib import Path
import re
from typing import NamedTuple, TextIO

from adaptive_blf_control.bags.written_times import nanoseconds_of
from adaptive_blf_control.errors import GIT_LFS_POINTER, LogError

__all__ = ['CsvFile', 'is_number', 'number_of', 'open_csv', 'opened']

# Those of UTF-32 first: the one of little endian begins with that of UTF-16.
_BOMS = ((codecs.BOM_UTF32_LE, 'utf-32'), (codecs.BOM_UTF32_BE, 'utf-32'),
         (codecs.BOM_UTF8, 'utf-8-sig'), (codecs.BOM_UTF16_LE, 'utf-16'),
         (codecs.BOM_UTF16_BE, 'utf-16'))
# Which of four bytes are zero in a text of the Latin alphabet.
_ZEROS: dict[tuple[bool, ...], str] = {
    (False, True, True, True): 'utf-32-le',
    (True, True, True, False): 'utf-32-be'}
_SEPARATORS = (';', '\t', '|', ',')  # a comma may also be inside of numbers
_EXPECTED = 'a header t,q1..,qd1..,tau1.. and rows below it'
_COMMENTS = ('#', '%')
_PREAMBLE = 1000  # lines of text that may stand before the header
_MISSING = ('', 'nan', '-nan', 'nan(ind)', '-nan(ind)', '1.#qnan', '-1.#qnan', '1.#ind', '-1.#ind',
            '1.#inf', '-1.#inf', 'null', 'none', 'n/a', '#n/a', 'na', '#num!', '#value!',
            '#div/0!', '-', '--')
_DECIMAL = re.compile(r'[-+]?\d+[.,]\d')


class CsvFile(NamedTuple):
    """A file that is open at its first row of numbers.

    Attributes:
        header: Cells of the header; () where there is none.
        line: Number of the line of the header, from 1 on.
        rows: Line number and cells of each row that is neither empty nor a comment.
    """

    header: tuple[str, ...]
    line: int
    rows: Iterator[tuple[int, list[str]]]


def open_csv(path: Path, stream: TextIO) -> CsvFile:
    """Return the header and the rows of a file.

    Args:
        path: For error messages.
        stream: The file as `opened` gives it.

    Raises:
        LogError: the file is empty, no text, or a Git LFS pointer.
    """
    comments: list[str] = []
    line, separator, number = '', None, 0
    for line in stream:
        number += 1
        text = line.strip().lstrip('\ufeff')
        if text.encode().startswith(GIT_LFS_POINTER):
            raise LogError(f'{path} is a Git LFS pointer, not the file: fetch it with '
                           '"git lfs pull"')
        if text.lower().startswith('sep=') and len(text) == 5:  # as Excel writes it
            separator = text[-1]
        elif text.startswith(_COMMENTS) and not text.startswith('%time'):
            comments.append(text.lstrip('#% '))
        elif text in ('header:', '---'):
            raise LogError(f'{path} is what "ros2 topic echo" prints: a bag of "ros2 bag record" '
                           'is read, or what "ros2 topic echo --csv" prints')
        elif text:
            break
    else:
        raise LogError(f'{path} is empty: expected {_EXPECTED}')
    if not all(letter.isprintable() or letter.isspace() for letter in line):
        raise LogError(f'{path} is no text: expected {_EXPECTED}')
    head = [(number, line), *islice(enumerate(stream, number + 1), _PREAMBLE)]
    del head[:_header_place(head, separator)]
    line, following = head[0][1], head[1][1] if len(head) > 1 else ''
    if separator is None:
        separator = _separator(line, following)
    first = _cells([line], separator)[0]
    header, rest = tuple(first), head[1:]
    if echoed := _of_echo(first):
        header, rest = echoed, head
    elif all(map(is_number, first)):
        rest = head
        header = ()
        if comments:
            header = tuple(_cells(comments[-1:], _separator(comments[-1], line))[0])
    elif (units := _units(following, separator, len(header))) is not None:
        header, rest = tuple(f'{cell.strip()} [{unit}]' if unit else cell
                             for cell, unit in zip(header, units)), head[2:]
    again = {line for _, line in head[:len(head) - len(rest)]}  # where files were put together
    lines = chain(rest, enumerate(stream, number + 1 + _PREAMBLE))
    while header and not header[-1].strip():  # a comma at the end
        header = header[:-1]
    header = tuple(cell.strip().strip("'") for cell in header)
    return CsvFile(header, head[0][0], _rows(lines, separator, again))


def _header_place(lines: list[tuple[int, str]], separator: str | None) -> int:
    """Return which line is the header: the first one, but for text that stands before it.

    It is the line above the first row of numbers with as many cells, or above the line of units in
    between. What stands before has fewer cells, or they are mostly empty, as in a spreadsheet.
    """
    places = [k for k, (_, line) in enumerate(lines)
              if k == 0 or line.strip() and not line.startswith(_COMMENTS)]
    for position, (above, below) in enumerate(pairwise(places)):
        used = separator or _separator(lines[above][1], lines[below][1])
        row = _cells([lines[below][1]], used)[0]
        if not all(map(_is_value, row)) or not 2 * row.count('') < len(row) > 1:
            continue
        before = (_cells([lines[k][1]], used)[0] for k in reversed(places[:position + 1]))
        count = sum(1 for _ in takewhile(partial(_is_above, row), before))
        return places[position + 1 - count] if count else 0
    return 0


def _is_above(row: list[str], cells: list[str]) -> bool:
    """Return whether cells may head a row of numbers, which may have empty ones more."""
    return (len(cells) == len(row) - row[len(cells):].count('')
            and 2 * cells.count('') < len(cells))


def _is_value(cell: str) -> bool:
    return is_number(cell) or nanoseconds_of(cell) is not None


def _of_echo(row: list[str]) -> tuple[str, ...]:
    """Return names for the columns of a JointState of ``ros2 topic echo --csv``; else ().

    They are stamp, frame, n names, and as many positions, velocities and efforts.
    """
    n = (len(row) - 3) // 4
    if n < 1 or len(row) != 3 + 4 * n or not all(map(str.isdecimal, row[:2])):
        return ()
    joints, values = row[3:3 + n], row[3 + n:]
    if len(set(joints)) < n or any(map(is_number, joints)) or not all(map(is_number, values)):
        return ()
    return ('sec', 'nanosec', 'frame_id', *(f'name {joint}' for joint in joints), *(
        f'{kind}[{joint}]' for kind in ('position', 'velocity', 'effort') for joint in joints))


def _units(line: str, separator: str, count: int) -> list[str] | None:
    """Return the units below a header of so many cells; None where the line holds none."""
    cells = [cell.strip().strip('[]()') for cell in _cells([line], separator)[0]]
    told = [cell for cell in cells if cell]
    wrong = len(cells) != count or not told or any(
        is_number(cell) or _DECIMAL.match(cell) for cell in told)
    return None if wrong else cells


def opened(path: Path) -> TextIO:
    """Open a file in the encoding that its byte order mark or zero bytes show, else UTF-8.

    Bytes that are not valid in it are replaced: they occur in units such as ``[°]``.
    """
    with path.open('rb') as stream:
        start = stream.read(64)
    encoding = next((name for bom, name in _BOMS if start.startswith(bom)), 'utf-8')
    if encoding == 'utf-8' and b'\0' in start:
        other = 'utf-16-be' if start[:1] == b'\0' else 'utf-16-le'
        encoding = _ZEROS.get(tuple(byte == 0 for byte in start[:4]), other)
    return path.open(newline='', encoding=encoding, errors='replace')


def is_number(cell: str) -> bool:
    """Return whether a cell holds a number, maybe with a decimal comma, or a missing one."""
    try:
        number_of(cell)
    except ValueError:
        return False
    return True


def number_of(cell: str) -> float:
    """Return the number in a cell, NaN where it stands for a missing one; 1.5D-3 as in Fortran.

    Raises:
        ValueError: it is neither.
    """
    text = cell.strip().strip("'").lower()
    return float('nan') if text in _MISSING else float(text.replace(',', '.').replace('d', 'e'))


def _separator(first: str, second: str) -> str:
    for separator in _SEPARATORS:
        if separator in first and (separator in second or not second.strip()):
            return separator
    return ' '


def _rows(lines: Iterator[tuple[int, str]], separator: str, left_out: set[str]
          ) -> Iterator[tuple[int, list[str]]]:
    for number, line in lines:
        if line.strip() and not line.startswith(_COMMENTS) and line not in left_out:
            yield number, _cells([line], separator)[0]


def _cells(lines: list[str], separator: str) -> list[list[str]]:
    if separator == ' ':
        return [line.split() for line in lines]
    return list(csv.reader(lines, delimiter=separator, skipinitialspace=True))
