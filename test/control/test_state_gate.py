# SPDX-License-Identifier: Apache-2.0
"""Facts about the order in which joint states are let through."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.control.state_gate import StateGate

LONGEST = 0.1  # s
MS = 1_000_000


def gate(last_ms: int | None = 0) -> StateGate:
    subject = StateGate(('joint1', 'joint2'))
    if last_ms is not None:
        subject.take(last_ms * MS)
    return subject


def admits(subject: StateGate, ms: int) -> bool:
    """Offer a state and take it where it is let through."""
    refusal = subject.out_of_order(ms * MS, LONGEST)
    if refusal is None:
        subject.take(ms * MS)
    return refusal is None


@pytest.mark.parametrize('ms', [-10**6, 0, 10**9])
def test_the_first_state_may_have_any_stamp(ms):
    assert admits(gate(None), ms)


@pytest.mark.parametrize('ms', [0, -1, -10**6])
def test_a_stamp_that_is_not_later_is_refused_with_both_stamps(ms):
    refusal = gate().out_of_order(ms * MS, LONGEST)
    assert refusal.reason == 'joint state out of order'
    assert refusal.detail == f'stamp {ms * MS} ns after 0 ns'


def test_one_wild_stamp_is_refused_and_the_next_usual_one_let_through():
    subject = gate()
    refusal = subject.out_of_order(5_000 * MS, LONGEST)
    assert refusal == ('stamp jumps ahead', '5 s after the last one', False)
    assert admits(subject, 1)
    assert not admits(subject, 5_001)  # the one before no longer confirms it


@pytest.mark.parametrize(('second', 'let_through'), [(5_001, True), (5_100, True), (5_101, False),
                                                    (5_000, False), (4_999, False)])
def test_a_clock_that_stays_ahead_is_followed_once_a_second_state_confirms_it(second,
                                                                            let_through):
    subject = gate()
    assert not admits(subject, 5_000)
    refusal = subject.out_of_order(second * MS, LONGEST)
    assert (refusal is None) is let_through
    assert subject.jumped(second * MS, LONGEST)


@pytest.mark.parametrize(('ms', 'jumped'), [(1, False), (100, False), (101, True)])
def test_a_gap_up_to_the_longest_is_no_jump(ms, jumped):
    assert gate().jumped(ms * MS, LONGEST) is jumped


def test_only_the_last_stamp_is_a_repetition():
    assert gate(3).repeated(3 * MS).detail == f'stamp {3 * MS} ns again'
    assert gate(3).repeated(2 * MS) is None
    assert gate(None).repeated(0) is None


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('velocity', [False, True])
def test_what_is_not_finite_is_refused_with_its_joint(value, velocity):
    q, qd = np.array([0.5, 0.5]), np.array([0.25, 0.25])
    (qd if velocity else q)[1] = value
    refusal = gate().not_finite(q, qd)
    assert refusal.reason == 'non-finite joint state'
    assert refusal.detail == f"joint 'joint2': {q[1]:g} rad, {qd[1]:g} rad/s"
    assert gate().not_finite(np.zeros(2), np.zeros(2)) is None
