# SPDX-License-Identifier: Apache-2.0
"""Facts about the age of messages, whatever the clock of their sender shows."""

from __future__ import annotations

import pytest

from adaptive_blf_control.runtime.message_age import MessageAge

MS = 10**6  # ns
HOUR = 3600 * 10**9  # ns


@pytest.mark.parametrize('offset', [0, HOUR, -HOUR])
def test_an_age_is_the_delay_beyond_the_shortest_whatever_the_senders_clock_shows(offset) -> None:
    age, now = MessageAge(), 10 * HOUR
    for delay in (2, 1, 3):
        age.of(now + offset - delay * MS, now)
    assert age.of(now + offset - 401 * MS, now) == pytest.approx(0.4)


def test_a_clock_that_drifts_does_not_make_its_messages_old() -> None:
    age, now = MessageAge(), 10 * HOUR
    for _ in range(1000):  # a sender that loses half a millisecond a second
        now += 1000 * MS
        last = age.of(now - round(0.5e-3 * (now - 10 * HOUR)), now)
        assert last < 1e-3


def test_a_message_that_has_waited_is_old_although_time_has_passed() -> None:
    age, now = MessageAge(), 10 * HOUR
    age.of(now, now)
    assert age.of(now, now + 1000 * MS) == pytest.approx(1.0, abs=2e-3)
