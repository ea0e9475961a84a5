# SPDX-License-Identifier: Apache-2.0
"""The request to stop, which a signal handler may make whatever it has interrupted."""

from __future__ import annotations

import threading
import time

__all__ = ['StopFlag']

POLL_PERIOD = 0.02  # s


class StopFlag(threading.Event):
    """An event without a lock.

    That of ``threading.Event`` may be held by the very code that a signal has interrupted, e.g.
    by the handler of another signal; a handler that asks for it then waits for itself for ever.

    Attributes:
        signal: Number of the signal that asked for the stop, 0 where none did.
    """

    def __init__(self) -> None:
        """Start not set."""
        super().__init__()
        self._asked = False
        self.signal = 0

    def is_set(self) -> bool:
        """Whether the stop was asked for."""
        return self._asked

    def set(self) -> None:
        """Ask for the stop."""
        self._asked = True

    def clear(self) -> None:
        """Take the request back."""
        self._asked = False

    def wait(self, timeout: float | None = None) -> bool:
        """Return whether it was asked for, at the latest after ``timeout`` [s]."""
        end = None if timeout is None else time.monotonic() + timeout
        while not self._asked:
            left = POLL_PERIOD if end is None else end - time.monotonic()
            if left <= 0.0:
                break
            time.sleep(min(left, POLL_PERIOD))
        return self._asked
