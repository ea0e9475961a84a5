# SPDX-License-Identifier: Apache-2.0
"""The interface that a reader has to both storage formats of rosbag2."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

__all__ = ['BagMessage', 'Channel', 'StorageFile']


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
