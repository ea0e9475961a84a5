# SPDX-License-Identifier: Apache-2.0
"""Writer of rosbag2 folders like those of a Jazzy recorder: MCAP storage, metadata version 9."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
import os
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple

from mcap.writer import CompressionType, Writer

from adaptive_blf_control import __version__
from adaptive_blf_control.bags.mcap_file import McapFile
from adaptive_blf_control.bags.metadata import (
    BagMetadata,
    default_qos,
    dump_yaml,
    EMPTY_START,
    FileInformation,
    METADATA_NAME,
    save_metadata,
    TopicMetadata,
)
from adaptive_blf_control.bags.spooled_index import spool_chunk_index
from adaptive_blf_control.bags.storage import Channel
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.definitions import message_definition, MessageDefinition

__all__ = ['CHUNK_SIZE', 'BagWriter']

# As rosbag2's own storage plugin [bytes].
CHUNK_SIZE = 786_432
LIBRARY = f'adaptive_blf_control {__version__}'

_LATEST = 2**63 - 1


class _Flushed(NamedTuple):
    """Contents of the file at the last flush: bytes, messages by topic, first and last time."""

    position: int
    counts: dict[str, int]
    start_ns: int
    end_ns: int


class BagWriter:
    """A bag folder ``<bag>/<bag>_0.mcap`` and ``metadata.yaml``, open for writing.

    Everything that was flushed survives a crash of the process: the file then lacks its index,
    and readers scan it. Leaving the context closes the bag, with or without an error. One
    instance belongs to one thread.

    Attributes:
        path: The bag folder.
        file: The MCAP file in it.
        overcounted: After a disk error and `close`, by topic: how many messages more `counts` had
            before `close` than the file contains; negative where the file contains more.
    """

    def __init__(self, path: Path | str, *, custom_data: Mapping[str, str] | None = None,
                 ros_distro: str = 'jazzy') -> None:
        """Create the folder and start the file.

        Args:
            path: Folder to create, including its parents.
            custom_data: Strings to store in the bag's metadata, e.g. the parameters of the run.
            ros_distro: Name of the distribution for the metadata.

        Raises:
            BagError: the folder exists or cannot be created; custom data that are not strings.
        """
        self.path = Path(path)
        name = self.path.name or self.path.absolute().name
        self.file = self.path / f'{name}_0.mcap'
        self._custom_data = _checked_custom_data(custom_data or {})
        self._ros_distro = ros_distro
        self._topics: dict[str, TopicMetadata] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._start_ns, self._end_ns = EMPTY_START, 0
        self._flushed = _Flushed(0, {}, EMPTY_START, 0)
        self.overcounted: dict[str, int] = {}
        self._metadata_is_old = False
        self._closed = self._broken = False
        self._stream = self._make_file()
        self._writer = Writer(self._stream, chunk_size=CHUNK_SIZE,
                              compression=CompressionType.NONE)
        try:
            self._guard(lambda: spool_chunk_index(self._writer, self.path))
            self._guard(self._begin)
        except BagError:
            with suppress(OSError):  # closing fails for the same reason
                self._stream.close()
            raise

    def __enter__(self) -> BagWriter:
        """Return the open writer."""
        return self

    def __exit__(self, exc_type: type[BaseException] | None, exc: BaseException | None,
                 traceback: TracebackType | None) -> None:
        """Close the bag."""
        self.close()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written so far, by topic; after `close` those that are in the file."""
        return dict(self._counts)

    def add_topic(self, name: str, type_name: str, *,
                  qos: Sequence[Mapping[str, Any]] | None = None,
                  definition: MessageDefinition | None = None) -> int:
        """Announce a topic and return its MCAP channel id; a second, equal call changes nothing.

        Args:
            name: Topic name as in the graph, e.g. ``/joint_states``.
            type_name: Full message type, e.g. ``sensor_msgs/msg/JointState``.
            qos: Offered profiles in the form of `default_qos`; by default that of a reliable,
                volatile publisher. They are stored both in metadata.yaml and in the channel,
                because readers compare the two.
            definition: Text and hash of the type; looked up by default.

        Raises:
            BagError: the topic exists with another type, no definition is found, or the disk
                cannot be written.
        """
        if name in self._topics:
            if self._topics[name].type_name != type_name:
                raise BagError(f'{self.path}: topic {name!r} has type '
                               f'{self._topics[name].type_name!r}, not {type_name!r}')
            return self._channels[name]
        definition = definition or message_definition(type_name)
        profiles = [dict(profile) for profile in (default_qos() if qos is None else qos)]
        self._guard(lambda: self._register(name, type_name, profiles, definition))
        self._topics[name] = TopicMetadata(name, type_name, profiles, definition.type_hash)
        self._counts[name] = 0
        self._metadata_is_old = True
        return self._channels[name]

    def write(self, topic: str, data: bytes, log_time_ns: int,
              publish_time_ns: int | None = None) -> None:
        """Append one CDR message.

        Args:
            topic: A topic announced with `add_topic`.
            data: The message with its encapsulation header, stored as it is.
            log_time_ns: Time of reception [ns].
            publish_time_ns: Time of publication [ns]; by default that of reception.

        Raises:
            BagError: unknown topic, a time out of range, a closed bag, or the disk cannot be
                written.
        """
        channel = self._channels.get(topic)
        if channel is None:
            raise BagError(f'{self.path}: topic {topic!r} was not added: '
                           f'expected one of {sorted(self._channels)}')
        sent = log_time_ns if publish_time_ns is None else publish_time_ns
        if not (0 <= log_time_ns < _LATEST and 0 <= sent < _LATEST):
            raise BagError(f'{self.path}: topic {topic!r}: times {log_time_ns} and {sent} ns: '
                           'expected 0 to 2**63 - 2')
        self._check_open()
        try:
            self._writer.add_message(channel, log_time_ns, data, sent)
        except OSError as exc:
            raise self._disk_error(exc) from exc
        self._counts[topic] += 1
        self._start_ns = min(self._start_ns, log_time_ns)
        self._end_ns = max(self._end_ns, log_time_ns)

    def flush(self, *, fsync: bool = False) -> None:
        """Pass everything written so far to the operating system, with `fsync` to the disk.

        Raises:
            BagError: the bag is closed, or the disk cannot be written.
        """
        self._guard(lambda: self._flush(fsync))

    def set_custom_data(self, custom_data: Mapping[str, str]) -> None:
        """Add custom data and replace existing keys; BagError where one is not a string."""
        self._custom_data.update(_checked_custom_data(custom_data))
        self._metadata_is_old = True

    def close(self) -> None:
        """Write index and metadata; calls after the first do nothing.

        After a disk error the file is left without index; its contents can be scanned.

        Raises:
            BagError: the disk cannot be written.
        """
        if self._closed:
            return
        try:
            if not self._broken:
                self._guard(self._finish)
        finally:
            self._closed = True
            try:
                if self._broken:
                    with suppress(OSError):  # its buffer cannot be written either
                        self._stream.close()
                    self._count_again()
                else:
                    self._stream.close()
                save_metadata(self.path, self._metadata())
            except OSError as exc:
                if not self._broken:
                    raise BagError(f'{self.path}: cannot be closed: {exc}') from exc

    def discard(self) -> None:
        """End the bag and remove it: what this writer has made, and nothing that others put there.

        A bag that was renamed meanwhile stays, and what the system does not let go.
        """
        self._closed = True
        try:
            self._check_in_place()
            with suppress(OSError):  # what its buffer holds is not wanted
                self._stream.close()
            for file in (self.file, self.path / METADATA_NAME):
                file.unlink(missing_ok=True)
            for folder in self._made:
                folder.rmdir()
        except OSError:  # the first folder that has something else in it, for one
            return

    def _make_file(self) -> BinaryIO:
        folders = (self.path, *self.path.parents)
        self._made = [folder for folder in folders if not folder.exists()]
        try:
            self.path.mkdir(parents=True)
            return self.file.open('xb')
        except FileExistsError as exc:
            raise BagError(f'{self.path} exists already: expected a new folder') from exc
        except OSError as exc:
            raise BagError(f'{self.path}: cannot be created: {exc}') from exc

    def _guard(self, action: Callable[[], None]) -> None:
        """Run one step; a disk error becomes a BagError, and nothing more can be written."""
        self._check_open()
        try:
            action()
        except OSError as exc:
            raise self._disk_error(exc) from exc

    def _check_open(self) -> None:
        if self._closed:
            raise BagError(f'{self.path} is closed')
        if self._broken:
            raise BagError(f'{self.path}: nothing can be written after a disk error')

    def _disk_error(self, exc: OSError) -> BagError:
        self._broken = True
        return BagError(f'{self.file}: cannot be written: {exc}')

    def _begin(self) -> None:
        self._writer.start(profile='ros2', library=LIBRARY)
        self._add_metadata_record()
        self._stream.flush()
        self._flushed = self._flushed._replace(position=self._stream.tell())
        save_metadata(self.path, self._metadata())

    def _register(self, name: str, type_name: str, profiles: list[dict[str, Any]],
                  definition: MessageDefinition) -> None:
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(
                type_name, 'ros2msg', definition.text.encode())
        self._channels[name] = self._writer.register_channel(
            name, 'cdr', self._schemas[type_name],
            {'offered_qos_profiles': dump_yaml(profiles),
             'topic_type_hash': definition.type_hash})

    def _check_in_place(self) -> None:
        """Raise OSError where the file was removed or renamed: nobody would find what follows."""
        try:
            there = os.path.samestat(os.stat(self.file), os.fstat(self._stream.fileno()))
        except FileNotFoundError:
            there = False
        if not there:
            raise OSError(None, 'it was removed or renamed while it was being written')

    def _flush(self, fsync: bool) -> None:
        self._check_in_place()
        self._writer.flush()
        self._flushed = _Flushed(self._stream.tell(), dict(self._counts), self._start_ns,
                                 self._end_ns)
        if self._metadata_is_old:  # so that an unfinished bag has its topics and custom data
            self._add_metadata_record()
            self._stream.flush()
            save_metadata(self.path, self._metadata())
            self._metadata_is_old = False
        if fsync:
            os.fsync(self._stream.fileno())

    def _finish(self) -> None:
        self._writer.flush()
        self._add_metadata_record()
        self._writer.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def _count_again(self) -> None:
        """Count the messages that are in the file, not those that were handed over."""
        handed_over = self._counts
        position, self._counts, self._start_ns, self._end_ns = self._flushed
        self._counts = {topic: self._counts.get(topic, 0) for topic in handed_over}
        file = McapFile(self.file)
        file.channels.update((number, Channel(topic, self._topics[topic].type_name))
                             for topic, number in self._channels.items())
        with suppress(OSError), self.file.open('rb') as stream:
            stream.seek(position)
            for channel, log_time in file.continued(stream.read()):
                self._counts[file.channels[channel].topic] += 1
                self._start_ns = min(self._start_ns, log_time)
                self._end_ns = max(self._end_ns, log_time)
        self.overcounted = {topic: count - self._counts[topic]
                            for topic, count in handed_over.items()}

    def _add_metadata_record(self) -> None:
        self._writer.add_metadata(
            'rosbag2', {'serialized_metadata': dump_yaml(self._metadata().to_dict())})

    def _metadata(self) -> BagMetadata:
        total = sum(self._counts.values())
        duration = self._end_ns - self._start_ns if total else 0
        return BagMetadata(
            files=(FileInformation(self.file.name, self._start_ns, duration, total),),
            topics=tuple(replace(topic, message_count=self._counts[name])
                         for name, topic in self._topics.items()),
            custom_data=self._custom_data, ros_distro=self._ros_distro)


def _checked_custom_data(custom_data: Mapping[str, str]) -> dict[str, str]:
    """Return a copy; BagError where a key or value is not a string that UTF-8 can encode."""
    for key, value in custom_data.items():
        for text in (key, value):
            if not isinstance(text, str):
                raise BagError(f'custom data {key!r}: {text!r} is a {type(text).__name__}: '
                               'expected a string')
            try:
                text.encode()
            except UnicodeEncodeError as exc:
                raise BagError(f'custom data {key!r}: {exc}') from exc
    return dict(custom_data)
