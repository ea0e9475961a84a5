# SPDX-License-Identifier: Apache-2.0
"""Finishes a bag after a killed recorder, a power cut or the loss of its metadata.yaml.

The .mcap files are never changed. If all of them are complete, metadata.yaml is rebuilt beside
them, and an existing one that differs is kept as ``metadata.yaml.before``. If a file breaks off,
everything before the break goes into a new, finished bag; so does, unpacked, what is compressed as
files or messages.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from adaptive_blf_control.bags.compression import is_packed, PACKED_SUFFIXES, unpack_message
from adaptive_blf_control.bags.mcap_file import ChannelDetails, McapFile
from adaptive_blf_control.bags.metadata import (
    BagMetadata,
    EMPTY_START,
    FileInformation,
    load_metadata,
    METADATA_NAME,
    parse_qos,
    save_metadata,
    TopicMetadata,
)
from adaptive_blf_control.bags.storage_files import (
    check_contiguous,
    listed,
    open_file,
    storage_files,
)
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.definitions import MessageDefinition

__all__ = ['KEPT_NAME', 'Recovery', 'recover_bag']

KEPT_NAME = METADATA_NAME + '.before'


class Recovery(NamedTuple):
    """Result of a recovery.

    Attributes:
        path: The folder that is now a finished bag.
        what: ``whole`` (nothing was wrong), ``metadata`` (rebuilt) or ``copy`` (a new bag).
        messages: Number of messages in it.
        problem: Where the original breaks off, with file and byte; None where nothing is lost.
    """

    path: Path
    what: str
    messages: int
    problem: str | None


class _Scan(NamedTuple):
    """One file after a pass.

    Attributes:
        file: The file.
        information: Its part of metadata.yaml.
        counts: Number of messages by topic.
        packed: Whether the file or some of its messages are compressed.
        ends: Times of reception of its first and last message [ns]; fewer where it has fewer.
    """

    file: McapFile
    information: FileInformation
    counts: dict[str, int]
    packed: bool
    ends: tuple[int, ...]


def recover_bag(bag: Path | str, output: Path | str | None = None) -> Recovery:
    """Make a bag readable by tools that require a footer, an index and metadata.yaml.

    Args:
        bag: A bag folder with or without metadata.yaml, or a single .mcap file.
        output: Folder of the new bag; if it is given, a complete bag is copied, too. By default
            ``<bag>_recovered`` beside the bag, which is created only if it is needed: where a
            file breaks off or is compressed.

    Raises:
        BagError: no .mcap file or those of several recordings, no message before a break,
            messages that rosbag2 does not write, the output exists, or the disk cannot be
            written.
    """
    bag = Path(bag)
    paths = storage_files(bag) if bag.is_dir() else [bag]
    scans = [_scan(path) for path in paths]
    problems = [scan.file.problem for scan in scans if scan.file.problem]
    problem = problems[0] if problems else None
    if problem and not any(scan.counts for scan in scans):
        raise BagError(f'{problem} (no message before it)')
    if bag.is_dir() and not listed(bag) >= {path.name for path in paths}:
        check_contiguous((scan.file.path, scan.ends[0], scan.ends[-1])
                         for scan in scans if scan.counts)
    metadata = _metadata_of(scans, bag if bag.is_dir() else bag.parent)
    packed = any(scan.packed for scan in scans)
    if bag.is_dir() and problem is None and output is None and not packed:
        return _rebuild(bag, metadata)
    target = Path(output) if output else bag.with_name(bag.stem + '_recovered')
    _copy(scans, metadata, target)
    return Recovery(target, 'copy', metadata.message_count, problem)


def _scan(path: Path) -> _Scan:
    file = open_file(path)
    if not isinstance(file, McapFile):
        raise BagError(f'{path} is not an MCAP file: only bags with MCAP storage are recovered')
    counts: dict[int, int] = {}
    first, last, packed = EMPTY_START, 0, path.suffix in PACKED_SUFFIXES
    ends: tuple[int, ...] = ()
    for channel, log_time, data in file.messages():
        packed = packed or is_packed(data)
        counts[channel] = counts.get(channel, 0) + 1
        ends = (*ends[:1], log_time)
        first, last = min(first, log_time), max(last, log_time)
    by_topic: dict[str, int] = {}
    for channel, count in counts.items():
        topic = file.details[channel].topic
        by_topic[topic] = by_topic.get(topic, 0) + count
    total = sum(by_topic.values())
    return _Scan(file, FileInformation(path.name, first, max(last - first, 0) if total else 0,
                                       total), by_topic, packed, ends)


def _metadata_of(scans: Sequence[_Scan], folder: Path) -> BagMetadata:
    """Return the metadata of the files; custom data also from an existing metadata.yaml."""
    channels: dict[str, ChannelDetails] = {}
    custom_data: dict[str, str] = {}
    distro = ''
    with suppress(BagError):  # it may be missing or damaged
        custom_data.update(load_metadata(folder).custom_data)
    for scan in scans:
        for details in scan.file.details.values():
            channels.setdefault(details.topic, details)
        kept = scan.file.metadata()
        if kept:
            custom_data.update(kept.custom_data)
            distro = distro or kept.ros_distro
    return BagMetadata(
        files=tuple(scan.information for scan in scans),
        topics=tuple(TopicMetadata(
            topic, details.type_name, parse_qos(details.metadata.get('offered_qos_profiles', '')),
            details.metadata.get('topic_type_hash', ''),
            sum(scan.counts.get(topic, 0) for scan in scans))
            for topic, details in channels.items()),
        custom_data=custom_data, ros_distro=distro)


def _rebuild(folder: Path, metadata: BagMetadata) -> Recovery:
    path = folder / METADATA_NAME
    try:
        if path.exists():
            if _existing(folder) == metadata.to_dict():
                return Recovery(folder, 'whole', metadata.message_count, None)
            path.replace(folder / KEPT_NAME)
        save_metadata(folder, metadata)
    except OSError as exc:
        raise BagError(f'{path}: cannot be written: {exc}') from exc
    return Recovery(folder, 'metadata', metadata.message_count, None)


def _existing(folder: Path) -> dict[str, object] | None:
    try:
        return load_metadata(folder).to_dict()
    except BagError:
        return None


def _copy(scans: Sequence[_Scan], metadata: BagMetadata, target: Path) -> None:
    for scan in scans:
        for details in scan.file.details.values():
            if (details.encoding, details.schema_encoding) != ('cdr', 'ros2msg'):
                raise BagError(
                    f'{scan.file.path}: topic {details.topic!r} has encoding '
                    f'{details.encoding!r} and schema {details.schema_encoding!r}: expected '
                    "'cdr' and 'ros2msg'")
    definitions = {details.topic: details.definition
                   for scan in scans for details in scan.file.details.values()}
    with BagWriter(target, custom_data=metadata.custom_data,
                   ros_distro=metadata.ros_distro) as writer:
        for topic in metadata.topics:
            writer.add_topic(topic.name, topic.type_name, qos=topic.qos,
                             definition=MessageDefinition(topic.type_name,
                                                          definitions[topic.name],
                                                          topic.type_hash))
        for scan in scans:
            for channel, log_time, sent_time, data in scan.file.timed_messages():
                writer.write(scan.file.details[channel].topic, unpack_message(data), log_time,
                             sent_time)
