# SPDX-License-Identifier: Apache-2.0
"""Which topics of a bag are played in lockstep, and which the live nodes send themselves."""

from __future__ import annotations

from collections.abc import Sequence

from adaptive_blf_control.bags.reader import Bag
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.joint_readers import JOINT_STATE
from adaptive_blf_control.messages.topics import COMMANDS, JOINT_STATES

__all__ = ['beside', 'choose_topics', 'states_topic']


def choose_topics(bag: Bag, asked: Sequence[str], answers: Sequence[str]
                  ) -> tuple[list[str], dict[str, str]]:
    """Return which topics to play, states last, and which not, with the reason.

    DDS announces publishers in the order in which they were made, so a node that has received the
    first state knows all the others.

    Args:
        bag: The bag.
        asked: Topics of the bag that were named; all where empty.
        answers: Topics that answer, relative to the namespace of the states.

    Raises:
        BagError: an answer was named, or there is not exactly one topic with states.
    """
    known = asked or [topic for topic, info in bag.topics.items() if info.count]
    states = states_topic(bag, known)
    answering = [beside(states, topic) for topic in answers]
    folders = tuple(topic.rpartition('/')[0] + '/' for topic in answering
                    if topic.rpartition('/')[0] not in ('', states.rpartition('/')[0]))
    skipped: dict[str, str] = {}
    for topic in known:
        if topic in answering:
            if asked:
                raise BagError(f'{bag.path}: {topic} is the answer that lockstep waits for: '
                               'expected it to come from the live node alone')
            skipped[topic] = 'it is the answer that lockstep waits for'
        elif not asked and topic.startswith(folders):
            skipped[topic] = 'the node that answers sends it'
        elif not asked and topic == beside(states, COMMANDS):
            skipped[topic] = 'it moves an arm: name it with --topics where that is meant'
    return sorted(set(known) - set(skipped), key=lambda topic: (topic == states, topic)), skipped


def states_topic(bag: Bag, topics: Sequence[str]) -> str:
    """Return the one topic of states among ``topics``; BagError if there is none, or several."""
    found = [topic for topic in topics if bag.topics[topic].type_name == JOINT_STATE]
    named = [topic for topic in found if topic.rpartition('/')[2] == JOINT_STATES]
    if len(named or found) == 1:
        return (named or found)[0]
    raise BagError(f'{bag.path}: lockstep plays one topic of joint states, here are '
                   f'{", ".join(named or found) or "none"}: expected --topics to name one')


def beside(states: str, topic: str) -> str:
    """Return a topic relative to the namespace of the states; an absolute one as it is."""
    return topic if topic.startswith('/') else states.rpartition('/')[0] + (
        '/' if '/' in states else '') + topic
