# SPDX-License-Identifier: Apache-2.0
"""Priority, processors and locked memory from the operating system, as far as it permits."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import ctypes
import os
from pathlib import Path
import platform
import struct
import sys

from adaptive_blf_control.configuration.node_settings import RealtimeSettings
from adaptive_blf_control.errors import ParameterError

__all__ = ['cpus_of', 'go_first', 'lock_memory', 'raise_priority', 'sharp_timer', 'short_slices',
           'stay_on', 'step_back']

MCL_CURRENT_AND_FUTURE = 3
PR_SET_TIMERSLACK = 29
SCHED_SETATTR = {'x86_64': 314, 'aarch64': 274}  # system call, by machine
HOW = 'allow it with rtprio and memlock in /etc/security/limits.d, or run without'


def go_first(settings: RealtimeSettings, niceness: int) -> list[str]:
    """Ask the system for what the settings want; return what it does not permit, with the reason.

    Args:
        settings: Priority, processors, time slice, locked memory.
        niceness: Of the calling thread, see :func:`step_back`.
    """
    stay_on(cpus_of(settings.cpus))
    short_slices(settings.slice)
    sharp_timer()
    step_back(niceness)
    refused = [raise_priority(settings.priority) if settings.priority else None,
               lock_memory() if settings.lock_memory else None]
    return [reason for reason in refused if reason is not None]


def raise_priority(priority: int) -> str | None:
    """Schedule every thread of this process SCHED_FIFO with ``priority`` (1..99).

    This includes the threads of the middleware: a message that waits for its receive thread is
    late whatever the priority of the loop is.

    Returns:
        Why the system refused, None if it was done.
    """
    if sys.platform != 'linux':
        return f'real-time priority {priority}: only on Linux'
    try:
        _every_thread(lambda thread: os.sched_setscheduler(
            thread, os.SCHED_FIFO, os.sched_param(priority)))
    except (OSError, ValueError) as error:
        return f'real-time priority {priority}: {getattr(error, "strerror", error)}; {HOW}'
    return None


def step_back(niceness: int) -> None:
    """Raise the nice value of the calling thread, which is always permitted.

    On Linux each thread has its own. Those of the middleware keep theirs, because they have to
    empty what other processes fill.
    """
    if sys.platform == 'linux' and niceness:
        os.setpriority(os.PRIO_PROCESS, 0, niceness)


def sharp_timer() -> None:
    """Let the waits of the calling thread end when they are over, which needs no privilege.

    Linux else adds up to 50 us to each, in order to wake several threads at once.
    """
    if sys.platform == 'linux':
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0)  # ns


def cpus_of(text: str) -> set[int]:
    """Return the processors named by ``text``, e.g. ``0,2-3``; the empty set for ''.

    Raises:
        ParameterError: it cannot be read, or names one that this process may not use.
    """
    cpus: set[int] = set()
    try:
        for part in filter(None, text.split(',')):
            first, dash, last = part.partition('-')
            cpus.update(range(int(first), int(last if dash else first) + 1))
    except ValueError:
        raise ParameterError('realtime.cpus', text, "numbers and ranges like '0,2-3'") from None
    if sys.platform == 'linux' and not cpus <= os.sched_getaffinity(0):
        there = ', '.join(map(str, sorted(os.sched_getaffinity(0))))
        raise ParameterError('realtime.cpus', text, f'of the processors {there}')
    return cpus


def stay_on(cpus: set[int]) -> None:
    """Keep every thread of this process on these processors, which needs no privilege."""
    if sys.platform == 'linux' and cpus:
        _every_thread(lambda thread: os.sched_setaffinity(thread, cpus))


def short_slices(seconds: float) -> None:
    """Ask the ordinary scheduler for short time slices that come soon, which needs no privilege.

    For every thread of this process. From Linux 6.12 on, a thread that wakes with a shorter slice
    preempts one with a longer slice; on other systems nothing happens. The C library has no
    function for this system call.
    """
    number = SCHED_SETATTR.get(platform.machine())
    if sys.platform != 'linux' or number is None or seconds <= 0.0:
        return
    library = ctypes.CDLL(None)

    def shorten(thread: int) -> None:
        if os.sched_getscheduler(thread) == os.SCHED_OTHER:
            nice = os.getpriority(os.PRIO_PROCESS, thread)
            library.syscall(number, thread, struct.pack(
                '=IIQiIQQQ', 48, os.SCHED_OTHER, 0, nice, 0, int(seconds * 1e9), 0, 0), 0)

    _every_thread(shorten)


def _every_thread(action: Callable[[int], None]) -> None:
    """Call ``action`` with each thread of this process; one that has ended needs nothing."""
    for task in Path('/proc/self/task').iterdir():
        with suppress(ProcessLookupError):
            action(int(task.name))


def lock_memory() -> str | None:
    """Lock the memory of this process; return why the system refused, None if it was done."""
    if sys.platform != 'linux':
        return 'locked memory: only on Linux'
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(MCL_CURRENT_AND_FUTURE) != 0:
        return f'locked memory: {os.strerror(ctypes.get_errno())}; {HOW}'
    return None
