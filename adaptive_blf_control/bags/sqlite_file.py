# SPDX-License-Identifier: Apache-2.0
"""Reader of rosbag2's SQLite storage (.db3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
import sqlite3
from typing import Any

from adaptive_blf_control.bags.storage import Channel, StoredFile
from adaptive_blf_control.errors import BagError

__all__ = ['MAGIC', 'SqliteFile']

MAGIC = b'SQLite format 3\0'


class SqliteFile(StoredFile):
    """One .db3 file; see `StorageFile`."""

    def custom_data(self) -> dict[str, str]:
        """Return an empty mapping: a .db3 file has its custom data in metadata.yaml."""
        return {}

    def offered_qos(self) -> dict[str, Sequence[Mapping[str, Any]]]:
        """Return an empty mapping: a .db3 file has its QoS in metadata.yaml, too."""
        return {}

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield topic id, time of reception [ns] and data in the order of recording.

        Raises:
            BagError: the file cannot be opened or has no rosbag2 tables.
        """
        self.problem = None
        with closing(self._connect()) as connection:
            try:
                for number, *channel in connection.execute(
                        'SELECT id, name, type, serialization_format FROM topics'):
                    self.channels[number] = Channel(*map(str, channel))
                rows = connection.execute(
                    'SELECT topic_id, timestamp, data FROM messages ORDER BY id')
            except (sqlite3.Error, OverflowError) as exc:
                raise BagError(f'{self.path} is not a rosbag2 SQLite file: {exc}') from exc
            try:
                for row in rows:
                    number, stamp, data = row
                    if (number not in self.channels or not isinstance(stamp, int)
                            or not isinstance(data, bytes)):
                        self.problem = f'{self.path}: a row is not a message: {row!r:.80}'
                        return
                    yield number, stamp, data
            except sqlite3.Error as exc:
                self.problem = f'{self.path}: {exc}'

    def _connect(self) -> sqlite3.Connection:
        """Open read-only, with its write-ahead log if there is one that can be used."""
        address = self._content.resolve().as_uri()
        connection = sqlite3.connect(f'{address}?mode=ro', uri=True)
        try:
            connection.execute('SELECT count(*) FROM sqlite_master').fetchone()
        except sqlite3.OperationalError:  # a write-ahead log on a read-only disk
            connection.close()
            connection = sqlite3.connect(f'{address}?mode=ro&immutable=1', uri=True)
        except sqlite3.Error as exc:
            connection.close()
            raise BagError(f'{self.path}: cannot be read as SQLite: {exc}') from exc
        return connection
