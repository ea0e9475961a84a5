# SPDX-License-Identifier: Apache-2.0
"""The raw topics of a node: what its own loop waits for and handles, and what it publishes."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import NamedTuple

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from adaptive_blf_control.messages.topics import published_by
from adaptive_blf_control.runtime.channels import (
    Batch,
    Channel,
    each_of,
    Handler,
    new_channel,
    new_wait,
    newest_of,
    Wait,
)
from adaptive_blf_control.runtime.loop_statistics import LoopStatistics
from adaptive_blf_control.runtime.message_class import message_class

__all__ = ['QUEUE_DEPTH', 'DataTopics']

# DDS history depth. Every 3 s reliable readers confirm what has arrived; Fast DDS then goes
# through all that the publisher keeps, and new messages wait meanwhile. So it keeps no more than
# needed.
QUEUE_DEPTH = 100
QUEUE_DEPTH_LOCKSTEP = 1000  # no step waits for the recorder, which has to keep up


class _Input(NamedTuple):
    channel: Channel
    handle: Batch
    newest_only: bool
    wake: bool

    def take(self) -> int:
        """Handle what waits; return how many messages that were."""
        messages = self.channel.messages()
        if messages:
            self.handle(messages)
        return len(messages)


class DataTopics:
    """Subscriptions and publishers of CDR bytes.

    The loop calls :meth:`ready`, waits, and calls :meth:`handle`. Everything but the wait has to
    happen between two samples.

    Attributes:
        direct: Whether the loop waits for the data itself, without rclpy's executor.
        publishers: Those that :meth:`publisher` has made and that still are there.
    """

    def __init__(self, node: Node, statistics: LoopStatistics, serve: Callable[[float], None], *,
                 direct: bool, lockstep: bool) -> None:
        """Start without topics.

        Args:
            node: Whose topics they are.
            statistics: Where superseded messages are counted.
            serve: Lets the executor serve once, within a time [s]; used where not ``direct``.
            direct: See the attribute.
            lockstep: Whether nothing may be lost, and a state may have to wait (:meth:`later`).
        """
        self.direct = direct
        self.publishers: list[Publisher] = []
        self._node = node
        self._statistics = statistics
        self._serve = serve
        self._lockstep = lockstep
        self._inputs: list[_Input] = []
        self._leaving: list[Subscription] = []
        self._later: Callable[[], object] | None = None
        self._wait: Wait | None = None

    def __len__(self) -> int:
        """Return how many subscriptions there are."""
        return len(self._inputs)

    @property
    def leaving(self) -> int:
        """How many subscriptions have ended and still wait to be destroyed."""
        return len(self._leaving)

    def publisher(self, message_type: type, topic: str, *, latched: bool = False,
                  depth: int = QUEUE_DEPTH) -> Publisher:
        """Return a reliable publisher; ``publish(bytes)`` sends CDR as it is.

        Args:
            message_type: Type of the topic.
            topic: Name of the topic.
            latched: Give the last message to late subscribers (transient local).
            depth: History depth; not in lockstep, where nothing may be lost.
        """
        qos = QoSProfile(depth=QUEUE_DEPTH_LOCKSTEP if self._lockstep else depth)
        if latched:
            qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = self._node.create_publisher(message_type, topic, qos)
        self.publishers.append(publisher)
        return publisher

    def declared(self, kind: str) -> dict[str, Publisher]:
        """Return a publisher for each topic that is declared for a kind of node, by name."""
        return {topic.name: self.publisher(message_class(topic.type_name), topic.name,
                                           latched=topic.latched)
                for topic in published_by(kind)}

    def end_publisher(self, publisher: Publisher) -> None:
        """Destroy what :meth:`publisher` returned."""
        self.publishers.remove(publisher)
        self._node.destroy_publisher(publisher)

    def subscribe(self, message_type: type, topic: str, handler: Handler, *, wake: bool = True,
                  newest_only: bool = False, reliable: bool = False, latched: bool = False,
                  depth: int = QUEUE_DEPTH) -> Subscription:
        """Subscribe to raw CDR.

        Args:
            message_type: Type of the topic.
            topic: Name of the topic.
            handler: Called with the bytes and the message info in the node's loop; returns False
                where it could not use the message.
            wake: Whether a message wakes the loop; else it is handled before those that do.
            newest_only: When several messages wait, handle the last that can be used and count
                the others as superseded: acting on old data is worse than not acting on it.
            reliable: Ask for reliable delivery; best effort also hears reliable publishers.
            latched: Ask for what a transient local publisher sent before.
            depth: History depth.
        """
        return self.subscribe_all(
            message_type, topic, (newest_of if newest_only else each_of)(handler), wake=wake,
            newest_only=newest_only, reliable=reliable, latched=latched, depth=depth)

    def subscribe_all(self, message_type: type, topic: str, handle: Batch, *, wake: bool = True,
                      newest_only: bool = False, reliable: bool = False, latched: bool = False,
                      depth: int = QUEUE_DEPTH) -> Subscription:
        """Subscribe to raw CDR; ``handle`` gets all messages that have arrived, in one call.

        The other arguments are those of :meth:`subscribe`; ``newest_only`` only counts here.
        """
        qos = QoSProfile(depth=depth)
        if latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        qos.reliability = (ReliabilityPolicy.RELIABLE if reliable
                           else ReliabilityPolicy.BEST_EFFORT)
        channel = new_channel(self.direct, self._node, message_type, topic, qos)
        # Those that do not wake come first: the others need what they bring.
        place = len(self._inputs) if wake else sum(not each.wake for each in self._inputs)
        self._inputs.insert(place, _Input(channel, handle, newest_only, wake))
        self._wait = None
        return channel.subscription

    def unsubscribe(self, subscription: Subscription) -> None:
        """Stop hearing what :meth:`subscribe` returned."""
        self._inputs = [each for each in self._inputs
                        if each.channel.subscription is not subscription]
        self._later = None  # it may have come from there
        self._leaving.append(subscription)  # the loop may be waiting for it

    def ready(self) -> Wait:
        """Return the wait for the subscriptions that there are now."""
        if self._leaving:
            self._wait = None
            while self._leaving:
                self._node.destroy_subscription(self._leaving.pop())
        if self._wait is None:
            self._wait = new_wait(self.direct, self._node,
                                  [each.channel for each in self._inputs if each.wake],
                                  self._serve)
        return self._wait

    def handle(self) -> int:
        """Hand what has arrived to the handlers; return how many messages that were."""
        handled = 0
        for each in self._inputs:
            taken = each.take()
            handled += taken
            if each.newest_only and taken > 1:
                self._statistics.superseded += taken - 1
        waiting, self._later = self._later, None
        if waiting is not None:
            waiting()
        return handled

    def drain(self) -> None:
        """Handle what waits on the topics that do not wake the loop; call it in a handler."""
        for each in self._inputs:
            if not each.wake:
                each.take()

    def later(self, again: Callable[[], object]) -> None:
        """Call ``again``, to handle a message once more, at the end of the next :meth:`handle`.

        In lockstep alone: there a sample waits for what answers the one before it. In real time
        a newer one comes.
        """
        if self._lockstep:
            self._later = again

    def deliver(self, timeout: float) -> None:
        """Wait until the last messages have arrived, for at most ``timeout`` [s] in all."""
        give_up = time.monotonic() + timeout
        for publisher in list(self.publishers):
            left = max(give_up - time.monotonic(), 0.0)
            publisher.wait_for_all_acked(Duration(seconds=left))
