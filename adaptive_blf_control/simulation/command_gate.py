# SPDX-License-Identifier: Apache-2.0
"""Commands that count: whole, finite, from one source at a time, and answers to the present.

Torques of two controllers in turn would shake an arm.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adaptive_blf_control.control.refusal import Refusal
from adaptive_blf_control.control.source_gate import SourceGate

__all__ = ['CommandGate']


class CommandGate:
    """Lets the commands through that an arm of these joints may be given.

    Attributes:
        heard_ns: When a command was taken last, by the monotonic clock [ns].
        source: The publisher that is obeyed.
    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        """Take the names of the joints."""
        self.heard_ns = 0
        self.source = SourceGate('command')
        self._joints = joints

    def refuse(self, torque: np.ndarray, source: bytes, number: int | None, now_ns: int,
               timeout: float, alone: Callable[[], bool],
               listening_since: float = float('-inf')) -> Refusal | None:
        """Return why a command is not taken, None where it is.

        Args:
            torque: Its values [N·m], of any length.
            source: What it says of its publisher; see `SourceGate.refuse`, also for the others.
            number: Publication sequence number.
            now_ns: When it arrived, by the monotonic clock [ns].
            timeout: Silence after which another publisher may follow [s].
            alone: Whether the topic has one publisher only.
            listening_since: When the driver went on after a pause of its own [s].
        """
        if torque.size != len(self._joints):
            return Refusal('command of wrong length',
                           f'{torque.size} values for {len(self._joints)} joints')
        finite = np.isfinite(torque)
        if not finite.all():
            return Refusal('non-finite command', f'joint {self._joints[int(np.argmin(finite))]!r}')
        return self.source.refuse(source, number, now_ns * 1e-9, timeout, alone, listening_since)

    @staticmethod
    def too_old(answered_ns: int | None, newest_ns: int, longest: float) -> Refusal | None:
        """Refuse an answer to a state more than ``longest`` [s] older than the newest one.

        Args:
            answered_ns: Stamp of the state that a command answers [ns]; None where it says none.
            newest_ns: Stamp of the newest state [ns].
            longest: How old it may be [s].
        """
        if answered_ns is None or newest_ns - answered_ns <= longest * 1e9:
            return None
        return Refusal('command to an old state', (
            f'it answers the state of {(newest_ns - answered_ns) * 1e-9:.3g} s ago'))

    def silent(self, now_ns: int, timeout: float) -> bool:
        """Whether the last command was taken more than ``timeout`` [s] before ``now_ns`` [ns]."""
        return now_ns - self.heard_ns > timeout * 1e9
