# SPDX-License-Identifier: Apache-2.0
"""Tables that may not fit the memory."""

from __future__ import annotations

import tempfile
from typing import IO

import numpy as np

from adaptive_blf_control.errors import BagError

__all__ = ['BLOCK_ROWS', 'RowStore', 'keep_rows']

BLOCK_ROWS = 4096
LIMIT = 1 << 27  # bytes kept in memory


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
            raise BagError(f'{tempfile.gettempdir()}: no room for the rows of a large log: '
                           f'{exc.strerror}') from exc
        self._blocks.clear()
        self._used = 0

    def table(self) -> np.ndarray:
        """Return the rows, shape (N, width); no row can be added after that."""
        if self._file is None:
            return np.concatenate([*self._blocks, self._block[:self._used]])
        self._spill()
        mapped = np.memmap(self._file, np.float64, 'r+', shape=(self._written, self._width))
        return np.asarray(mapped)


def keep_rows(table: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """Return the rows where ``keep`` is true, moved to the front of ``table`` itself."""
    if keep.all():
        return table
    end = 0
    for start in range(0, len(table), BLOCK_ROWS):
        block = table[start:start + BLOCK_ROWS][keep[start:start + BLOCK_ROWS]]
        table[end:end + len(block)] = block
        end += len(block)
    return table[:end]
