# SPDX-License-Identifier: Apache-2.0
"""Sequential reader of an MCAP file that returns everything before a break.

The index at the end of the file is not used, because a recorder that was killed writes none. An
uncompressed chunk that is cut off at the end of the file is read up to its last complete message.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
import mmap
from pathlib import Path
import struct
from typing import Any, IO, NamedTuple
import zlib

import yaml

from adaptive_blf_control.bags.compression import unpack_bounded
from adaptive_blf_control.bags.metadata import BagMetadata, parse_metadata, parse_qos
from adaptive_blf_control.bags.storage import Channel, StoredFile
from adaptive_blf_control.bounded_yaml import load_yaml_text
from adaptive_blf_control.errors import BagError

__all__ = ['MAGIC', 'ChannelDetails', 'McapFile']

MAGIC = b'\x89MCAP0\r\n'

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _METADATA, _FOOTER = 3, 4, 5, 6, 12, 2
_HEAD = struct.Struct('<BQ')
_MESSAGE_HEAD = struct.Struct('<HIQQ')
_CHUNK_HEAD = struct.Struct('<QQQI')
_U16, _U32, _U64 = struct.Struct('<H'), struct.Struct('<I'), struct.Struct('<Q')

LATEST = 2**63 - 1  # ns
LARGEST_CHANNELS = 20_000
LARGEST_CHUNK = 1 << 28  # bytes; writers end a chunk at some megabytes
_RELEASED = 1 << 26  # bytes after which what was read of a file leaves the memory

_Buffer = bytes | mmap.mmap


class _BreakError(Exception):
    """The file cannot be read any further."""


class _Schema(NamedTuple):
    name: str
    encoding: str
    text: str


class ChannelDetails(NamedTuple):
    """Everything that is needed to write a channel again.

    Attributes:
        topic: Topic name.
        type_name: Full message type.
        encoding: How the messages are encoded; ``cdr`` from rosbag2.
        schema_encoding: Language of `definition`; ``ros2msg`` from rosbag2.
        definition: Text of the message type.
        metadata: The channel's own metadata: offered QoS and type hash.
    """

    topic: str
    type_name: str
    encoding: str
    schema_encoding: str
    definition: str
    metadata: Mapping[str, str]


class McapFile(StoredFile):
    """One MCAP file; see `StorageFile`.

    Attributes:
        details: Full descriptions of the channels found so far, by the file's own id.
    """

    def __init__(self, path: Path, unpacked: IO[bytes] | None = None) -> None:
        """See `StoredFile`."""
        super().__init__(path, unpacked)
        self.details: dict[int, ChannelDetails] = {}
        self._schemas: dict[int, _Schema] = {}
        self._channel_records: dict[bytes, bytes] = {}
        self._channel_changes = 0
        self._serialized_metadata = ''

    def metadata(self) -> BagMetadata | None:
        """Return the last rosbag2 metadata record, after one pass; None where unreadable."""
        try:
            return parse_metadata(load_yaml_text(self._serialized_metadata), str(self.path))
        except (BagError, yaml.YAMLError, ValueError, RecursionError):
            return None

    def custom_data(self) -> dict[str, str]:
        """Return the custom data of the last rosbag2 metadata record; empty where unreadable."""
        metadata = self.metadata()
        return dict(metadata.custom_data) if metadata else {}

    def offered_qos(self) -> dict[str, Sequence[Mapping[str, Any]]]:
        """Return the QoS profiles of each topic's publishers, after one pass."""
        return {channel.topic: parse_qos(channel.metadata.get('offered_qos_profiles', ''))
                for channel in self.details.values()}

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield channel id, log time [ns] and data up to the end of the file or a break.

        Raises:
            BagError: the file cannot be opened.
        """
        for channel, log_time, _, data in self.timed_messages():
            yield channel, log_time, data

    def continued(self, content: bytes) -> Iterator[tuple[int, int]]:
        """Yield channel id and log time [ns] of the messages in a later part of the file.

        Args:
            content: Complete records, except for the last one. The channels of their messages
                must be in `channels` or in these records.
        """
        with suppress(_BreakError):
            for channel, log_time, _, _ in self._follow(content, 0):
                yield channel, log_time

    def timed_messages(self) -> Iterator[tuple[int, int, int, bytes]]:
        """Yield channel id, log time [ns], publish time [ns] and data; see `messages`."""
        self.problem = None
        try:
            with self._content.open('rb') as stream, \
                    mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
                yield from self._file(content)
        except (OSError, ValueError) as exc:  # mmap: ValueError for an empty file
            raise BagError(f'{self.path}: cannot be read: {exc}') from exc
        except _BreakError as exc:
            self.problem = f'{self.path}: {exc}'

    def _file(self, content: mmap.mmap) -> Iterator[tuple[int, int, int, bytes]]:
        if content[:len(MAGIC)] != MAGIC:
            raise _BreakError('is not an MCAP file: wrong first bytes')
        yield from self._follow(content, len(MAGIC))

    def _follow(self, content: _Buffer, position: int) -> Iterator[tuple[int, int, int, bytes]]:
        end, released = len(content), 0
        while True:
            if position - released > _RELEASED and isinstance(content, mmap.mmap):
                content.madvise(mmap.MADV_DONTNEED)
                released = position
            if position + _HEAD.size > end:
                raise _BreakError(f'ends at byte {end} without footer: the file is truncated')
            opcode, length = _HEAD.unpack_from(content, position)
            body, position = position + _HEAD.size, position + _HEAD.size + length
            if opcode == 0:  # zeros, which a file system can leave after a power cut
                raise _BreakError(f'no record at byte {body - _HEAD.size}: the file is damaged')
            if opcode == _CHUNK:
                chunk = self._chunk(content, body, min(position, end), whole=position <= end)
                yield from self._records(chunk, 0, len(chunk), f'chunk at byte {body}')
            if position > end:
                raise _BreakError(f'record at byte {body} needs {length} bytes, {end - body} are '
                                  'left: the file is truncated')
            if opcode == _FOOTER:
                if content[position:position + len(MAGIC)] != MAGIC:
                    raise _BreakError(f'ends at byte {end} within its last bytes: the file is '
                                      'truncated')
                return
            if opcode in (_SCHEMA, _CHANNEL, _MESSAGE):
                yield from self._records(content, body - _HEAD.size, position, 'file')
            elif opcode == _METADATA:
                self._read_metadata(content, body, position)

    def _records(self, buffer: _Buffer, position: int, end: int,
                 where: str) -> Iterator[tuple[int, int, int, bytes]]:
        """Yield the messages among records of the kinds that a chunk may contain."""
        channels = self.channels
        while position < end:
            if position + _HEAD.size > end:
                raise _BreakError(f'{where} ends within a record: it is truncated')
            opcode, length = _HEAD.unpack_from(buffer, position)
            body = position + _HEAD.size
            position = body + length
            if position > end:
                raise _BreakError(f'{where} ends within a record: it is truncated')
            if opcode == _MESSAGE:
                if length < _MESSAGE_HEAD.size:
                    raise _BreakError(f'{where}: message record of {length} bytes')
                channel, _, log_time, sent_time = _MESSAGE_HEAD.unpack_from(buffer, body)
                if log_time > LATEST:
                    raise _BreakError(f'{where}: message of {log_time} ns: expected a time of '
                                      f'at most 2**63 - 1 ns')
                if channel not in channels:
                    raise _BreakError(f'{where}: message of unknown channel {channel}')
                yield (channel, log_time, sent_time,
                       buffer[body + _MESSAGE_HEAD.size:position])
            elif opcode == _SCHEMA:
                fields = _Fields(buffer, body, position)
                number = fields.number(_U16)
                self._schemas[number] = _Schema(fields.text(), fields.text(), fields.text())
            elif opcode == _CHANNEL:
                self._read_channel(buffer, body, position)

    def _read_channel(self, buffer: _Buffer, body: int, end: int) -> None:
        record = buffer[body:end]
        if self._channel_records.get(record[:_U16.size]) == record:
            return  # writers repeat it in every chunk
        self._channel_records[record[:_U16.size]] = record
        self._channel_changes += 1
        if self._channel_changes > LARGEST_CHANNELS:
            raise _BreakError(f'has more than {LARGEST_CHANNELS} channels')
        fields = _Fields(buffer, body, end)
        number, schema_number = fields.number(_U16), fields.number(_U16)
        schema = self._schemas.get(schema_number, _Schema('', '', ''))
        topic, encoding = fields.text(), fields.text()
        self.channels[number] = Channel(topic, schema.name, encoding)
        self.details[number] = ChannelDetails(topic, schema.name, encoding, schema.encoding,
                                              schema.text, fields.texts())

    def _chunk(self, content: _Buffer, body: int, end: int, *, whole: bool) -> bytes:
        """Return the records of a chunk; of a truncated one those that are present."""
        fields = _Fields(content, body, end)
        if end - body < _CHUNK_HEAD.size:
            raise _BreakError(f'chunk at byte {body} is truncated')
        _, _, size, crc = _CHUNK_HEAD.unpack_from(content, body)
        fields.position += _CHUNK_HEAD.size
        compression, stored = fields.text(), fields.number(_U64)
        if not whole:
            if compression:
                raise _BreakError(f'compressed chunk at byte {body} is truncated')
            return content[fields.position:min(fields.position + stored, end)]
        if fields.position + stored > end:
            raise _BreakError(f'chunk at byte {body} claims {stored} bytes: too many')
        data = content[fields.position:fields.position + stored]
        if size > LARGEST_CHUNK:
            raise _BreakError(f'chunk at byte {body} claims {size} bytes: expected at most '
                              f'{LARGEST_CHUNK}')
        if compression:
            data = _decompress(data, compression, size, body)
        if len(data) != size or (crc and zlib.crc32(data) != crc):
            raise _BreakError(f'chunk at byte {body} is damaged: wrong length or checksum')
        return data

    def _read_metadata(self, content: _Buffer, body: int, end: int) -> None:
        fields = _Fields(content, body, end)
        if fields.text() == 'rosbag2':
            self._serialized_metadata = fields.texts().get(
                'serialized_metadata', self._serialized_metadata)


class _Fields:
    """Reads the fields of one record in order and checks bounds."""

    def __init__(self, buffer: _Buffer, position: int, end: int) -> None:
        self.buffer, self.position, self.end = buffer, position, end

    def number(self, layout: struct.Struct) -> int:
        self._need(layout.size)
        self.position += layout.size
        return int(layout.unpack_from(self.buffer, self.position - layout.size)[0])

    def text(self) -> str:
        length = self.number(_U32)
        self._need(length)
        self.position += length
        return self.buffer[self.position - length:self.position].decode(errors='backslashreplace')

    def texts(self) -> dict[str, str]:
        stop = min(self.number(_U32) + self.position, self.end)
        found: dict[str, str] = {}
        while self.position < stop:
            key = self.text()
            found[key] = self.text()
        return found

    def _need(self, size: int) -> None:
        if self.position + size > self.end:
            raise _BreakError(f'record at byte {self.position} ends too early: it is truncated')


def _decompress(data: bytes, compression: str, size: int, body: int) -> bytes:
    if compression not in ('zstd', 'lz4'):
        raise _BreakError(f'chunk at byte {body} has compression {compression!r}: '
                          'expected zstd or lz4')
    try:
        return unpack_bounded(data, compression, size)
    except BagError as exc:
        raise _BreakError(f'chunk at byte {body} cannot be decompressed: {exc}') from exc
