# SPDX-License-Identifier: Apache-2.0
"""``recorder``: every message, byte for byte as it came over the wire, into an MCAP bag."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.context import Context
from rclpy.qos import QoSDurabilityPolicy, QoSReliabilityPolicy
from rclpy.subscription import Subscription

from adaptive_blf_control.bags.metadata import default_qos
from adaptive_blf_control.configuration.node_settings import RecorderSettings
from adaptive_blf_control.errors import BagError, BlfError
from adaptive_blf_control.messages.definitions import message_definition
from adaptive_blf_control.messages.stamp import stamp_of
from adaptive_blf_control.messages.topics import JOINT_STATES, RECORDED, TOPICS
from adaptive_blf_control.nodes.bag_output import BagOutput
from adaptive_blf_control.nodes.parameter_survey import ParameterSurvey
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.endpoints import full_name
from adaptive_blf_control.runtime.message_class import message_class
from adaptive_blf_control.runtime.sample_dates import has_sample_time, SampleDates
from adaptive_blf_control.runtime.status_report import Status

__all__ = ['Recorder']

GRAPH_PERIOD = 0.25  # s between looks at the graph
# The middleware stamps and keeps what arrives; fetching it in batches leaves the processor to the
# nodes that have to answer within a millisecond.
BATCH_PERIOD = 0.01  # s
SHARED = ('/diagnostics', '/parameter_events', '/rosout')  # topics that every node publishes
QUEUE_DEPTH = 5000  # a disk may keep the recorder waiting


class _Recorded(NamedTuple):
    """A topic that is being recorded: what was asked for, and the subscription."""

    type_name: str
    message_type: type
    reliable: bool
    latched: bool
    subscription: Subscription


class Recorder(DataNode[RecorderSettings]):
    """Raw subscriptions into a bag that a crash can cost at most one flush period.

    Attributes:
        output: The bag.
        unknown: Topics that cannot be subscribed to yet, with their type where it is declared.
        received: Messages per topic that reached this node.
        lost: Messages per topic that were published and never reached it, seen as gaps in the
            publisher's sequence numbers (topics with one publisher).
        survey: Asks the other nodes for their parameters.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        """Open the bag and subscribe; BagError where the folder exists."""
        super().__init__('recorder', RecorderSettings, context=context, **options)
        self.received: dict[str, int] = {}
        self.lost: dict[str, int] = {}
        self.unknown = {self.resolve_topic_name(topic): RECORDED.get(topic, '')
                        for topic in self.settings.topics}
        self._latched = {self.resolve_topic_name(topic.name) for topic in TOPICS.values()
                         if topic.latched}
        self._sequence: dict[str, int] = {}
        self._recorded: dict[str, _Recorded] = {}
        self.survey = ParameterSurvey(self, lambda *known: self.output.keep_parameters(*known))
        self._states = self.resolve_topic_name(JOINT_STATES)
        self._dates = SampleDates()
        self._stamped: set[str] = set()  # topics whose messages have the time of their sample
        self._looked_at = self._flushed_at = time.monotonic()
        self._subscribe_known()
        self.create_timer(GRAPH_PERIOD, self._ask_for_parameters)
        self.output = self._opened()

    def _opened(self) -> BagOutput:
        """Open the bag, last of all.

        A process that is told to end before it runs may be cut short, its bag not closed.
        """
        if self.stop.is_set():
            raise BlfError('told to end before it began to record')
        output = BagOutput(self.settings.bag, self.faults, self._failed)
        output.keep_parameters(self.get_fully_qualified_name(), self.settings.values())
        return output

    def _failed(self, reason: str) -> None:
        self.exit_code = 1
        self.faults.report('disk', f'recording stopped, what was written is kept: {reason}')

    def _subscribe_known(self) -> None:
        graph = dict(self.get_topic_names_and_types()) if '' in self.unknown.values() else {}
        for topic, type_name in list(self.unknown.items()):
            type_name = type_name or next(iter(graph.get(topic, [])), '')
            if type_name:
                del self.unknown[topic]
                self._record_topic(topic, type_name)

    def _record_topic(self, topic: str, type_name: str) -> None:
        try:
            message_type = message_class(type_name)
            message_definition(type_name)  # a bag cannot hold messages without it
        except BagError:
            self.get_logger().error(f'{topic}: message type {type_name!r} is not installed here: '
                                    f'the topic is not recorded')
            return
        self.received[topic] = self.lost[topic] = 0
        if has_sample_time(message_type):
            self._stamped.add(topic)
        self._subscribe(topic, type_name, message_type)

    def _subscribe(self, topic: str, type_name: str, message_type: type) -> None:
        """Subscribe with what every publisher that is known now can give."""
        def record(data: bytes, info: dict[str, int]) -> None:
            self.record(topic, type_name, data, info)

        reliable, latched = self._offered(topic)
        self._recorded[topic] = _Recorded(
            type_name, message_type, reliable, latched, self.topics.subscribe(
                message_type, topic, record, wake=False, depth=QUEUE_DEPTH, reliable=reliable,
                latched=latched))

    def _offered(self, topic: str) -> tuple[bool, bool]:
        """Return whether all publishers are reliable, and whether all are transient local.

        Before there is one, what its declaration says: what is sent once must not be missed.
        """
        profiles = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        if not profiles:
            return True, topic in self._latched
        return (all(p.reliability != QoSReliabilityPolicy.BEST_EFFORT for p in profiles),
                all(p.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for p in profiles))

    def _adapt(self) -> None:
        """Subscribe again where a later publisher does not offer what was asked for."""
        for topic, recorded in list(self._recorded.items()):
            reliable, latched = self._offered(topic)
            missed = latched and not recorded.latched and not self.received[topic]
            deaf = recorded.reliable > reliable or recorded.latched > latched
            if missed or deaf:
                self.topics.unsubscribe(recorded.subscription)
                self._subscribe(topic, recorded.type_name, recorded.message_type)

    def record(self, topic: str, type_name: str, data: bytes, info: dict[str, int]) -> None:
        """Count and write one message; in lockstep it may have to wait for its date."""
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
        self.output.write(topic, type_name, lambda: self._offered_qos(topic), data, log_ns,
                          publish_ns)

    def _write_dated(self, now_ns: int | None = None) -> None:
        """Write what is dated by now under ``use_sim_time``; all that is left without a time."""
        for message in self._dates.take(now_ns):
            self._write(message.topic, message.type_name, message.data, message.stamp_ns,
                        message.stamp_ns)

    def _count_gap(self, topic: str, info: dict[str, int]) -> None:
        number = info.get('publication_sequence_number')
        if number is None or topic in SHARED:  # several publishers, each with its own numbers
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

    def _ask_for_parameters(self) -> None:
        """Ask every node that publishes on a recorded topic for its parameters."""
        names = {full_name(info) for topic in list(self.received)
                 for info in self.get_publishers_info_by_topic(topic)}
        self.survey.ask({name for name in names if name} - {self.get_fully_qualified_name()})

    def spin_data(self, timeout: float = BATCH_PERIOD) -> int:
        """Take what has arrived within the last ``timeout`` [s]."""
        return super().spin_data(timeout)

    def wait_to_start(self, timeout: float) -> None:
        """Record already: recording disturbs no other node."""
        self.spin_data(timeout)
        self.idle()

    def withdraw(self) -> None:
        """Leave no bag: another recorder has the same messages, or this one is asked for again."""
        self.output.discard()

    def idle(self) -> None:
        """Flush, and look for topics and publishers that were not known yet."""
        self._write_dated(time.time_ns())
        now = time.monotonic()
        if now - self._flushed_at >= self.settings.flush_period:
            self._flushed_at = now
            self.output.flush()
        if now - self._looked_at >= GRAPH_PERIOD:
            self._looked_at = now
            self._subscribe_known()
            self._adapt()

    def finish(self) -> None:
        """Take what has arrived, then close file, index and metadata."""
        if self.context.ok():
            self.take_the_rest()
        self._write_dated()
        self.output.close()
        counts = self.output.bag.counts
        for topic, received in self.received.items():
            unwritten = self.output.unwritten.get(topic, 0)
            self.get_logger().info(f'{topic}: received {received}, written {counts.get(topic, 0)}'
                                   + (f', dropped {unwritten}' if unwritten else '')
                                   + f', lost {self.lost[topic]}')

    def status(self) -> Status:
        """Report counts per topic; in lockstep they would say how fast the machine is."""
        counts = self.output.bag.counts
        values: dict[str, object] = {}
        for topic, received in () if self.lockstep else list(self.received.items()):
            values[f'{topic} received'] = received
            values[f'{topic} written'] = counts.get(topic, 0)
            values[f'{topic} lost'] = self.lost[topic]
        if self.output.failure:
            return DiagnosticStatus.ERROR, self.output.failure, values
        return DiagnosticStatus.OK, f'recording to {self.output.bag.path}', values
