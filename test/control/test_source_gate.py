# SPDX-License-Identifier: Apache-2.0
"""Facts about who is believed where several publish."""

from __future__ import annotations

import itertools

import pytest

from adaptive_blf_control.control.source_gate import is_unique, SourceGate

FIRST, SECOND = b'/controller#0123abcd', b'/controller#ffff0000'
TIMEOUT = 0.1


def several() -> bool:
    return False


def alone() -> bool:
    return True


@pytest.fixture
def gate() -> SourceGate:
    return SourceGate('command')


def _refused(gate: SourceGate, source: bytes, number: int | None, now: float,
             only=several) -> str:
    refusal = gate.refuse(source, number, now, TIMEOUT, only)
    return '' if refusal is None else refusal.reason


@pytest.mark.parametrize(('first', 'second'), [(FIRST, b''), (b'', FIRST), (FIRST, SECOND),
                                               (b'base_link', b'world')])
def test_the_first_source_is_kept_while_it_speaks_whatever_the_second_counts(gate, first, second):
    numbers = itertools.count(1)
    for k in range(1000):  # the second one speaks five times as often, as a shouting one does
        now = k * 1e-3
        if k % 5 == 0:
            assert not _refused(gate, first, 400 + k, now)
        assert _refused(gate, second, next(numbers), now) == 'command of a second publisher'
    assert gate.other == second


def test_a_source_is_changed_only_after_silence_and_then_kept(gate):
    assert not _refused(gate, FIRST, 7, 1.0)
    assert _refused(gate, SECOND, 8, 1.099)
    assert not _refused(gate, SECOND, 9, 1.102)
    assert _refused(gate, FIRST, 8, 1.103) == 'command of a second publisher'


def test_a_pause_of_the_listener_is_no_silence_of_the_source(gate):
    assert not _refused(gate, FIRST, 7, 1.0)
    refusal = gate.refuse(SECOND, 8, 2.05, TIMEOUT, several, listening_since=2.0)
    assert refusal is not None
    assert refusal.reason == 'command of a second publisher'
    assert gate.refuse(SECOND, 9, 2.11, TIMEOUT, several, listening_since=2.0) is None


@pytest.mark.parametrize(('numbers', 'refused'), [
    ([500, 501, 1, 502, 2, 503], [0, 0, 1, 1, 1, 1]),  # the second began later
    ([5, 6, 900, 7, 901], [0, 0, 1, 1, 1]),  # or earlier
    ([5, 6, 7, 7, 8, 8], [0, 0, 0, 1, 1, 1]),  # or at the same moment
    ([5, None], [0, 1])])  # a middleware that does not count
def test_between_two_that_say_the_same_of_themselves_nothing_is_guessed(gate, numbers, refused):
    for k, (number, expected) in enumerate(zip(numbers, refused)):
        reason = _refused(gate, b'base_link', number, 1.0 + k * 1e-2)
        assert reason == ('command of one of two publishers' if expected else ''), k


def test_the_one_that_goes_on_is_believed_again_after_the_other_has_been_silent(gate):
    for number in (500, 3, 501):
        _refused(gate, b'', number, 1.0)
    assert _refused(gate, b'', 502, 1.099)
    assert not _refused(gate, b'', 503, 1.101)


def test_a_publisher_made_anew_begins_to_count_anew_where_it_is_alone(gate):
    assert not _refused(gate, b'', 500, 1.0, alone)
    assert not _refused(gate, b'', 1, 1.01, alone)
    assert not _refused(gate, b'', 2, 1.02)


@pytest.mark.parametrize(('number', 'believed'), [(501, True), (600, True), (601, False),
                                                  (500, False), (499, False)])
def test_numbers_continue_one_another_with_at_most_a_hundred_lost(gate, number, believed):
    assert not _refused(gate, b'', 500, 1.0)
    assert (not _refused(gate, b'', number, 1.01)) is believed


def test_a_unique_source_may_count_as_it_likes(gate):
    for k, number in enumerate((500, 1, 700, None)):
        assert not _refused(gate, FIRST, number, 1.0 + k * 1e-2)


def test_a_source_without_a_name_of_its_own_that_follows_a_unique_one_has_to_count(gate):
    assert not _refused(gate, FIRST, 1, 1.0)
    assert not _refused(gate, b'base_link', 1, 2.0)
    assert _refused(gate, b'base_link', 700, 2.01)


@pytest.mark.parametrize(('source', 'unique'), [
    (FIRST, True), (b'base_link', False), (b'', False), (b'/a#0123abc', False),
    (b'/a#0123abcd ', False), (b'/a#0123ABCD', False)])
def test_only_what_the_nodes_call_themselves_is_unique(source, unique):
    assert is_unique(source) is unique


@pytest.mark.parametrize('number', [1, 5000])
def test_a_source_that_has_been_silent_may_count_from_anywhere(gate, number):
    assert not _refused(gate, b'base_link', 500, 1.0)
    assert not _refused(gate, b'base_link', number, 1.101)  # another process of the same driver
    assert not _refused(gate, b'base_link', number + 1, 1.11)
