# SPDX-License-Identifier: Apache-2.0
"""A node as a process: signals, errors in our words, a clean end."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import signal
import sys
import time

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.logging import get_logger_level, set_logger_level
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.node_parameters import check_files, explain_files
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['initialise', 'run_node', 'stop_on_signals']

SHARED_MEMORY = Path('/dev/shm')


def stop_on_signals() -> StopFlag:
    """Return a flag that is set by a signal that asks the process to end.

    Nothing is raised: an exception out of a handler arrives wherever the signal does, in a
    finaliser or in a callback from C, too, which print it and go on.
    """
    stop = StopFlag()

    def ask(number: int, _: object) -> None:
        stop.signal = stop.signal or number
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, ask)
    return stop


def run_node(kind: str, make: Callable[..., DataNode], args: list[str] | None) -> int:
    """Run a node as a process: signals, clear errors, clean shutdown.

    A signal takes effect before the next sample; while the node is being made, where that
    compiles or waits (:func:`compiling`), or else when it is made.

    Args:
        kind: Name of the node, for messages.
        make: Makes the node around the flag ``stop``.
        args: ROS arguments; those of the process where None.

    Returns:
        The exit status: 2 where the node cannot be made, or ends with an error of ours.

    Raises:
        SystemExit: a signal ended the making.
    """
    stop = stop_on_signals()

    try:
        initialise(kind, args)
        node = make(stop=stop)
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
        node.get_logger().fatal(str(error))
        return 2
    finally:
        node.destroy_node()
        try_shutdown()


def initialise(kind: str, args: list[str] | None) -> None:
    """Start ROS without its signal handlers: the last torque and the bag's end come before.

    Raises:
        ParameterError: a parameter file cannot be used, with the reason in our words.
        RuntimeError: any other argument ROS does not take.
    """
    _warn_of_leftovers(kind)
    arguments = sys.argv if args is None else args
    check_files(arguments)
    set_logger_level('rcl', LoggingSeverity.FATAL)  # says less than what is raised, and first
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


def _warn_of_leftovers(kind: str) -> None:
    """Name what would let every node of this host wait for ever.

    A process killed while Fast DDS made its shared memory leaves a port without content, and
    whoever opens it waits for the content.
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
