# SPDX-License-Identifier: Apache-2.0
"""One publisher of commands at a time: torques of two controllers in turn would shake an arm."""

from __future__ import annotations

__all__ = ['CommandSource']

LONGEST_GAP = 100  # messages that may be lost on the way


class CommandSource:
    """Tells the messages of the publisher that is obeyed from those of another.

    Commands carry no name. But a publisher numbers its messages, and the numbers of two
    publishers do not continue one another.
    """

    def __init__(self) -> None:
        """Obey whoever speaks first."""
        self._number: int | None = None

    def obeys(self, number: int | None, silent: bool) -> bool:
        """Whether the message with this publication number comes from the one that is obeyed.

        Args:
            number: Publication sequence number; None where the middleware has none.
            silent: Whether the one that is obeyed has said nothing for its timeout: then another
                may take over.
        """
        if number is None:
            return True
        last = self._number
        if last is None or silent or 0 < number - last <= LONGEST_GAP:
            self._number = number
            return True
        return False
