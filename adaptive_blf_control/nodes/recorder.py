# SPDX-License-Identifier: Apache-2.0
"""``recorder``: every message, byte for byte as it came over the wire, into an MCAP bag."""

from __future__ import annotations

from contextlib import suppress
import importlib
import sys
import time
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.context import Context
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSDurabilityPolicy, QoSReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.task import Future
import yaml

from adaptive_blf_control.bags.metadata import default_qos
from adaptive_blf_control.bags.writer import BagWriter
from adaptive_blf_control.configuration.node_settings import RecorderSettings
from adaptive_blf_control.configuration.parameter_file import PARAMETERS_KEY
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.definitions import message_definition
from adaptive_blf_control.messages.topics import JOINT_STATES, TOPICS
from adaptive_blf_control.runtime.answers import stamp_of
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.endpoints import full_name
from adaptive_blf_control.runtime.process import run_node
from adaptive_blf_control.runtime.sample_dates import has_sample_time, SampleDates

__all__ = ['Recorder', 'main']

LOOK_AROUND = 0.25  # s between looks at the graph
# The middleware stamps and keeps what arrives; fetching it in batches leaves the processor to
# those that have to answer within a millisecond.
BATCH = 0.01  # s
SHARED = ('/diagnostics', '/parameter_events', '/rosout')
DEPTH = 5000
LATEST = 2**63 - 2  # ns; a message with a wild time is one message, not the end of the recording


class _Heard(NamedTuple):
    """A topic that is being recorded: what was asked for, and what hears it."""

    type_name: str
    message_type: type
    reliable: bool
    latched: bool
    subscription: Subscription


class Recorder(DataNode[RecorderSettings]):
    """Raw subscriptions into a bag that a crash can cost at most one flush period.

    Attributes:
        bag: The open writer.
        received: Messages per topic that reached this node.
        lost: Messages per topic that were published and never reached it, seen as gaps in the
            publisher's sequence numbers (topics with one publisher).
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        """Open the bag and subscribe; BagError where the folder exists."""
        super().__init__('recorder', RecorderSettings, context=context, **options)
        self.bag = BagWriter(self.settings.bag)
        self.received: dict[str, int] = {}
        self.lost: dict[str, int] = {}
        self._sequence: dict[str, int] = {}
        self._failure: str | None = None
        self._unwritten: dict[str, int] = {}  # messages of a topic that the disk did not take
        self._pending: dict[str, str] = {}
        self._heard: dict[str, _Heard] = {}
        for topic in self.settings.topics:
            name = self.resolve_topic_name(topic)
            self._pending[name] = TOPICS.get(topic, '')
        self._settings: dict[str, dict[str, Any]] = {}
        self._settings_changed = False
        self._asked: set[str] = set()
        self._askers: dict[str, AsyncParameterClient] = {}
        self._remember(self.get_fully_qualified_name(), self.settings.values())
        self._states = self.resolve_topic_name(JOINT_STATES)
        self._dates = SampleDates()
        self._stamped: set[str] = set()  # topics whose messages have the time of their sample
        self._looked_at = self._flushed_at = time.monotonic()
        self._subscribe_known()
        self.create_timer(LOOK_AROUND, self._ask_for_parameters)

    def _subscribe_known(self) -> None:
        graph = dict(self.get_topic_names_and_types()) if '' in self._pending.values() else {}
        for topic, type_name in list(self._pending.items()):
            type_name = type_name or next(iter(graph.get(topic, [])), '')
            if type_name:
                del self._pending[topic]
                self._subscribe(topic, type_name)

    def _subscribe(self, topic: str, type_name: str) -> None:
        package, _, name = type_name.partition('/msg/')
        try:
            message_type = getattr(importlib.import_module(f'{package}.msg'), name)
            message_definition(type_name)  # a bag cannot hold messages without it
        except (ImportError, AttributeError, BagError):
            self.get_logger().error(f'{topic}: message type {type_name!r} is not installed here: '
                                    f'the topic is not recorded')
            return
        self.received[topic] = self.lost[topic] = 0
        if has_sample_time(message_type):
            self._stamped.add(topic)
        self._hear(topic, type_name, message_type)

    def _hear(self, topic: str, type_name: str, message_type: type) -> None:
        """Subscribe with what every publisher that is known now can give."""
        def record(data: bytes, info: dict[str, int]) -> None:
            self._record(topic, type_name, data, info)

        reliable, latched = self._offered(topic)
        self._heard[topic] = _Heard(
            type_name, message_type, reliable, latched, self.data_subscription(
                message_type, topic, record, wake=False, depth=DEPTH, reliable=reliable,
                latched=latched))

    def _offered(self, topic: str) -> tuple[bool, bool]:
        """Return whether all publishers are reliable, and whether all are transient local."""
        profiles = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        return (all(p.reliability != QoSReliabilityPolicy.BEST_EFFORT for p in profiles),
                bool(profiles) and all(p.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
                                       for p in profiles))

    def _adapt(self) -> None:
        """Subscribe anew where a publisher that came later cannot be heard as asked."""
        for topic, heard in list(self._heard.items()):
            reliable, latched = self._offered(topic)
            missed = latched and not heard.latched and not self.received[topic]
            if missed or (heard.reliable and not reliable):
                self.end_data_subscription(heard.subscription)
                self._hear(topic, heard.type_name, heard.message_type)

    def _record(self, topic: str, type_name: str, data: bytes, info: dict[str, int]) -> None:
        self.received[topic] += 1
        self._count_gap(topic, info)
        sent = info['source_timestamp']
        if not self.lockstep:
            self.sampled()
            self._write(topic, type_name, data, info['received_timestamp'], sent)
            return
        stamp = stamp_of(data) if topic in self._stamped else None
        if not stamp:  # the time of its sample is not known yet
            self._dates.add(sent, topic, type_name, data)
            return
        if topic == self._states:
            self._dates.state(sent, stamp)
            self.sampled(stamp)
        self._write(topic, type_name, data, stamp, stamp)

    def _write(self, topic: str, type_name: str, data: bytes, log_ns: int,
               publish_ns: int) -> None:
        if self._failure is not None:
            self._not_written(topic, 1)
            return
        try:
            if topic not in self.bag.counts:
                self.bag.add_topic(topic, type_name, qos=self._offered_qos(topic))
            self.bag.write(topic, data, *(min(max(t, 0), LATEST) for t in (log_ns, publish_ns)))
        except BagError as error:
            self._not_written(topic, 1)
            self._fail(str(error))

    def _not_written(self, topic: str, count: int) -> None:
        self.drops['disk'] = self.drops.get('disk', 0) + count
        self._unwritten[topic] = self._unwritten.get(topic, 0) + count

    def _write_dated(self, now_ns: int | None = None) -> None:
        """Write what is dated by now under ``use_sim_time``; all that is left without a time."""
        for message in self._dates.take(now_ns):
            self._write(message.topic, message.type_name, message.data, message.stamp_ns,
                        message.stamp_ns)

    def _count_gap(self, topic: str, info: dict[str, int]) -> None:
        number = info.get('publication_sequence_number')
        if number is None or topic in SHARED:  # several publishers number on their own
            return
        last = self._sequence.get(topic)
        self._sequence[topic] = number
        if last is not None and number > last + 1:
            self.lost[topic] += number - last - 1

    def _offered_qos(self, topic: str) -> list[dict[str, Any]]:
        for info in self.get_publishers_info_by_topic(topic):
            best_effort = info.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT
            latched = info.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
            return default_qos('best_effort' if best_effort else 'reliable',
                               'transient_local' if latched else 'volatile')
        return default_qos()

    def _fail(self, reason: str) -> None:
        if self._failure is None:
            self._failure = reason
            self.exit_code = 1
            self.get_logger().error(f'recording stopped, what was written is kept: {reason}')
            with suppress(BagError):  # says the same again
                self.bag.close()
            for topic, count in self.bag.overcounted.items():
                self._not_written(topic, count)

    def spin_data(self, timeout: float = BATCH) -> int:
        """Take what has arrived within the last ``timeout`` [s]."""
        return super().spin_data(timeout)

    def idle(self) -> None:
        """Flush and look for topics and publishers that were not known yet."""
        self._write_dated(time.time_ns())
        now = time.monotonic()
        if now - self._flushed_at >= self.settings.flush_period:
            self._flushed_at = now
            self._flush()
        if now - self._looked_at >= LOOK_AROUND:
            self._looked_at = now
            self._subscribe_known()
            self._adapt()

    def _flush(self) -> None:
        if self._failure is None:
            try:
                self._keep_settings()
                self.bag.flush()
            except BagError as error:
                self._fail(str(error))

    def _ask_for_parameters(self) -> None:
        """Ask every node that publishes on a recorded topic for its parameters, once."""
        for topic in list(self.received):
            for info in self.get_publishers_info_by_topic(topic):
                node = full_name(info)
                if node is None or node in self._asked | {self.get_fully_qualified_name()}:
                    continue
                client = self._askers.get(node) or AsyncParameterClient(self, node)
                self._askers[node] = client
                if client.services_are_ready():
                    self._asked.add(node)
                    client.list_parameters([], 0).add_done_callback(
                        lambda future, n=node, c=client: self._on_names(n, c, future))

    def _on_names(self, node: str, client: AsyncParameterClient, future: Future) -> None:
        listed: ListParameters.Response = future.result()
        names = list(listed.result.names)
        client.get_parameters(names).add_done_callback(
            lambda answer: self._on_values(node, names, answer))

    def _on_values(self, node: str, names: list[str], future: Future) -> None:
        answer: GetParameters.Response = future.result()
        values = {name: parameter_value_to_python(value)
                  for name, value in zip(names, answer.values)}
        self._remember(node, values)

    def _remember(self, node: str, values: dict[str, Any]) -> None:
        plain = {name: list(value) if hasattr(value, '__len__') and not isinstance(value, str)
                 else value for name, value in values.items()}
        self._settings[node] = {'ros__parameters': plain}
        self._settings_changed = True  # the loop writes them: the bag belongs to its thread

    def _keep_settings(self) -> None:
        if self._settings_changed:
            self._settings_changed = False
            self.bag.set_custom_data(
                {PARAMETERS_KEY: yaml.safe_dump(dict(self._settings), sort_keys=False)})

    def finish(self) -> None:
        """Drain what has arrived, then close file, index and metadata."""
        if self.context.ok():
            self.take_the_rest()
        self._write_dated()
        try:
            self._keep_settings()
        except BagError as error:
            self._fail(str(error))
        finally:
            try:
                self.bag.close()
            except BagError as error:
                self._fail(str(error))
        counts = self.bag.counts
        for topic, received in self.received.items():
            unwritten = self._unwritten.get(topic, 0)
            self.get_logger().info(f'{topic}: received {received}, written {counts.get(topic, 0)}'
                                   + (f', dropped {unwritten}' if unwritten else '')
                                   + f', lost {self.lost[topic]}')

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Report counts per topic; in lockstep they would say how fast the machine is."""
        counts = self.bag.counts
        values: dict[str, object] = {}
        for topic, received in () if self.lockstep else list(self.received.items()):
            values[f'{topic} received'] = received
            values[f'{topic} written'] = counts.get(topic, 0)
            values[f'{topic} lost'] = self.lost[topic]
        if self._failure is not None:
            return DiagnosticStatus.ERROR, self._failure, values
        return DiagnosticStatus.OK, f'recording to {self.bag.path}', values


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_node('recorder', Recorder, args)


if __name__ == '__main__':
    sys.exit(main())
