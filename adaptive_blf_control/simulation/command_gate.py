# SPDX-License-Identifier: Apache-2.0
"""Commands that count: whole, finite, and from one publisher at a time.

Torques of two controllers in turn would shake an arm.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from adaptive_blf_control.control.refusal import Refusal

__all__ = ['CommandGate', 'CommandSource']

LONGEST_GAP = 100  # messages that may be lost on the way


class CommandSource:
    """Tells the messages of the publisher that is obeyed from those of another.

    Commands carry no name. But a publisher numbers its messages, and the numbers of two
    publishers do not continue one another.

    Attributes:
        number: Of the last message that was obeyed; None before the first.
    """

    def __init__(self) -> None:
        """Obey the publisher that is heard first."""
        self.number: int | None = None

    def obeys(self, number: int | None, silent: bool) -> bool:
        """Whether the message with this publication number comes from the one that is obeyed.

        Args:
            number: Publication sequence number; None where the middleware has none.
            silent: Whether the one that is obeyed has said nothing for its timeout: then another
                may take over.
        """
        if number is None:
            return True
        last = self.number
        if last is None or silent or 0 < number - last <= LONGEST_GAP:
            self.number = number
            return True
        return False


class CommandGate:
    """Lets the commands through that an arm of these joints may be given.

    Attributes:
        heard_ns: When a command was taken last, by the monotonic clock [ns].
        source: The publisher that is obeyed.
    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        """Take the names of the joints."""
        self.heard_ns = 0
        self._joints = joints
        self.source = CommandSource()

    def refuse(self, torque: np.ndarray, number: int | None, silent: bool,
               alone: Callable[[], bool]) -> Refusal | None:
        """Return why a command is not taken, None where it is.

        Args:
            torque: Its values [N·m], of any length.
            number: See `CommandSource.obeys`.
            silent: Likewise.
            alone: Asked where the number does not continue: whether there is one publisher only.
                A controller that was activated again has a new one, and the topic for itself.
        """
        if torque.size != len(self._joints):
            return Refusal('command of wrong length',
                           f'{torque.size} values for {len(self._joints)} joints')
        finite = np.isfinite(torque)
        if not finite.all():
            return Refusal('non-finite command', f'joint {self._joints[int(np.argmin(finite))]!r}')
        if self.source.obeys(number, silent) or (alone() and self.source.obeys(number, True)):
            return None
        return Refusal('command of a second publisher',
                       'one controller at a time: it is refused', fault=True)

    def silent(self, now_ns: int, timeout: float) -> bool:
        """Whether the last command was taken more than ``timeout`` [s] before ``now_ns`` [ns]."""
        return now_ns - self.heard_ns > timeout * 1e9
