# SPDX-License-Identifier: Apache-2.0
"""Faults are counted always, and logged once a second for each reason."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here: the nodes cannot run')

from rclpy.logging import get_logger

from adaptive_blf_control.control.refusal import Refusal
from adaptive_blf_control.runtime import fault_log
from adaptive_blf_control.runtime.fault_log import FaultLog


@pytest.fixture
def faults() -> FaultLog:
    """Return the faults of a node that is not there."""
    return FaultLog(get_logger('faults'))


def test_a_reason_is_logged_once_and_counted_always(faults, capfd) -> None:
    for number in range(5):
        faults.drop('late', f'by {number} s')
    faults.drop('short', '3 bytes')
    assert faults.drops == {'late': 5, 'short': 1}
    text = capfd.readouterr().err
    assert 'late: by 0 s (1 so far)' in text
    assert 'short: 3 bytes (1 so far)' in text
    assert 'by 1 s' not in text


def test_after_a_while_a_reason_is_logged_again(faults, capfd, monkeypatch) -> None:
    faults.report('lost', 'first')
    monkeypatch.setattr(fault_log, 'LOG_PERIOD', 0.0)
    faults.report('lost', 'second')
    assert 'second' in capfd.readouterr().err
    assert faults.last == 'second'


def test_a_warning_after_an_error_is_logged_and_not_refused(faults, capfd) -> None:
    faults.report('lost', 'the other node failed')
    faults.report('ended', 'the other node ended', orderly=True)
    text = capfd.readouterr().err
    assert '[ERROR]' in text
    assert '[WARN]' in text


@pytest.mark.parametrize('fault', [False, True])
def test_a_refusal_is_the_last_fault_if_its_sender_is_at_fault(faults, fault: bool) -> None:
    faults.refuse(Refusal('beyond', 'p1 = 9', fault=fault))
    assert (faults.drops, faults.last) == ({'beyond': 1}, 'p1 = 9' if fault else '')
