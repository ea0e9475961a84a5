# SPDX-License-Identifier: Apache-2.0
"""Publishes a bag again, byte for byte and with its clock, where there is no rosbag2."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import time
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from rosgraph_msgs.msg import Clock

from adaptive_blf_control.bags.reader import BagMessage, read_bag
from adaptive_blf_control.errors import BagError, ParameterError
from adaptive_blf_control.messages.topics import THETA_HAT
from adaptive_blf_control.nodes.player_lockstep import choose_topics, Lockstep
from adaptive_blf_control.runtime.message_class import message_class
from adaptive_blf_control.runtime.process import stop_on_signals
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['Player', 'PlaySettings', 'account', 'play', 'qos_of']

CLOCK = '/clock'
# Deep enough that a burst at a high rate is not overwritten before a reliable reader has it.
DEPTH = 1000
LATCHED_DEPTH = 10
POLL = 0.01  # s between looks for subscribers
DELIVERY = 5.0  # s for reliable readers to confirm what was sent last
INFINITE = 9_000_000_000  # s, and longer


@dataclass(frozen=True)
class PlaySettings:
    """How to play.

    Attributes:
        rate: Bag seconds per second.
        topics: Which topics, with or without leading slash; all where empty.
        loop: Begin again at the end, until stopped.
        wait: How long to wait for a subscriber of each topic [s].
        clock: Ticks of /clock per bag second; 0 for none. A bag that has /clock plays its own.
        lockstep: Wait for no time, but for the answers to each state.
        answers: In lockstep, topics that answer, relative to the namespace of the states.
        timeout: In lockstep, how long an answer may take [s].
    """

    rate: float = 1.0
    topics: tuple[str, ...] = ()
    loop: bool = False
    wait: float = 5.0
    clock: float = 100.0
    lockstep: bool = False
    answers: tuple[str, ...] = (THETA_HAT,)
    timeout: float = 10.0

    def __post_init__(self) -> None:
        """Refuse what cannot be played."""
        if not 0.0 < self.rate < 1e6:
            raise ParameterError('--rate', self.rate, 'a number above 0')
        if not 0.0 <= self.clock <= 1e5:
            raise ParameterError('--clock', self.clock, '0 to 100000 Hz')
        if not 0.0 <= self.wait < 1e6:
            raise ParameterError('--wait', self.wait, 'seconds, 0 or more')
        if not 0.0 < self.timeout < 1e6:
            raise ParameterError('--timeout', self.timeout, 'seconds, above 0')
        if self.lockstep and not self.answers:
            raise ParameterError('--answers', [], 'at least one topic')


def qos_of(profiles: Sequence[Mapping[str, Any]]) -> QoSProfile:
    """Return what to offer so that whoever heard the recorded publishers hears this one.

    Where they differed, the strongest offer is made: every subscriber accepts it. History and
    depth are not discovered over DDS, so a bag does not know them.
    """
    latched = any(_word(p, 'durability') in ('transient_local', '1') for p in profiles)
    best_effort = bool(profiles) and all(
        _word(p, 'reliability') in ('best_effort', '2') for p in profiles)
    known = max((int(p.get('depth', 0)) for p in profiles), default=0)
    qos = QoSProfile(depth=known or (LATCHED_DEPTH if latched else DEPTH))
    qos.reliability = (ReliabilityPolicy.BEST_EFFORT if best_effort
                       else ReliabilityPolicy.RELIABLE)
    qos.durability = (DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE)
    if len(profiles) == 1:
        _copy_times(profiles[0], qos)
    return qos


def _word(profile: Mapping[str, Any], key: str) -> str:
    return str(profile.get(key, '')).lower()


def _copy_times(profile: Mapping[str, Any], qos: QoSProfile) -> None:
    for key in ('deadline', 'lifespan', 'liveliness_lease_duration'):
        value = profile.get(key) or {}
        sec, nsec = int(value.get('sec', 0)), int(value.get('nsec', 0))
        if 0 < sec * 10**9 + nsec < INFINITE * 10**9:
            setattr(qos, key, Duration(seconds=sec, nanoseconds=nsec))
    if _word(profile, 'liveliness') in ('manual_by_topic', '3'):
        qos.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC


class Player:
    """One bag, its publishers and its clock.

    Attributes:
        node: The node that publishes.
        stop: Set it to end :meth:`play`.
        sent: Messages published so far, by topic.
        skipped: Topics of the bag that are not published, with the reason.
        ticks: Messages published on /clock that were not in the bag.
        lockstep: Who waits for the answers; None where time is kept instead.
        seconds: How long playing took so far [s].
        bag_seconds: How much of the bag's time was played [s].
    """

    def __init__(self, path: str, settings: PlaySettings, *, context: Context | None = None,
                 namespace: str = '', stop: StopFlag | None = None) -> None:
        """Open the bag and offer its topics; ``stop`` is the player's own where None.

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
        for topic in topics:
            self._offer(topic)
        if not self._offers:
            self.close()
            raise BagError(f'{path}: no topic can be published: ' + '; '.join(
                f'{topic}: {reason}' for topic, reason in self.skipped.items()))
        self.lockstep = Lockstep(self.node, self.bag, self._offers, settings.answers,
                                 settings.timeout, self.stop) if settings.lockstep else None
        self.seconds = self.bag_seconds = 0.0
        self.ticks = 0
        self._tick_ns = round(1e9 / settings.clock) if settings.clock > 0.0 else 0
        if CLOCK in self._offers:
            self._tick_ns = 0
        self._ticker = self.node.create_publisher(Clock, CLOCK, 10) if self._tick_ns else None
        self._message = Clock()
        self._next_tick_ns = 0

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
        try:
            kind = message_class(self.bag.topics[topic].type_name)
        except BagError as error:
            self.skipped[topic] = str(error)
            return
        self.sent.setdefault(topic, 0)
        self._offers[topic] = self.node.create_publisher(
            kind, topic, qos_of(self.bag.offered_qos.get(topic, ())))

    def wait_for_subscribers(self) -> list[str]:
        """Wait until every topic has a subscriber; return those that have none in time.

        Raises:
            NoAnswer: in lockstep, nobody listens to the states, or nobody answers.
        """
        if self.lockstep is not None:
            self.lockstep.discover()
        give_up = time.monotonic() + self.settings.wait
        while True:
            missing = [topic for topic, publisher in self._offers.items()
                       if publisher.get_subscription_count() == 0]
            if not missing or time.monotonic() >= give_up or self.stop.wait(POLL):
                return missing

    def play(self) -> None:
        """Publish the bag once, or again and again, until its end or :attr:`stop`.

        Raises:
            NoAnswer: in lockstep, nobody listens to the states or answers one of them.
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
                publisher.wait_for_all_acked(Duration(seconds=DELIVERY))

    def _once(self) -> None:
        begin_ns, first_ns, last_ns = time.monotonic_ns(), -1, 0
        before = self.bag_seconds
        for message in self._messages():
            if first_ns < 0:
                first_ns = self._next_tick_ns = message.log_time_ns
            last_ns = max(last_ns, message.log_time_ns)
            self._tick_until(last_ns, begin_ns, first_ns)
            if not self._wait_until(message.log_time_ns, begin_ns, first_ns):
                return
            publisher = self._offers[message.topic]
            if self.lockstep is None:
                publisher.publish(message.data)
            else:
                self.lockstep.send(message.topic, publisher, message.data)
            self.sent[message.topic] += 1
            self.bag_seconds = before + (last_ns - first_ns) * 1e-9

    def _messages(self) -> Iterator[BagMessage]:
        for topic in self.sent.keys() - self._offers.keys():  # retired at the end of the last pass
            self._offer(topic)
        topics = list(self._offers)
        return (self.bag.in_time_order(topics) if self.lockstep is None
                else self.lockstep.messages(topics, self._retire))

    def _retire(self, topic: str) -> None:
        self.node.destroy_publisher(self._offers.pop(topic))

    def _tick_until(self, now_ns: int, begin_ns: int, first_ns: int) -> None:
        """Publish the ticks up to bag time ``now_ns``, each when it is due."""
        clock = self._ticker
        while clock is not None and self._next_tick_ns <= now_ns:
            if not self._wait_until(self._next_tick_ns, begin_ns, first_ns):
                return
            self._message.clock.sec, self._message.clock.nanosec = divmod(
                self._next_tick_ns, 10**9)
            clock.publish(self._message)
            self.ticks += 1
            self._next_tick_ns += self._tick_ns

    def _wait_until(self, bag_ns: int, begin_ns: int, first_ns: int) -> bool:
        """Wait for the time of a message; False where the player was stopped."""
        if self.lockstep is not None:  # time is what the answers make of it
            return not self.stop.is_set()
        ahead = (bag_ns - first_ns) / self.settings.rate - (time.monotonic_ns() - begin_ns)
        return not (self.stop.wait(ahead * 1e-9) if ahead > 0.0 else self.stop.is_set())

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
        RuntimeError: ROS does not take an argument.
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
    """Print what is played and what is not, and wait for those who listen."""
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
    """Return what was played, in how long, and how it was answered."""
    pace = f'{player.bag_seconds / player.seconds:.3g}' if player.seconds > 0.0 else '-'
    text = (f'{sum(player.sent.values())} messages on {len(player.sent)} topics, '
            f'{player.ticks} ticks of the clock: {player.bag_seconds:.1f} s of the bag in '
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
