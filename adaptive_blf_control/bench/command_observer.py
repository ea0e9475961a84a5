# SPDX-License-Identifier: Apache-2.0
"""Judges the commands of a controller from outside: limits, rate, and the age of what they answer.

It shares no code with what computes the torque; it hears the topics as any node does.
"""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.messages.command import read_command
from adaptive_blf_control.messages.joint_state import decode_joint_state

__all__ = ['CommandObserver']

LATE = 0.01  # s by which the system may delay one message against the next
KEPT = 20  # faults that are kept as text


class CommandObserver:
    """Takes commands and joint states as CDR, in order of arrival.

    Attributes:
        commands: Commands with a label that were heard.
        faults: What was wrong, the first of them as text.
        count: How many faults there were.
    """

    def __init__(self, limit: float, rate: float, oldest: float, tells: float) -> None:
        """Take what is allowed.

        Args:
            limit: Largest torque of any joint [N·m].
            rate: Largest rate of it [N·m/s].
            oldest: Time after its stamp at which a state may still be answered [s].
            tells: Torque that only strangers send [N·m].
        """
        self.commands = self.count = 0
        self.faults: list[str] = []
        self._limit, self._rate, self._oldest, self._tells = limit, rate, oldest, tells
        self._last: dict[bytes, tuple[np.ndarray, float]] = {}

    def state(self, data: bytes) -> None:
        """Take a joint state of the driver: what moved the arm is in its effort."""
        record = decode_joint_state(data)
        if (np.abs(record.effort) > self._limit * 1.001).any():
            self._fault(f'effort {record.effort.tolist()} beyond the limit')
        if record.effort.size and np.isclose(record.effort, self._tells, rtol=1e-3).all():
            self._fault(f'the arm obeys a stranger: {record.effort.tolist()}')

    def command(self, data: bytes, sent_ns: int) -> None:
        """Take a command with the time at which it was published [ns]."""
        torque, source, answered_ns = read_command(data)
        if not source:
            return  # a stranger's
        self.commands += 1
        if not np.isfinite(torque).all() or (np.abs(torque) > self._limit).any():
            self._fault(f'torque {torque.tolist()} beyond the limit')
        before, then = self._last.get(source, (torque, 0.0))
        now = sent_ns * 1e-9
        step, allowed = np.abs(torque - before).max(), self._rate * (now - then + LATE)
        if torque.any() and step > allowed:
            self._fault(f'step of {step:.4g} N·m in {now - then:.4g} s')
        self._last[source] = torque, now
        # Of when it was sent: an observer that is late hears states before the answers to them.
        age = (sent_ns - answered_ns) * 1e-9 if answered_ns else 0.0
        if age > self._oldest + LATE:
            self._fault(f'a state of {age:.4g} s ago is answered')

    def _fault(self, text: str) -> None:
        self.count += 1
        if len(self.faults) < KEPT:
            self.faults.append(text)
