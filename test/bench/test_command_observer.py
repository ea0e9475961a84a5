# SPDX-License-Identifier: Apache-2.0
"""Facts about what the observer of an attack takes for a fault."""

from __future__ import annotations

import pytest

from adaptive_blf_control.bench.command_observer import CommandObserver
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec, JointStateCodec

SECOND = 10**9
CODEC = Float64MultiArrayCodec(2, '/controller#0123abcd')
STATES = JointStateCodec(['a', 'b'])


def _state(stamp: int, effort: list[float]) -> bytes:
    return STATES.encode(stamp, [0.0, 0.0], [0.0, 0.0], effort)


@pytest.fixture
def observer() -> CommandObserver:
    observer = CommandObserver(limit=100.0, rate=1000.0, oldest=0.1, tells=77.0)
    observer.state(_state(5 * SECOND, [0.0, 0.0]))
    observer.command(CODEC.encode([1.0, 1.0], 5 * SECOND), 5 * SECOND)
    assert not observer.faults
    return observer


@pytest.mark.parametrize(('torque', 'answered', 'after_ms', 'fault'), [
    ([10.0, 1.0], 5 * SECOND, 5, ''), ([101.0, 1.0], 5 * SECOND, 90, 'limit'),
    ([float('nan'), 1.0], 5 * SECOND, 5, 'limit'), ([30.0, 1.0], 5 * SECOND, 5, 'step'),
    ([1.0, 1.0], 4 * SECOND, 5, 'is answered'), ([0.0, 0.0], 0, 5, ''),
    ([1.0, 1.0], 5 * SECOND, 200, 'is answered')])
def test_a_command_beyond_limit_rate_or_age_is_a_fault(observer, torque, answered, after_ms,
                                                       fault):
    observer.command(CODEC.encode(torque, answered), 5 * SECOND + after_ms * 10**6)
    assert (fault in ' '.join(observer.faults)) if fault else not observer.faults


@pytest.mark.parametrize(('effort', 'fault'), [
    ([77.0, 77.0], 'obeys a stranger'), ([150.0, 0.0], 'beyond the limit'), ([77.0, 3.0], '')])
def test_what_the_arm_does_is_looked_at_too(observer, effort, fault):
    observer.state(_state(6 * SECOND, effort))
    assert (fault in ' '.join(observer.faults)) if fault else not observer.faults


def test_zero_may_come_at_once(observer):
    observer.command(CODEC.encode([6.0, 1.0], 5 * SECOND), 5 * SECOND + 10**6)
    observer.command(CODEC.encode([0.0, 0.0]), 5 * SECOND + 10**6)
    assert not observer.faults


def test_commands_of_strangers_are_not_judged(observer):
    observer.command(Float64MultiArrayCodec(2).encode([1e9, 1e9]), SECOND)
    assert not observer.faults
    assert observer.commands == 1


def test_an_answer_that_is_heard_after_later_states_is_none_to_an_old_one(observer):
    observer.state(_state(7 * SECOND, [0.0, 0.0]))
    observer.command(CODEC.encode([2.0, 1.0], 5 * SECOND + 10**6), 5 * SECOND + 2 * 10**6)
    assert not observer.faults
