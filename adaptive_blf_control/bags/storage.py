# SPDX-License-Identifier: Apache-2.0
"""The interface that a reader has to both storage formats of rosbag2."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, IO, NamedTuple, Protocol

__all__ = ['BagMessage', 'Channel', 'StorageFile', 'StoredFile']


class Channel(NamedTuple):
    """A topic as a storage file knows it: name, full type name (may be empty), encoding."""

    topic: str
    type_name: str
    encoding: str = 'cdr'


class BagMessage(NamedTuple):
    """One message: topic, type, time of reception [ns] and CDR bytes."""

    topic: str
    type_name: str
    log_time_ns: int
    data: bytes


class StorageFile(Protocol):
    """One file of a bag.

    Attributes:
        path: The file.
        problem: Why the last pass ended before the end of the file, or None.
    """

    path: Path
    problem: str | None

    @property
    def channels(self) -> Mapping[int, Channel]:
        """Topics found so far, by the file's own id; full after one pass."""

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield channel id, time of reception [ns] and data, in the order of the file."""

    def custom_data(self) -> dict[str, str]:
        """Return the custom data stored in the file, after one pass."""

    def offered_qos(self) -> Mapping[str, Sequence[Mapping[str, Any]]]:
        """Return the QoS profiles of each topic's publishers, after one pass."""


class StoredFile:
    """Where the content of a file of a bag is, which may be compressed; base of both readers."""

    def __init__(self, path: Path, unpacked: IO[bytes] | None = None) -> None:
        """Store the path; nothing is read before the first pass.

        Args:
            path: The file.
            unpacked: Temporary file with its content where it is compressed as a whole.
        """
        self.path = path
        self._unpacked = unpacked  # its end is the end of the temporary file
        self._content = path if unpacked is None else Path(unpacked.name)
        self.channels: dict[int, Channel] = {}
        self.problem: str | None = None
