# SPDX-License-Identifier: Apache-2.0
"""When rank, σ_min and excitation are published: in the node and in a simulated bag."""

from __future__ import annotations

__all__ = ['REPUBLISH_SAMPLES', 'HistoryPublication']

REPUBLISH_SAMPLES = 200
"""Samples after which unchanged values are published again, for subscribers that came later."""


class HistoryPublication:
    """Finds the samples that show a changed history, and one in `REPUBLISH_SAMPLES` besides."""

    def __init__(self) -> None:
        """The first sample is published."""
        self._insertions = -1
        self._unpublished = 0

    def due(self, insertions: int) -> bool:
        """Whether the values of a sample are to be published; ask once a sample.

        Args:
            insertions: Pairs that the history has taken so far.
        """
        self._unpublished += 1
        if insertions == self._insertions and self._unpublished < REPUBLISH_SAMPLES:
            return False
        self._insertions, self._unpublished = insertions, 0
        return True
