# SPDX-License-Identifier: Apache-2.0
"""Who goes first: real-time priority and locked memory where permitted, a reason where not."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path
import sys

__all__ = ['as_usual', 'lock_memory', 'raise_priority', 'step_back']

MCL_CURRENT_AND_FUTURE = 3
HOW = 'allow it with rtprio and memlock in /etc/security/limits.d, or run without'


def raise_priority(priority: int) -> str | None:
    """Schedule every thread of this process SCHED_FIFO with ``priority`` (1..99).

    The middleware's threads are among them: a message that waits for its receive thread is late
    whatever the loop's own priority is.

    Returns:
        Why not, None where it was done.
    """
    if sys.platform != 'linux':
        return f'real-time priority {priority}: only on Linux'
    try:
        for task in Path('/proc/self/task').iterdir():
            os.sched_setscheduler(int(task.name), os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, ValueError) as error:
        as_usual()
        return f'real-time priority {priority}: {getattr(error, "strerror", error)}; {HOW}'
    return None


def step_back(niceness: int) -> None:
    """Let others go before the calling thread: raise its nice value, which is always permitted.

    On Linux threads are nice one by one. The middleware's are not among them: they have to empty
    what others fill.
    """
    if sys.platform == 'linux' and niceness:
        os.setpriority(os.PRIO_PROCESS, 0, niceness)


def as_usual() -> None:
    """Give the calling thread the ordinary scheduling back: services do not race the loop."""
    if sys.platform == 'linux':
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def lock_memory() -> str | None:
    """Keep the memory of this process from being swapped out; return why not, None where done."""
    if sys.platform != 'linux':
        return 'locked memory: only on Linux'
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(MCL_CURRENT_AND_FUTURE) != 0:
        return f'locked memory: {os.strerror(ctypes.get_errno())}; {HOW}'
    return None
