# SPDX-License-Identifier: Apache-2.0
"""Facts about which commands count."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.simulation.command_gate import CommandGate, CommandSource

TORQUE = np.array([1.0, -2.0])


def alone() -> bool:
    return True


def beside_another() -> bool:
    return False


@pytest.fixture
def gate() -> CommandGate:
    return CommandGate(('joint1', 'joint2'))


@pytest.mark.parametrize(('torque', 'reason', 'detail'), [
    ([], 'command of wrong length', '0 values for 2 joints'),
    ([1.0], 'command of wrong length', '1 values for 2 joints'),
    ([1.0, 2.0, 3.0], 'command of wrong length', '3 values for 2 joints'),
    ([np.nan, 1.0], 'non-finite command', "joint 'joint1'"),
    ([1.0, np.inf], 'non-finite command', "joint 'joint2'")])
def test_a_command_is_whole_and_finite_or_refused_without_a_trace(gate, torque, reason, detail):
    refusal = gate.refuse(np.array(torque), 7, False, alone)
    assert refusal == (reason, detail, False)
    assert gate.refuse(TORQUE, 900, False, beside_another) is None  # 7 has not been obeyed


def test_another_publisher_is_refused_until_the_first_has_been_silent(gate):
    assert gate.refuse(TORQUE, 500, False, beside_another) is None
    refusal = gate.refuse(TORQUE, 3, False, beside_another)
    assert refusal.reason == 'command of a second publisher'
    assert refusal.fault
    assert gate.refuse(TORQUE, 3, True, beside_another) is None
    assert gate.refuse(TORQUE, 501, False, beside_another).fault  # the other one is obeyed now
    assert gate.refuse(TORQUE, 4, False, beside_another) is None


def test_one_that_is_alone_on_the_topic_may_count_from_anywhere(gate):
    assert gate.refuse(TORQUE, 500, False, alone) is None
    assert gate.refuse(TORQUE, 1, False, alone) is None
    assert gate.refuse(TORQUE, 2, False, beside_another) is None


def test_silence_is_longer_than_the_timeout_since_the_last_command(gate):
    gate.heard_ns = 5_000_000_000
    assert not gate.silent(5_100_000_000, 0.1)
    assert gate.silent(5_100_000_001, 0.1)


@pytest.mark.parametrize(('number', 'obeyed'), [
    (None, True), (501, True), (600, True), (601, False), (500, False), (499, False)])
def test_numbers_continue_one_another_with_at_most_a_hundred_lost(number, obeyed):
    source = CommandSource()
    assert source.obeys(500, False)
    assert source.obeys(number, False) is obeyed
