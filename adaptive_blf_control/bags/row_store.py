# SPDX-License-Identifier: Apache-2.0
"""Tables that may not fit the memory."""

from __future__ import annotations

from collections.abc import Iterator
import mmap
import os
import tempfile
from typing import Any, IO

import numpy as np

from adaptive_blf_control.errors import BagError

__all__ = ['BLOCK_ROWS', 'RowStore', 'keep_rows', 'new_table', 'release', 'row_blocks']

BLOCK_ROWS = 4096
LIMIT = 1 << 27  # bytes kept in memory
_RELEASED = 32  # blocks after which those that were passed leave the memory


class _Map(mmap.mmap):
    """The map of a temporary file of this module; it is shared: the file has what is written."""


def _mapped(file: IO[bytes], rows: int, width: int) -> np.ndarray:
    return np.ndarray((rows, width), np.float64, buffer=_Map(file.fileno(), 8 * rows * width))


def _no_room(exc: OSError) -> BagError:
    return BagError(f'{tempfile.gettempdir()}: no room for the rows of a large log: '
                    f'{exc.strerror}')


def new_table(rows: int, width: int, limit: int = LIMIT) -> np.ndarray:
    """Return a table to be filled, shape (rows, width); beyond ``limit`` bytes it is on disk.

    Raises:
        BagError: the disk is full.
    """
    if 8 * rows * width <= limit:
        return np.empty((rows, width))
    try:
        with tempfile.TemporaryFile() as file:  # the map keeps its content
            os.posix_fallocate(file.fileno(), 0, 8 * rows * width)
            return _mapped(file, rows, width)
    except OSError as exc:
        raise _no_room(exc) from exc


def release(values: np.ndarray) -> None:
    """Let the rows of a table that is mapped leave the memory; read again, they come back."""
    owner: Any = values
    while isinstance(owner, np.ndarray):
        owner = owner.base
    if isinstance(owner, _Map):
        owner.madvise(mmap.MADV_DONTNEED)


def row_blocks(values: np.ndarray, *others: np.ndarray) -> Iterator[slice]:
    """Yield one block of rows of tables after the other; those passed leave the memory."""
    for number, start in enumerate(range(0, len(values), BLOCK_ROWS), 1):
        yield slice(start, start + BLOCK_ROWS)
        if number % _RELEASED == 0 or start + BLOCK_ROWS >= len(values):
            for each in (values, *others):
                release(each)


class RowStore:
    """Rows of numbers: in memory up to a limit, beyond it in a temporary file that is mapped.

    The file has no name, so nothing is left of it however the process ends. It lies in ``TMPDIR``.
    """

    def __init__(self, width: int, limit: int = LIMIT) -> None:
        """Start with no row of ``width`` numbers; ``limit`` is in bytes."""
        self._width, self._limit = width, limit
        self._block = np.empty((BLOCK_ROWS, width))
        self._used = 0
        self._blocks: list[np.ndarray] = []
        self._file: IO[bytes] | None = None
        self._written = 0

    def __len__(self) -> int:
        """Return the number of rows."""
        return self._written + BLOCK_ROWS * len(self._blocks) + self._used

    def append(self, row: np.ndarray | list[float]) -> None:
        """Add a row of ``width`` numbers.

        Raises:
            BagError: the disk is full.
        """
        self._block[self._used] = row
        self._used += 1
        if self._used == BLOCK_ROWS:
            self._blocks.append(self._block)
            self._block, self._used = np.empty_like(self._block), 0
            if len(self._blocks) * self._block.nbytes >= self._limit:
                self._spill()

    def _spill(self) -> None:
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile()  # noqa: SIM115 (the map keeps its content)
            for block in (*self._blocks, self._block[:self._used]):
                self._file.write(block.tobytes())
                self._written += len(block)
            self._file.flush()
        except OSError as exc:
            raise _no_room(exc) from exc
        self._blocks.clear()
        self._used = 0

    def table(self) -> np.ndarray:
        """Return the rows, shape (N, width); once, the store is empty then."""
        if self._file is None:
            return self._moved()
        self._spill()
        return _mapped(self._file, self._written, self._width)

    def _moved(self) -> np.ndarray:
        """Return the rows that are in memory, which at no time holds them twice."""
        table, end = np.empty((len(self), self._width)), 0
        self._blocks.append(self._block[:self._used])
        self._blocks.reverse()
        while self._blocks:
            block = self._blocks.pop()  # leaves the memory with the next one
            table[end:end + len(block)] = block
            end += len(block)
        self._used = 0
        return table


def keep_rows(table: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Return the rows where ``keep`` is true, moved to the front of ``table`` itself."""
    if keep.all():
        return table
    end = 0
    for some in row_blocks(table):
        block = table[some][keep[some]]
        table[end:end + len(block)] = block
        end += len(block)
    return table[:end]
