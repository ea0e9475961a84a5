# SPDX-License-Identifier: Apache-2.0
"""Which nodes have answered the present state of a run in lockstep."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from adaptive_blf_control.messages.stamp import stamp_of

__all__ = ['LockstepAnswers']


class LockstepAnswers:
    """Answers carry the stamp of the state; the command, which has no stamp, follows its state.

    Attributes:
        torque: The last command, shape (n,) [N·m].
        commanded: Whether it came after the state.
    """

    def __init__(self, names: Iterable[str], n: int) -> None:
        """Expect answers of the nodes of these names; the arm has ``n`` joints."""
        self.torque = np.zeros(n)
        self.commanded = False
        self._expected_ns = 0
        self._answered = dict.fromkeys(names, 0)

    def expect(self, stamp_ns: int) -> None:
        """Expect the answers to the state of this stamp."""
        self.commanded, self._expected_ns = False, stamp_ns

    def command(self, torque: np.ndarray) -> None:
        """Keep a command until the arm steps."""
        self.torque, self.commanded = torque, True

    def hear(self, name: str, data: bytes) -> None:
        """Note a message of a node; one with another stamp does not undo its answer."""
        if stamp_of(data) == self._expected_ns:
            self._answered[name] = self._expected_ns

    def missing(self) -> list[str]:
        """Return the nodes that have not answered yet; the controller without a command, too."""
        missing = [name for name, stamp_ns in self._answered.items()
                   if stamp_ns != self._expected_ns]
        if not self.commanded and 'controller' not in missing:
            missing.append('controller')
        return missing
