# SPDX-License-Identifier: Apache-2.0
"""Reader of bags: rosbag2 folders, lone .mcap and .db3 files, whole or truncated."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from pathlib import Path
from typing import Any

import numpy as np

from adaptive_blf_control.bags.compression import unpack_message
from adaptive_blf_control.bags.joint_series import JointSeries, merged, parts_of, series_of
from adaptive_blf_control.bags.metadata import BagMetadata, load_metadata, METADATA_NAME
from adaptive_blf_control.bags.storage import BagMessage, StorageFile
from adaptive_blf_control.bags.storage_files import (
    check_contiguous,
    named_file,
    open_file,
    storage_files,
)
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr import (
    decode_float64,
    decode_float64_array,
    decode_int32,
)
from adaptive_blf_control.messages.joint_readers import (
    DYNAMIC_JOINT_STATE,
    joint_kind,
    JOINT_STATE,
)
from adaptive_blf_control.parameters.guided import Guided

__all__ = ['Bag', 'BagMessage', 'JointSeries', 'TopicInfo', 'read_bag']

OUT_OF_PLACE = 10**9  # ns
# What helps with an encoding that is not read.
_HINTS = {'ros1': ' (a ROS 1 recording: convert it with rosbags-convert)'}

_ENCODINGS = {JOINT_STATE: "'cdr', as ROS 2 records, or 'json'",
              DYNAMIC_JOINT_STATE: "'cdr', as ROS 2 records,"}

_NUMBER_DECODERS: dict[str, Callable[[bytes], Any]] = {
    'std_msgs/msg/Float64MultiArray': decode_float64_array,
    'std_msgs/msg/Float64': decode_float64,
    'std_msgs/msg/Int32': decode_int32,
}


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a bag.

    Attributes:
        name: Topic name.
        type_name: Full type name; empty where the bag does not state it.
        count: Number of messages that can be read.
        encoding: How the messages are encoded; ``cdr`` from rosbag2.
    """

    name: str
    type_name: str
    count: int
    encoding: str = 'cdr'


class Bag(Guided, instead={
        **dict.fromkeys(('topic_names', 'channels', 'connections', 'info', 'types', 'counts'),
                        'topics has name, type and count of each topic'),
        **dict.fromkeys(('read', 'read_messages', 'get', 'data', 'read_topic'),
                        'joint_states(topic) and doubles(topic) return arrays, messages([topic]) '
                        'the bytes of each message'),
        **dict.fromkeys(('array', 'arrays', 'values', 'theta_hat', 'numbers'),
                        'doubles(topic) returns the vectors of a topic such as '
                        "'/identifier/theta_hat' as arrays"),
        **dict.fromkeys(('q', 'qd', 'tau', 't', 'position', 'velocity', 'effort', 'log'),
                        'joint_states(topic) has them as recorded, read_log(bag) in the order of '
                        'time'),
        **dict.fromkeys(('parameters', 'params', 'config', 'settings', 'metadata'),
                        "custom_data['ros__parameters'] is the run's parameter file as text"),
        **dict.fromkeys(('plot', 'show', 'draw', 'report'),
                        '`python -m adaptive_blf_control report BAG` makes a page of it'),
        **dict.fromkeys(('to_pandas', 'to_dataframe', 'dataframe', 'df'),
                        'pandas.DataFrame(series.position, columns=series.names) with '
                        'series = joint_states(topic)'),
        **dict.fromkeys(('duration', 'start_time', 'end_time'),
                        'log_time_ns of each message in in_time_order()'),
        'close': 'nothing is left open'}):
    """A bag after one pass over its files; iterating reads the messages in recorded order.

    Attributes:
        path: The folder or file that was opened.
        topics: Topics by name, including those without a message.
        custom_data: From metadata.yaml, or else from the file's own metadata record.
        offered_qos: QoS profiles of each topic's publishers, from the same places.
        complete: False where a file breaks off, is missing, or has fewer messages than stated.
        problem: What is wrong where `complete` is False, else None.
    """

    def __init__(self, path: Path, files: Sequence[StorageFile],
                 metadata: BagMetadata | None = None, problem: str | None = None) -> None:
        """Pass over all files once.

        BagError where no message can be read, or files without metadata.yaml cannot belong
        together.

        Args:
            path: The folder or file, for error messages.
            files: The storage files in order.
            metadata: Content of metadata.yaml, if it exists.
            problem: A problem that is already known.
        """
        self.path = path
        self._files = files
        # Without metadata a compressed message is known by its first bytes, which no CDR has.
        self._packed = metadata is None or metadata.compression_mode.lower() == 'message'
        counts: dict[str, int] = {}
        spans = []
        for file in files:
            times: tuple[int, ...] = ()
            for number, log_time_ns, _ in file.messages():
                topic = file.channels[number].topic
                counts[topic] = counts.get(topic, 0) + 1
                times = (*times[:1], log_time_ns)
            if times:
                spans.append((file.path, times[0], times[-1]))
        if metadata is None:
            check_contiguous(spans)
        problems = [*filter(None, [problem, *(file.problem for file in files)])]
        if not counts:
            raise BagError(problems[0] + ' (no message before it)' if problems else
                           f'{path} is an empty bag: it has no message')
        stated = metadata.message_count if metadata else 0
        if not problems and sum(counts.values()) < stated:
            problems = [f'{path}: {sum(counts.values())} messages were found, {METADATA_NAME} '
                        f'states {stated}']
        self.problem: str | None = problems[0] if problems else None
        self.complete = self.problem is None
        self.topics = {channel.topic: TopicInfo(channel.topic, channel.type_name,
                                               counts.get(channel.topic, 0), channel.encoding)
                       for file in files for channel in file.channels.values()}
        self.custom_data: Mapping[str, str] = (metadata and metadata.custom_data) or {
            key: value for file in files for key, value in file.custom_data().items()}
        self.offered_qos: dict[str, Sequence[Mapping[str, Any]]] = {
            topic: qos for file in files for topic, qos in file.offered_qos().items()}
        for stated_topic in metadata.topics if metadata else ():
            name = stated_topic.name
            self.offered_qos[name] = stated_topic.qos or self.offered_qos.get(name, ())

    def __repr__(self) -> str:
        """Show path, topics, messages, and what is wrong."""
        count = sum(info.count for info in self.topics.values())
        return (f'<Bag {self.path}: {count} messages on {len(self.topics)} topics'
                + (f', {self.problem}' if self.problem else '') + '>')

    def __getitem__(self, topic: Any) -> Any:
        """Raise BagError with what reads a topic."""
        info = self._topic(topic) if isinstance(topic, str) else None
        by = 'joint_states' if info and joint_kind(info.type_name, info.encoding) else (
            'doubles' if info and info.type_name in _NUMBER_DECODERS else '')
        name = info.name if info else 'topic'
        raise BagError(f'a bag has no [{topic!r}]: ' + (
            f'{by}({name!r}) returns it as arrays' if by else
            f'messages([{name!r}]) yields the bytes of each of its messages'))

    def __iter__(self) -> Iterator[BagMessage]:
        """Yield every message."""
        return self.messages()

    def messages(self, topics: Collection[str] | str | None = None) -> Iterator[BagMessage]:
        """Return an iterator over the messages of some topics, of all where None, as recorded.

        Messages that were compressed one by one are yielded unpacked.

        Args:
            topics: Their names, of which the bag need not have all; or the name of one that it
                has.

        Raises:
            BagError: the bag has no topic of that name, or a message is damaged.
        """
        return self._messages((self._topic(topics).name,) if isinstance(topics, str) else topics)

    def _messages(self, topics: Collection[str] | None) -> Iterator[BagMessage]:
        for file in self._files:
            channels = file.channels
            for number, log_time_ns, data in file.messages():
                topic, type_name, _ = channels[number]
                if topics is None or topic in topics:
                    yield BagMessage(topic, type_name, log_time_ns,
                                     unpack_message(data) if self._packed else data)

    def in_time_order(self, topics: Collection[str] | str | None = None) -> Iterator[BagMessage]:
        """Yield as :meth:`messages`, sorted by log time, equal times in recorded order.

        Recorders write what they have received topic by topic. A message whose place in the file
        is more than ``OUT_OF_PLACE`` later than its log time is yielded at that place.
        """
        waiting: list[tuple[int, int, BagMessage]] = []
        before_ns = 0
        for number, message in enumerate(self.messages(topics)):
            time_ns = message.log_time_ns
            heappush(waiting, (time_ns, number, message))
            # Wait for a second message after a jump: a single one may have a wrong time.
            while time_ns <= before_ns + OUT_OF_PLACE and waiting[0][0] < time_ns - OUT_OF_PLACE:
                yield heappop(waiting)[2]
            before_ns = time_ns
        while waiting:
            yield heappop(waiting)[2]

    @checked_call
    def joint_states(self, topic: str, joints: Sequence[str] | None = None, *,
                     skip_foreign: bool = False) -> JointSeries:
        """Return a topic of joint values as arrays, matched by joint name.

        Its type is JointState or DynamicJointState. Where each message holds some of the joints
        only, with ``skip_foreign`` the parts are joined, see `merged`.

        Args:
            topic: Topic name, such as ``'/joint_states'``; ``topics`` has those there are.
            joints: Which joints in which order; those of the first message where None.
            skip_foreign: Count messages that cannot be matched instead of raising, for topics
                on which other publishers publish other joints.

        Raises:
            BagError: no such topic, another type, or a message that does not match: names it.
        """
        info = self._topic(topic)
        kind = joint_kind(info.type_name, info.encoding)
        if kind is None:
            if readable := _ENCODINGS.get(info.type_name):
                raise BagError(f'{self.path}: messages of topic {topic!r} are encoded as '
                               f'{info.encoding!r}: expected {readable} for {info.type_name}'
                               + _HINTS.get(info.encoding, ''))
            raise BagError(f'{self.path}: topic {topic!r} has type {info.type_name!r}: expected '
                           f'{JOINT_STATE} or {DYNAMIC_JOINT_STATE}'
                           + _HINTS.get(info.encoding, ''))
        try:
            return series_of(self._joint_messages(info), kind, joints, skip_foreign=skip_foreign)
        except BagError as exc:
            if skip_foreign and joints and (parts := parts_of(
                    lambda: self._joint_messages(info), kind, joints)):
                return merged(parts, joints)
            raise BagError(f'{self.path}: {info.name} {exc}') from exc

    def _joint_messages(self, info: TopicInfo) -> Iterator[tuple[int, bytes]]:
        return ((message.log_time_ns, message.data) for message in self.messages((info.name,)))

    def doubles(self, topic: str) -> tuple[np.ndarray, np.ndarray]:
        """Return a Float64MultiArray, Float64 or Int32 topic as arrays.

        Returns:
            Times of reception, shape (N,) [ns], and values, shape (N, k) for arrays of k
            numbers, (N,) for the others.

        Raises:
            BagError: no such topic, another type, a damaged message, or arrays whose length
                changes: names the message.
        """
        info = self._topic(topic)
        if info.type_name not in _NUMBER_DECODERS:
            raise BagError(f'{self.path}: topic {topic!r} has type {info.type_name!r}: expected '
                           f'{" or ".join(_NUMBER_DECODERS)}'
                           + ('; joint_states(topic) reads it' if joint_kind(
                               info.type_name, info.encoding) else ''))
        decode = _NUMBER_DECODERS[info.type_name]
        times: list[int] = []
        values: list[Any] = []
        for index, message in enumerate(self.messages((info.name,))):
            try:
                values.append(decode(message.data))
            except BagError as exc:
                raise BagError(f'{self.path}: {info.name} message {index}: {exc}') from exc
            times.append(message.log_time_ns)
            if np.shape(values[-1]) != np.shape(values[0]):
                raise BagError(f'{self.path}: {info.name} message {index} has '
                               f'{np.size(values[-1])} values: expected {np.size(values[0])} '
                               'as in the first')
        if not values:
            raise BagError(f'{self.path}: topic {topic!r} has no message')
        return np.array(times, dtype=np.int64), np.array(values, dtype=np.float64)

    def _topic(self, topic: str) -> TopicInfo:
        """Find a topic, with or without the leading slash."""
        plain = topic.lstrip('/')
        info = self.topics.get(topic) or self.topics.get(plain) or self.topics.get('/' + plain)
        if info is None:
            raise BagError(f'{self.path}: no topic {topic!r}: expected one of '
                           f'{sorted(self.topics)}')
        return info


@checked_call
def read_bag(path: Path | str) -> Bag:
    """Open a rosbag2 folder (MCAP or SQLite), or a lone .mcap or .db3 file.

    A file that breaks off is read up to the break, which `Bag.problem` tells; a folder needs no
    metadata.yaml.

    Args:
        path: The folder or the file.

    Raises:
        BagError: names the path: it is missing, of another type, or has no message.
    """
    try:
        path = Path(path)
    except TypeError:
        raise BagError(f'bag is {path!r}: expected a path') from None
    if path.name == METADATA_NAME:
        path = path.parent
    if not path.is_dir():
        return Bag(path, [open_file(path)])
    if not (path / METADATA_NAME).exists():
        return Bag(path, [open_file(file) for file in storage_files(path)])
    metadata = load_metadata(path)
    if metadata.compression_format not in ('', 'none', 'zstd', 'lz4'):
        raise BagError(f'{path}: compression format {metadata.compression_format!r} cannot be '
                       'read: expected zstd or lz4')
    files = {item.path: named_file(path, item.path) for item in metadata.files}
    there = [file for file in files.values() if file]
    if not there:
        raise BagError(f'{path}: none of its files is there: {list(files)}')
    missing = [name for name, file in files.items() if not file]
    problem = f'{path}: {", ".join(missing)} is missing' if missing else None
    return Bag(path, [open_file(file) for file in there], metadata, problem)
