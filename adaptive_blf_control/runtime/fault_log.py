# SPDX-License-Identifier: Apache-2.0
"""What went wrong in a node: counted by reason, logged without flooding the log."""

from __future__ import annotations

import time

from rclpy.impl.rcutils_logger import RcutilsLogger

from adaptive_blf_control.control.refusal import Refusal
from adaptive_blf_control.errors import shortened

__all__ = ['FaultLog']

LOG_PERIOD = 1.0  # s between two log lines about the same reason


class FaultLog:
    """Dropped messages and faults of one node.

    Attributes:
        drops: Messages not used, counted by reason.
        last: Text of the last fault, '' where there was none.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        """Log through ``logger``."""
        self.drops: dict[str, int] = {}
        self.last = ''
        self._logger = logger
        self._logged: dict[str, float] = {}  # by reason, monotonic [s]

    def drop(self, reason: str, detail: str) -> None:
        """Count a message that is not used and log why, at most once a second per reason."""
        self.drops[reason] = self.drops.get(reason, 0) + 1
        if self._is_due(reason):
            self._logger.warning(f'{reason}: {shortened(detail)} ({self.drops[reason]} so far)')

    def refuse(self, refusal: Refusal) -> None:
        """Count what was refused; where the sender is at fault keep it as the last fault."""
        if refusal.fault:
            self.last = shortened(refusal.detail)
        self.drop(refusal.reason, refusal.detail)

    def report(self, reason: str, text: str, *, orderly: bool = False) -> None:
        """Keep ``text`` as the last fault and log it, at most once a second per ``reason``.

        What is ``orderly`` follows from the end of another node: it is a warning, no error.
        """
        self.last = shortened(text)
        if self._is_due(reason):
            # Two calls: rclpy refuses one whose severity changes, by the place in the code.
            if orderly:
                self._logger.warning(self.last)
            else:
                self._logger.error(self.last)

    def _is_due(self, reason: str) -> bool:
        # The logger's own throttle goes by line of code, so one reason would silence another.
        now = time.monotonic()
        if now - self._logged.get(reason, -LOG_PERIOD) < LOG_PERIOD:
            return False
        self._logged[reason] = now
        return True
