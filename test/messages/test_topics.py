# SPDX-License-Identifier: Apache-2.0
"""Topics are declared once, and what follows from the declarations."""

from __future__ import annotations

import pytest

from adaptive_blf_control.messages.definitions import message_definition
from adaptive_blf_control.messages.topics import (
    ALL,
    CLOCK,
    COMMANDS,
    KINDS,
    published_by,
    RECORDED,
    TOPICS,
)


@pytest.mark.parametrize('topic', TOPICS.values(), ids=lambda topic: topic.name)
def test_a_declaration_is_complete(topic) -> None:
    assert topic.publisher in (*KINDS, ALL, '')
    assert set(topic.subscribers + topic.lockstep_subscribers) <= set(KINDS)
    assert topic.content
    assert '|' not in topic.content  # it is a cell of a table
    assert '\n' not in topic.content
    if topic.recorded:
        assert message_definition(topic.type_name).text


def test_commands_have_a_publisher_only_while_the_controller_is_active() -> None:
    assert COMMANDS not in [topic.name for topic in published_by('controller')]
    assert TOPICS[COMMANDS].publisher == 'controller'


def test_all_topics_but_the_clock_are_recorded() -> None:
    assert set(TOPICS) - set(RECORDED) == {CLOCK}
