# SPDX-License-Identifier: Apache-2.0
"""Facts about which commands count."""

from __future__ import annotations

import numpy as np
import pytest

from adaptive_blf_control.simulation.command_gate import CommandGate

TORQUE = np.array([1.0, -2.0])
NOW, TIMEOUT = 5_000_000_000, 0.1  # ns, s


def several() -> bool:
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
    refusal = gate.refuse(np.array(torque), b'a', 7, NOW, TIMEOUT, several)
    assert refusal == (reason, detail, False)
    assert gate.refuse(TORQUE, b'b', 900, NOW, TIMEOUT, several) is None  # a is not obeyed


def test_another_publisher_is_refused_until_the_first_has_been_silent(gate):
    assert gate.refuse(TORQUE, b'a', 500, NOW, TIMEOUT, several) is None
    refusal = gate.refuse(TORQUE, b'b', 501, NOW, TIMEOUT, several)
    assert refusal.reason == 'command of a second publisher'
    assert refusal.fault
    assert gate.refuse(TORQUE, b'b', 502, NOW + 10**9, TIMEOUT, several) is None
    assert gate.refuse(TORQUE, b'a', 501, NOW + 10**9, TIMEOUT, several).fault


@pytest.mark.parametrize(('answered', 'old'), [
    (None, False), (10**9, False), (900_000_000, False), (899_999_999, True),
    (1_100_000_000, False)])
def test_a_command_that_answers_an_old_state_is_refused(gate, answered, old):
    refusal = gate.too_old(answered, 10**9, 0.1)
    assert (refusal is not None) is old
    if refusal:
        assert refusal.reason == 'command to an old state'


def test_silence_is_longer_than_the_timeout_since_the_last_command(gate):
    gate.heard_ns = 5_000_000_000
    assert not gate.silent(5_100_000_000, 0.1)
    assert gate.silent(5_100_000_001, 0.1)
