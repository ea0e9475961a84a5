# SPDX-License-Identifier: Apache-2.0
"""A bag played in lockstep: each state is sent once the one before it has been answered.

The arrival of other messages, e.g. of the adaptation term, is not confirmed. With ``use_sim_time``
the identifier waits for the term that precedes a state; else it may use the one before that.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
import time

from rclpy.node import Node
from rclpy.publisher import Publisher

from adaptive_blf_control.bags.reader import Bag, BagMessage
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.joint_state import decode_joint_state
from adaptive_blf_control.messages.stamp import STAMP_LIMIT, stamp_of
from adaptive_blf_control.messages.topics import ADAPTATION_TERM
from adaptive_blf_control.nodes.play_topics import beside, states_topic
from adaptive_blf_control.runtime.answers import Answers, NoAnswer
from adaptive_blf_control.runtime.endpoints import POLL_PERIOD
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['Lockstep']

# Best effort readers may lose a state, or not have discovered the player when the first one is
# sent. The identifier does not learn twice from the same stamp, so a state can be sent again.
SEND_AGAIN = 1.0  # s
AHEAD = 20  # most adaptation terms that are sent before their time; the identifier keeps that many


class Lockstep:
    """Sends one state at a time.

    Attributes:
        states: Topic of the states in the bag.
        answers: The topics on which they are answered.
        answered: How many states were answered.
        resent: How often a state was sent again.
        unanswered: States that were not, counted by the names of their joints: those of other
            robots on the same topic. The empty tuple counts messages that cannot be read.
    """

    def __init__(self, node: Node, bag: Bag, publishers: Mapping[str, Publisher],
                 answers: Sequence[str], timeout: float, stop: StopFlag) -> None:
        """Prepare; nothing is waited for before :meth:`discover`."""
        self.states = states_topic(bag, [*publishers])
        self._publisher = publishers[self.states]
        live = self._publisher.topic_name  # after remapping
        self.answers = Answers(node, [beside(live, topic) for topic in answers], stop)
        self.answered = self.resent = 0
        self.unanswered: dict[tuple[str, ...], int] = {}
        self._bag = bag
        self._timeout = timeout
        self._stop = stop
        self._known: set[tuple[str, ...]] = set()  # joints of states that were answered

    def discover(self) -> None:
        """Wait until a node subscribes to the states and every answer has a publisher.

        Raises:
            NoAnswer: not within the timeout; names the topic.
        """
        begin = time.monotonic()
        while self._publisher.get_subscription_count() == 0 and not self._stop.wait(POLL_PERIOD):
            if time.monotonic() - begin >= self._timeout:
                raise NoAnswer(self._publisher.topic_name, None,
                               f'nobody listens within {self._timeout:g} s')
        self.answers.discover(max(self._timeout - (time.monotonic() - begin), 0.0))

    def messages(self, topics: Collection[str], retire: Callable[[str], None]
                 ) -> Iterator[BagMessage]:
        """Yield the messages of ``topics`` in the order in which they can be answered.

        By log time, except for the adaptation terms: an identifier that waits for the term of the
        preceding state waits until that one or a later one has arrived. In a bag from real time a
        term may be late, or missing where the controller did not answer a state.

        Args:
            topics: What is played.
            retire: Ends a topic that has no further messages, so that no node waits for them.
        """
        terms = beside(self.states, ADAPTATION_TERM)
        if terms not in topics:
            yield from self._bag.in_time_order(topics)
            return
        waiting = self._bag.in_time_order((terms,))
        term = next(waiting, None)
        sent_ns, before_ns, there = -1, -1, True  # stamps of the newest term, of the last state
        for message in self._bag.in_time_order([topic for topic in topics if topic != terms]):
            state, ahead = message.topic == self.states, AHEAD
            while term is not None and (term.log_time_ns < message.log_time_ns
                                        or (state and ahead and sent_ns < before_ns)):
                ahead -= term.log_time_ns >= message.log_time_ns
                yield term
                sent_ns = max(sent_ns, stamp_of(term.data) or 0)
                term = next(waiting, None)
            if state:
                if there and term is None and sent_ns < before_ns:
                    there = False
                    retire(terms)
                before_ns = stamp_of(message.data) or 0
            yield message
        while term is not None:
            yield term
            term = next(waiting, None)

    def send(self, topic: str, publisher: Publisher, data: bytes) -> None:
        """Publish one message; return when the next one may follow.

        Raises:
            NoAnswer: nobody answers a state within the timeout.
        """
        if topic == self.states:
            self._ask(data)
        else:  # not confirmed: DDS takes up to its heartbeat period for that, 3 s by default
            publisher.publish(data)

    def _ask(self, data: bytes) -> None:
        names, stamp_ns = _read_state(data)
        self.answers.forget()
        self._publisher.publish(data)
        if not names or names in self.unanswered:
            self.unanswered[names] = self.unanswered.get(names, 0) + 1
        elif missing := self._until_answered(stamp_ns, data):
            if not self._stop.is_set():
                self._give_up_on(names, stamp_ns, missing)
        else:
            self.answered += 1
            self._known.add(names)

    def _until_answered(self, stamp_ns: int, data: bytes) -> list[str]:
        """Return the topics that do not answer within the timeout."""
        give_up = time.monotonic() + self._timeout
        while True:
            left = give_up - time.monotonic()
            missing = self.answers.wait(stamp_ns, min(SEND_AGAIN, left))
            if not missing or left <= SEND_AGAIN or self._stop.is_set():
                return missing
            self._publisher.publish(data)
            self.resent += 1

    def _give_up_on(self, names: tuple[str, ...], stamp_ns: int, missing: list[str]) -> None:
        """Go on without answers for another robot on the same topic; raise for the arm itself."""
        if names in self._known or not self._others_than(names):
            raise NoAnswer(', '.join(missing), stamp_ns, f'no answer within {self._timeout:g} s '
                           f'to the state of {stamp_ns} ns with joints {list(names)}')
        self.unanswered[names] = 1
        print(f'{self.states}: no answer within {self._timeout:g} s to joints {list(names)}: '
              'states with these names are not waited for', flush=True)

    def _others_than(self, names: tuple[str, ...]) -> bool:
        """Whether the bag has states with joints that may still be answered."""
        if self._known:
            return True
        for message in self._bag.messages((self.states,)):
            other, _ = _read_state(message.data)
            if other and other != names and other not in self.unanswered:
                return True
        return False


def _read_state(data: bytes) -> tuple[tuple[str, ...], int]:
    """Return joint names and stamp [ns]; no names if the identifier cannot read the message."""
    try:
        state = decode_joint_state(data)
    except BagError:
        return (), 0
    n = len(state.names)
    sound = (len(set(state.names)) == n and state.stamp_ns < STAMP_LIMIT
             and all(len(values) in (0, n) for values in state[3:]))
    return (state.names if sound else ()), state.stamp_ns
