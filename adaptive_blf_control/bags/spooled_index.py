# SPDX-License-Identifier: Apache-2.0
"""The chunk index of an MCAP file while it is being written: on the disk, not in memory.

The ``mcap`` library keeps an object of 1.5 kB for each chunk until the file ends. A recorder that
flushes twice a second would grow by 10 MB an hour. This is the only module that uses a private
attribute of the library.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import tempfile
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.writer import Writer

__all__ = ['spool_chunk_index']

_ATTRIBUTE = '_Writer__chunk_indices'
_BLOCK = 65_536  # bytes


class _Records:
    """Records as they are in the file; has the method `write` of the library's records."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def write(self, stream: RecordBuilder) -> None:
        stream.write(self._data)


class _Spool:
    """Replaces the library's list: it is appended to, then iterated over once."""

    def __init__(self, folder: Path) -> None:
        # It has no name, so nothing remains however the process ends.
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115

    def append(self, index: Any) -> None:
        builder = RecordBuilder()
        index.write(builder)
        self._file.write(builder.end())

    def __iter__(self) -> Iterator[_Records]:
        self._file.seek(0)
        while data := self._file.read(_BLOCK):
            yield _Records(data)
        self._file.close()


def spool_chunk_index(writer: Writer, folder: Path) -> None:
    """Let ``writer`` keep its chunk index in an unnamed file in ``folder``.

    Does nothing where the library has no such attribute; then the process uses more memory. A
    full disk raises OSError at the next chunk, as it does for the bag's file itself.
    """
    if getattr(writer, _ATTRIBUTE, None) == []:
        setattr(writer, _ATTRIBUTE, _Spool(folder))
