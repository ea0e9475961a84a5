# SPDX-License-Identifier: Apache-2.0
"""When rank, σ_min and excitation are worth a message: in the node and in a simulated bag."""

from __future__ import annotations

__all__ = ['HistoryNews']

HEARTBEAT = 200  # samples after which they are said again, for who has come later


class HistoryNews:
    """Tells the samples that show a changed history, and one in `HEARTBEAT` besides."""

    def __init__(self) -> None:
        """The first sample is news."""
        self._insertions = -1
        self._silent = 0

    def due(self, insertions: int) -> bool:
        """Whether the sample is to be shown; ask once a sample.

        Args:
            insertions: Pairs the history has taken so far.
        """
        self._silent += 1
        if insertions == self._insertions and self._silent < HEARTBEAT:
            return False
        self._insertions, self._silent = insertions, 0
        return True
