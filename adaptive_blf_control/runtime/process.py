# SPDX-License-Identifier: Apache-2.0
"""A node as a process: signals, clear errors, a clean end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import faulthandler
import os
from pathlib import Path
import signal
import socket
import sys
import threading
import time
from typing import Any, Protocol

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import get_logger_level, set_logger_level
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.node_parameters import (
    check_all_reached,
    check_files,
    explain_files,
)
from adaptive_blf_control.runtime.second_graph import joined_early, refuse_beside_another
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['Runnable', 'ends_on_signal', 'initialise', 'leaves_in_time', 'run_node',
           'stop_on_signals', 'warn_of_leftovers']

SHARED_MEMORY = Path('/dev/shm')
GRACE = 1.0  # s for a node that is being made to notice a signal by itself
LEAVE = 10.0  # s for a node that has ended to leave the graph


def stop_on_signals() -> StopFlag:
    """Return a flag that SIGINT, SIGTERM and SIGHUP set.

    The handlers raise nothing: their exception could arrive in a finaliser or in a callback from
    C, which print it and go on.
    """
    stop = StopFlag()

    def ask(number: int, _: object) -> None:
        stop.signal = stop.signal or number
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, ask)
    return stop


class Runnable(Protocol):
    """A node, or several that run in one loop."""

    @property
    def nodes(self) -> Sequence[DataNode[Any]]:
        """The nodes; the first one speaks for all."""
        ...

    def run(self) -> int:
        """Run until the end and return the exit code."""
        ...

    def destroy_node(self) -> None:
        """Leave the graph."""
        ...


@contextmanager
def ends_on_signal() -> Iterator[None]:
    """Return a context that a signal ends together with the process, at the latest after GRACE.

    For the making of a node, which has sent nothing yet. The flag of :func:`stop_on_signals` alone
    may be set late: Python calls its handlers between two of its own instructions, and compiling
    one function in machine code is a single one of several seconds.
    """
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    over = threading.Event()

    def watch() -> None:
        number = reader.recv(1)
        if number and not over.wait(GRACE):
            try_shutdown()  # the others see it leave
            os._exit(128 + number[0])

    before = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        over.set()
        signal.set_wakeup_fd(before)
        writer.close()
        watcher.join()
        reader.close()


@contextmanager
def leaves_in_time() -> Iterator[None]:
    """Return a context that ends the process with status 1 where it takes longer than LEAVE.

    For a node that has sent its last message. Fast DDS 2.14 can wait for itself for ever where a
    participant ends just while it discovers another one, and it holds the interpreter meanwhile:
    the clock runs in a thread outside of it, which prints where the process hangs.
    """
    faulthandler.dump_traceback_later(LEAVE, exit=True, file=2)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


def run_node(kind: str, make: Callable[..., Runnable], args: list[str] | None) -> int:
    """Run a node as a process: signals, clear errors, clean shutdown.

    A signal takes effect before the next sample. While the node is being made it takes effect
    where that compiles (:func:`compiling`) or waits, at the latest after :data:`GRACE`.

    Args:
        kind: Name of the node, for messages.
        make: Makes the node, given the flag ``stop``.
        args: ROS arguments; those of the process if None.

    Returns:
        The exit status: 2 if the node cannot be made, or ends with a BlfError.

    Raises:
        SystemExit: a signal came while the node was being made.
    """
    stop = stop_on_signals()

    try:
        with ends_on_signal():
            initialise(kind, args)
            with joined_early() as since:
                node = make(stop=stop)
        for each in node.nodes:
            each.joined_at = since
        _check_alone_and_complete(node, sys.argv if args is None else args)
    except (BlfError, ParameterException, RuntimeError) as error:
        if stop.signal:
            try_shutdown()
            raise SystemExit(128 + stop.signal) from None  # nothing was sent yet
        print(f'{kind}: {error}', file=sys.stderr)
        try_shutdown()
        return 2
    try:
        return node.run()
    except BlfError as error:
        node.nodes[0].get_logger().fatal(str(error))
        return 2
    finally:
        with leaves_in_time():
            node.destroy_node()
            try_shutdown()


def _check_alone_and_complete(runnable: Runnable, args: list[str]) -> None:
    """Raise BlfError, the nodes destroyed, where they are not to run."""
    kinds = {node.kind for node in runnable.nodes}
    try:
        for node in runnable.nodes:
            check_all_reached(node, kinds, args)
        for node in runnable.nodes:
            refuse_beside_another(node)
    except BlfError:
        for node in runnable.nodes:
            node.withdraw()
        with leaves_in_time():
            runnable.destroy_node()
        raise


def initialise(kind: str, args: list[str] | None) -> None:
    """Start ROS without its signal handlers, which would end it before the last torque is sent.

    Raises:
        ParameterError: a parameter file cannot be used; names parameter, value and expectation.
        RuntimeError: ROS does not accept another argument.
    """
    warn_of_leftovers(kind)
    arguments = sys.argv if args is None else args
    check_files(arguments)
    set_logger_level('rcl', LoggingSeverity.FATAL)  # its log line would say less than the error
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        explain_files(arguments, kind)
        unknown = type(error).__name__ == 'UnknownROSArgsError'
        raise RuntimeError(f'unknown ROS arguments {error}' if unknown else
                           str(error).split(', at /')[0]) from None
    finally:
        if get_logger_level('rcl') == LoggingSeverity.FATAL:
            set_logger_level('rcl', LoggingSeverity.UNSET)


def warn_of_leftovers(kind: str) -> None:
    """Name the files for which every node on this host would wait for ever.

    A process that is killed while Fast DDS makes its shared memory leaves an empty port, and a
    process that opens it waits for its content.
    """
    for path in SHARED_MEMORY.glob('fastrtps_port*'):
        try:
            state = path.stat()
        except OSError:  # gone meanwhile
            continue
        if state.st_size == 0 and path.name[-3:] != '_el' and time.time() - state.st_mtime > 10.0:
            print(f'{kind}: {path} is empty: left by a process that was killed while it started. '
                  'Nodes may wait for it for ever: remove it if none is starting',
                  file=sys.stderr)
