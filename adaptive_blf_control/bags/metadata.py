# SPDX-License-Identifier: Apache-2.0
"""metadata.yaml of a rosbag2 folder, version 9 (Jazzy): write, and read version 4 and later."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import os
from pathlib import Path
from typing import Any

import yaml

from adaptive_blf_control.bounded_yaml import load_yaml_text, read_yaml_text
from adaptive_blf_control.errors import BagError

__all__ = ['EMPTY_START', 'METADATA_NAME', 'BagMetadata', 'FileInformation', 'TopicMetadata',
           'default_qos', 'dump_yaml', 'load_metadata', 'parse_metadata', 'parse_qos',
           'save_metadata']

METADATA_NAME = 'metadata.yaml'
VERSION = 9
# rosbag2's starting_time of a bag without messages [ns]: int64 max.
EMPTY_START = 2**63 - 1

_ROOT = 'rosbag2_bagfile_information'


def _infinite() -> dict[str, int]:
    return {'sec': 9223372036, 'nsec': 854775807}


def default_qos(reliability: str = 'reliable',
                durability: str = 'volatile') -> list[dict[str, Any]]:
    """Return the QoS list that a Jazzy recorder stores for one publisher of this kind.

    Policies are strings. History and depth cannot be discovered over DDS, hence unknown and 0.
    """
    return [{
        'history': 'unknown',
        'depth': 0,
        'reliability': reliability,
        'durability': durability,
        'deadline': _infinite(),
        'lifespan': _infinite(),
        'liveliness': 'automatic',
        'liveliness_lease_duration': _infinite(),
        'avoid_ros_namespace_conventions': False,
    }]


@dataclass(frozen=True)
class TopicMetadata:
    """One topic of a bag, with the number of its messages."""

    name: str
    type_name: str
    qos: Sequence[Mapping[str, Any]] = ()
    type_hash: str = ''
    message_count: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Return the YAML level of an item of ``topics_with_message_count``."""
        return {
            'topic_metadata': {
                'name': self.name,
                'type': self.type_name,
                'serialization_format': 'cdr',
                'offered_qos_profiles': [dict(profile) for profile in self.qos],
                'type_description_hash': self.type_hash,
            },
            'message_count': self.message_count,
        }


@dataclass(frozen=True)
class FileInformation:
    """One storage file: its name in the folder, receive times [ns] and message count."""

    path: str
    start_ns: int = EMPTY_START
    duration_ns: int = 0
    message_count: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Return the YAML level of an item of ``files``."""
        return {
            'path': self.path,
            'starting_time': {'nanoseconds_since_epoch': self.start_ns},
            'duration': {'nanoseconds': self.duration_ns},
            'message_count': self.message_count,
        }


@dataclass(frozen=True)
class BagMetadata:
    """All of metadata.yaml; times are those of reception [ns], as rosbag2 counts them."""

    files: tuple[FileInformation, ...]
    topics: tuple[TopicMetadata, ...] = ()
    custom_data: Mapping[str, str] = field(default_factory=dict)
    storage: str = 'mcap'
    ros_distro: str = 'jazzy'
    compression_format: str = ''
    compression_mode: str = ''

    def to_dict(self) -> dict[str, Any]:
        """Return everything below the root key, in rosbag2's order."""
        starts = [item.start_ns for item in self.files if item.message_count]
        ends = [item.start_ns + item.duration_ns for item in self.files if item.message_count]
        start = min(starts, default=EMPTY_START)
        return {
            'version': VERSION,
            'storage_identifier': self.storage,
            'duration': {'nanoseconds': max(ends, default=start) - start},
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': sum(item.message_count for item in self.files),
            'topics_with_message_count': [topic.to_dict() for topic in self.topics],
            'compression_format': self.compression_format,
            'compression_mode': self.compression_mode,
            'relative_file_paths': [item.path for item in self.files],
            'files': [item.to_dict() for item in self.files],
            'custom_data': {key: _Text(value) for key, value in self.custom_data.items()} or None,
            'ros_distro': self.ros_distro,
        }

    @property
    def message_count(self) -> int:
        """Messages of all files, as the metadata state it."""
        return sum(item.message_count for item in self.files)


class _Text(str):
    """A string that is always quoted, so that no reader parses '1e5' as a number."""


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]
    def ignore_aliases(self, data: object) -> bool:
        """Write equal parts in full, because users of yaml-cpp expect no anchors here."""
        return True


_Dumper.add_representer(
    _Text, lambda dumper, text: dumper.represent_scalar('tag:yaml.org,2002:str', text, style='"'))
_Dumper.add_representer(
    type(None), lambda dumper, _: dumper.represent_scalar('tag:yaml.org,2002:null', '~'))


def dump_yaml(value: object) -> str:
    """Return YAML in the style of rosbag2: keys in the given order, block style, no anchors."""
    return str(yaml.dump(value, Dumper=_Dumper, sort_keys=False, width=10_000))


def save_metadata(folder: Path, metadata: BagMetadata) -> None:
    """Replace metadata.yaml atomically.

    Raises:
        OSError: the disk cannot be written.
    """
    temporary = folder / (METADATA_NAME + '.tmp')
    with temporary.open('w', encoding='utf-8') as stream:
        stream.write(dump_yaml({_ROOT: metadata.to_dict()}))
        stream.flush()
        os.fsync(stream.fileno())
    temporary.replace(folder / METADATA_NAME)


def load_metadata(folder: Path) -> BagMetadata:
    """Read metadata.yaml of a bag folder.

    Raises:
        BagError: the file is missing, not YAML, or lacks what is needed to find the messages.
    """
    path = folder / METADATA_NAME
    try:
        text = read_yaml_text(path)
    except (OSError, UnicodeDecodeError) as exc:
        raise BagError(f'{path}: cannot be read: {exc}') from exc
    try:
        document = load_yaml_text(text)
    except (yaml.YAMLError, ValueError, RecursionError) as exc:
        raise BagError(f'{path}: not YAML: {exc}') from exc
    if not isinstance(document, dict) or _ROOT not in document:
        raise BagError(f'{path}: expected the root key {_ROOT!r}')
    return parse_metadata(document[_ROOT], str(path))


def parse_metadata(content: object, where: str) -> BagMetadata:
    """Convert the levels below the root key to BagMetadata; missing newer keys get defaults.

    Raises:
        BagError: a level differs from what rosbag2 writes; names the key.
    """
    if not isinstance(content, dict):
        raise BagError(f'{where}: expected a mapping, found {type(content).__name__}')
    try:
        return BagMetadata(
            files=_parse_files(content),
            topics=tuple(map(_parse_topic, content.get('topics_with_message_count') or ())),
            custom_data={str(k): str(v) for k, v in (content.get('custom_data') or {}).items()},
            storage=str(content['storage_identifier']),
            ros_distro=str(content.get('ros_distro', '')),
            compression_format=str(content.get('compression_format') or ''),
            compression_mode=str(content.get('compression_mode') or ''))
    except KeyError as exc:
        raise BagError(f'{where}: key {exc} is missing') from exc
    except (TypeError, ValueError, AttributeError, RecursionError) as exc:
        raise BagError(f'{where}: not as rosbag2 writes it: {exc}') from exc


def _parse_files(content: Mapping[str, Any]) -> tuple[FileInformation, ...]:
    """Read ``files``; before version 5 there were only paths, start and duration of the bag."""
    if content.get('files'):
        return tuple(FileInformation(
            str(item['path']), int(item['starting_time']['nanoseconds_since_epoch']),
            int(item['duration']['nanoseconds']), int(item['message_count']))
            for item in content['files'])
    paths = [str(path) for path in content['relative_file_paths']]
    start = int(content['starting_time']['nanoseconds_since_epoch'])
    duration, count = int(content['duration']['nanoseconds']), int(content['message_count'])
    # Counts per file are unknown; the first file gets the bag's total, so that sums are right.
    return tuple(FileInformation(path, start, duration, 0 if i else count)
                 for i, path in enumerate(paths))


def parse_qos(text: str) -> tuple[Mapping[str, Any], ...]:
    """Parse QoS profiles stored as text in a channel; empty where they cannot be read."""
    try:
        profiles = load_yaml_text(text) or ()
        return tuple(dict(profile) for profile in profiles)
    except (yaml.YAMLError, TypeError, ValueError, RecursionError):
        return ()


def _parse_topic(item: Mapping[str, Any]) -> TopicMetadata:
    topic = item['topic_metadata']
    qos = topic.get('offered_qos_profiles') or ()
    if isinstance(qos, str):  # version 8 and older
        try:
            qos = load_yaml_text(qos) or ()
        except yaml.YAMLError as exc:
            raise ValueError(f'offered_qos_profiles of {topic["name"]!r}: {exc}') from exc
    return TopicMetadata(str(topic['name']), str(topic['type']), tuple(map(dict, qos)),
                         str(topic.get('type_description_hash') or ''),
                         int(item['message_count']))
