# SPDX-License-Identifier: Apache-2.0
"""Services, parameters and timers of a node, served by rclpy's executor beside the data."""

from __future__ import annotations

from collections.abc import Callable
import threading

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from adaptive_blf_control.runtime.rclpy_internals import HandleGone
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['RequestServer']

# Each pass of the executor builds a wait set and holds the interpreter meanwhile. Requests and
# the end of the node wake it, so a pass may be long.
LONGEST_PASS = 10.0  # s
END_TIMEOUT = 2.0  # s for the thread, and for the executor, to end


class RequestServer:
    """Serves in a thread of its own (:meth:`start`), or in the loop by :meth:`serve_once`."""

    def __init__(self, node: Node, stop: StopFlag, failed: Callable[[str], None]) -> None:
        """Prepare to serve ``node`` until ``stop``.

        Args:
            node: Whose requests are served.
            stop: Set it to end; it is set here where ROS is shut down.
            failed: Told what a request raised: one bad request takes no service away.
        """
        self._node = node
        self._stop = stop
        self._failed = failed
        self._executor: SingleThreadedExecutor | None = None
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Serve in a thread."""
        self._thread = threading.Thread(target=self._serve, args=(self._ready_executor(),),
                                        daemon=True)
        self._thread.start()

    def serve_once(self, timeout: float) -> None:
        """Serve one request, or return when ``timeout`` [s] has passed."""
        self._once(self._ready_executor(), timeout)

    def close(self) -> None:
        """End thread and executor; the stop flag has to be set."""
        if self._executor is None:
            return
        if self._thread is not None:
            self._executor.create_task(int)  # a mere wake-up would let it go on waiting
            self._thread.join(timeout=END_TIMEOUT)
        self._executor.shutdown(timeout_sec=END_TIMEOUT)

    def _ready_executor(self) -> SingleThreadedExecutor:
        if self._executor is None:
            self._executor = SingleThreadedExecutor(context=self._node.context)
            self._executor.add_node(self._node)
        return self._executor

    def _serve(self, executor: SingleThreadedExecutor) -> None:
        while self._goes_on():
            self._once(executor, LONGEST_PASS)

    def _goes_on(self) -> bool:
        return not self._stop.is_set() and self._node.context.ok()

    def _once(self, executor: SingleThreadedExecutor, timeout: float) -> None:
        try:
            executor.spin_once(timeout_sec=timeout)
        except ExternalShutdownException:
            self._stop.set()
        except HandleGone:  # the loop has just given back what the wait was to hold
            return
        except Exception as error:
            if self._goes_on():
                self._failed(f'{type(error).__name__}: {error}')
