# SPDX-License-Identifier: Apache-2.0
"""The chunk index of an MCAP file while it is being written: on the disk, not in memory.

The ``mcap`` library keeps an object of 1.5 kB for each chunk until the file ends. A recorder that
flushes twice a second would grow by 10 MB an hour. The only module that touches its inside.
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
    """Records as they stand in the file; writes itself as one of the library's would."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def write(self, stream: RecordBuilder) -> None:
        stream.write(self._data)


class _Spool:
    """Takes the place of the list: appended to, then iterated over once."""

    def __init__(self, folder: Path) -> None:
        # Has no name, so that nothing is left behind however the process ends.
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

    Does nothing where the inside of the library is another: memory is all that it costs.
    A disk that is full is an OSError of the next chunk, as it is for the file itself.
    """
    if getattr(writer, _ATTRIBUTE, None) == []:
        setattr(writer, _ATTRIBUTE, _Spool(folder))
