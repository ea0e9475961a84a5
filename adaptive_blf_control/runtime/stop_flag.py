# SPDX-License-Identifier: Apache-2.0
"""A request to stop that a signal handler can set, whatever code it interrupts."""

from __future__ import annotations

import threading
import time

__all__ = ['StopFlag']

POLL_PERIOD = 0.02  # s


class StopFlag(threading.Event):
    """An event without a lock.

    The lock of ``threading.Event`` may be held by the code that a signal interrupts, e.g. by the
    handler of another signal; a handler that sets the event would then wait for ever.

    Attributes:
        signal: Number of the signal that asked for the stop, 0 if none did.
    """

    def __init__(self) -> None:
        """Start without a request."""
        super().__init__()
        self._asked = False
        self.signal = 0

    def is_set(self) -> bool:
        """Whether the stop has been asked for."""
        return self._asked

    def set(self) -> None:
        """Ask for the stop."""
        self._asked = True

    def clear(self) -> None:
        """Take the request back."""
        self._asked = False

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the request, for ``timeout`` [s] at most; return whether it was made."""
        end = None if timeout is None else time.monotonic() + timeout
        while not self._asked:
            left = POLL_PERIOD if end is None else end - time.monotonic()
            if left <= 0.0:
                break
            time.sleep(min(left, POLL_PERIOD))
        return self._asked
