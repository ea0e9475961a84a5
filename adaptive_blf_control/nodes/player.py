# SPDX-License-Identifier: Apache-2.0
"""Publishes a bag again, byte for byte and with its clock, without rosbag2."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import time

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from adaptive_blf_control.bags.reader import BagMessage, read_bag
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.cdr_cursor import is_cdr
from adaptive_blf_control.messages.topics import CLOCK
from adaptive_blf_control.nodes.play_clock import PlayClock
from adaptive_blf_control.nodes.play_qos import qos_of
from adaptive_blf_control.nodes.play_settings import PlaySettings
from adaptive_blf_control.nodes.play_topics import choose_topics
from adaptive_blf_control.nodes.player_lockstep import Lockstep
from adaptive_blf_control.runtime.endpoints import POLL_PERIOD
from adaptive_blf_control.runtime.message_class import message_class
from adaptive_blf_control.runtime.process import stop_on_signals
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['Player', 'account', 'play']

DELIVERY_TIMEOUT = 5.0  # s for reliable readers to confirm what was sent last


class Player:
    """One bag, its publishers and its clock.

    Attributes:
        node: The node that publishes.
        stop: Set it to end :meth:`play`.
        sent: Messages published so far, by topic.
        skipped: Topics of the bag that are not published, with the reason.
        lockstep: Waits for the answers; None where time is kept instead.
        clock: The pace, and the messages published on /clock that were not in the bag.
        seconds: How long playing took so far [s].
        bag_seconds: How much of the bag's time was played [s].
    """

    def __init__(self, path: str, settings: PlaySettings, *, context: Context | None = None,
                 namespace: str = '', stop: StopFlag | None = None) -> None:
        """Open the bag and make its publishers; ``stop`` is the player's own if None.

        Raises:
            BagError: the bag cannot be read, a topic is not in it, or none can be published.
        """
        self.settings = settings
        self.stop = stop or StopFlag()
        self.bag = read_bag(path)
        self.skipped: dict[str, str] = {}
        topics = self._chosen()
        if settings.lockstep:
            topics, self.skipped = choose_topics(self.bag, topics if settings.topics else (),
                                                 settings.answers)
        self.node = Node('player', context=context, namespace=namespace, enable_rosout=False,
                         start_parameter_services=False)
        self.sent: dict[str, int] = {}
        self._offers: dict[str, Publisher] = {}
        self._kinds: dict[str, type] = {}
        for topic in topics:
            self._offer(topic)
        if not self._offers:
            self.close()
            raise BagError(f'{path}: no topic can be published: ' + '; '.join(
                f'{topic}: {reason}' for topic, reason in self.skipped.items()))
        self.lockstep = Lockstep(self.node, self.bag, self._offers, settings.answers,
                                 settings.timeout, self.stop) if settings.lockstep else None
        self.seconds = self.bag_seconds = 0.0
        self.clock = PlayClock(self.node, 0.0 if CLOCK in self._offers else settings.clock,
                               None if settings.lockstep else settings.rate, self.stop)

    def _chosen(self) -> list[str]:
        if not self.settings.topics:
            return [topic for topic, info in self.bag.topics.items() if info.count]
        plain = {topic.lstrip('/'): topic for topic in self.bag.topics}
        for topic in self.settings.topics:
            if topic.lstrip('/') not in plain:
                raise BagError(f'{self.bag.path}: no topic {topic!r}: expected of '
                               f'{", ".join(sorted(self.bag.topics))}')
        return [plain[topic.lstrip('/')] for topic in self.settings.topics]

    def _offer(self, topic: str) -> None:
        info = self.bag.topics[topic]
        if info.encoding != 'cdr' or not info.type_name:
            self.skipped[topic] = ('the bag states no type' if info.encoding == 'cdr' else
                                   f'its messages are encoded as {info.encoding!r}: only those '
                                   "encoded as 'cdr', as ROS 2 records, can be published")
            return
        try:
            kind = message_class(info.type_name)
        except BagError as error:
            self.skipped[topic] = str(error)
            return
        self.sent.setdefault(topic, 0)
        self._kinds[topic] = kind
        self._offers[topic] = self.node.create_publisher(
            kind, topic, qos_of(self.bag.offered_qos.get(topic, ())))

    def wait_for_subscribers(self) -> list[str]:
        """Wait until every topic has a subscriber; return those that have none in time.

        Raises:
            NoAnswer: in lockstep, no node subscribes to the states, or none answers.
        """
        if self.lockstep is not None:
            self.lockstep.discover()
        give_up = time.monotonic() + self.settings.wait
        while True:
            missing = [topic for topic, publisher in self._offers.items()
                       if publisher.get_subscription_count() == 0]
            if not missing or time.monotonic() >= give_up or self.stop.wait(POLL_PERIOD):
                return missing

    def play(self) -> None:
        """Publish the bag once, or again and again, until its end or :attr:`stop`.

        Raises:
            NoAnswer: in lockstep, no node subscribes to the states or answers one of them.
            BagError: a message is not what its topic claims; nothing of it is published.
        """
        if self.lockstep is not None:
            self.lockstep.discover()
        begin = time.monotonic()
        try:
            while not self.stop.is_set():
                self._once()
                if not self.settings.loop:
                    break
        finally:
            self.seconds = time.monotonic() - begin
        for publisher in self._offers.values():
            if self.stop.is_set():
                return
            if publisher.get_subscription_count():
                publisher.wait_for_all_acked(Duration(seconds=DELIVERY_TIMEOUT))

    def _once(self) -> None:
        first_ns, last_ns = -1, 0
        before = self.bag_seconds
        for message in self._messages():
            if first_ns < 0:
                first_ns = message.log_time_ns
                self.clock.begin(first_ns)
            last_ns = max(last_ns, message.log_time_ns)
            self.clock.tick_until(last_ns)
            if not self.clock.wait_until(message.log_time_ns):
                return
            self._check(message)
            publisher = self._offers[message.topic]
            if self.lockstep is None:
                publisher.publish(message.data)
            else:
                self.lockstep.send(message.topic, publisher, message.data)
            self.sent[message.topic] += 1
            self.bag_seconds = before + (last_ns - first_ns) * 1e-9

    def _check(self, message: BagMessage) -> None:
        """Refuse bytes that are no message of the type that their topic claims.

        Raises:
            BagError: see above.
        """
        if not is_cdr(message.data):
            raise BagError(f'{self.bag.path}: a message of {message.topic} is no CDR: first '
                           f'bytes 0x{message.data[:4].hex()}')
        if self.lockstep is not None:
            return  # which counts states that cannot be read, and goes on
        try:
            deserialize_message(message.data, self._kinds[message.topic])
        except Exception as error:  # what rclpy raises depends on the middleware
            raise BagError(f'{self.bag.path}: a message of {message.topic} of '
                           f'{len(message.data)} bytes is no '
                           f'{self.bag.topics[message.topic].type_name}') from error

    def _messages(self) -> Iterator[BagMessage]:
        for topic in self.sent.keys() - self._offers.keys():  # retired at the end of the last pass
            self._offer(topic)
        topics = list(self._offers)
        return (self.bag.in_time_order(topics) if self.lockstep is None
                else self.lockstep.messages(topics, self._retire))

    def _retire(self, topic: str) -> None:
        self.node.destroy_publisher(self._offers.pop(topic))

    def close(self) -> None:
        """End the node."""
        self.node.destroy_node()


def play(path: str, settings: PlaySettings, ros_arguments: Sequence[str]) -> Player:
    """Play a bag as a process does: signals end it cleanly.

    Args:
        path: The bag.
        settings: How.
        ros_arguments: ``--ros-args ...``, e.g. remappings; may be empty.

    Returns:
        The player, closed, with its counts.

    Raises:
        BagError: as :class:`Player`.
        NoAnswer: as :meth:`Player.play`.
        RuntimeError: ROS does not accept an argument.
    """
    stop = stop_on_signals()
    rclpy.init(args=list(ros_arguments), signal_handler_options=SignalHandlerOptions.NO)
    try:
        player = Player(path, settings, stop=stop)
        try:
            _announce(player)
            player.play()
        finally:
            player.close()
    finally:
        try_shutdown()
    return player


def _announce(player: Player) -> None:
    """Print what is played and what is not, and wait for subscribers."""
    for topic, reason in player.skipped.items():
        print(f'{topic}: not played: {reason}', flush=True)
    for topic in player.wait_for_subscribers():
        print(f'{topic}: nobody listens', flush=True)
    count = sum(player.bag.topics[topic].count for topic in player.sent)
    how = (f'at {player.settings.rate:g} x its pace' if player.lockstep is None else
           f'in lockstep with {", ".join(player.lockstep.answers.topics)}')
    print(f'playing {player.bag.path}: {count} messages on {len(player.sent)} topics, {how}',
          flush=True)


def account(player: Player) -> str:
    """Return how much was played, how long it took, and how it was answered."""
    pace = f'{player.bag_seconds / player.seconds:.3g}' if player.seconds > 0.0 else '-'
    text = (f'{sum(player.sent.values())} messages on {len(player.sent)} topics, '
            f'{player.clock.ticks} ticks of the clock: {player.bag_seconds:.1f} s of the bag in '
            f'{player.seconds:.1f} s, {pace} x its pace')
    lockstep = player.lockstep
    if lockstep is not None:
        text += f'\n{lockstep.answered} of {player.sent[lockstep.states]} states answered'
        if lockstep.resent:
            text += f', {lockstep.resent} times one was sent again'
        for names, count in lockstep.unanswered.items():
            text += f'\n{count} not waited for: ' + (f'joints {list(names)}' if names else
                                                     'they cannot be read')
    return text
