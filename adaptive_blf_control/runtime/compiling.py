# SPDX-License-Identifier: Apache-2.0
"""Compiling while a node is made: it is announced, and a request to stop ends it."""

from __future__ import annotations

from contextlib import AbstractContextManager
import time

from rclpy.impl.rcutils_logger import RcutilsLogger

from adaptive_blf_control.compiled import before_each_compilation
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['compiling']

SILENCE = 2.0  # s of compiling after which the log says what takes so long


def compiling(logger: RcutilsLogger, stop: StopFlag) -> AbstractContextManager[None]:
    """Return a context for work that may compile, which can take minutes the first time.

    The log says so. Where ``stop`` is set, a BlfError ends the work before the next function; none
    takes more than a few seconds.
    """
    begun: list[float] = []

    def before_compilation() -> None:
        if stop.is_set():
            raise BlfError('asked to stop while it was compiling')
        begun.append(time.monotonic())
        if begun[-1] > begun[0] + SILENCE:
            logger.info('compiling for this machine, which is done once and can take minutes',
                        once=True)

    return before_each_compilation(before_compilation)
