# SPDX-License-Identifier: Apache-2.0
"""What the four nodes share: parameters, raw data topics, the loop, diagnostics, a clean end."""

from __future__ import annotations

from collections.abc import Callable
import gc
import inspect
import signal
import sys
import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import rclpy
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger_level, LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from adaptive_blf_control.errors import BlfError, ParameterError
from adaptive_blf_control.nodes.direct_wait import DataGroup, DirectWait, take_all
from adaptive_blf_control.nodes.node_parameters import (
    check_files,
    declare,
    explain_files,
    refuse_untyped,
)

__all__ = ['TOO_LATE', 'DataNode', 'run_node']

# A wait on data alone does not see a stop request: it ends at least this often to look.
LONGEST_WAIT = 0.05  # s
DEPTH = 100
TOO_LATE = 2**31 * 10**9  # ns, the first time that header.stamp cannot hold
LAST_WORDS = 1.0  # s to deliver the last messages at the end
SAY_AGAIN = 1.0  # s between two log lines about the same reason

Handler = Callable[[bytes, dict[str, int]], None]


class DataNode(Node):
    """A node with raw data topics served by its own loop and the rest by an executor.

    Attributes:
        values: Validated parameters by name.
        stop: Set it to end :meth:`run`.
        exit_code: What the process returns; non-zero after a failure.
        drops: Messages not used, counted by reason.
        superseded: Messages passed over because a newer one was there already.
    """

    def __init__(self, kind: str, *, context: Context | None = None, **options: Any) -> None:
        """Make the node named ``kind`` and declare its table of parameters."""
        try:
            super().__init__(kind, context=context,
                             automatically_declare_parameters_from_overrides=True, **options)
        except ValueError:  # rclpy does not tell which
            refuse_untyped(self, kind)
            raise
        self.kind = kind
        try:
            self.values = declare(self, kind)
            if self.get_parameter('use_sim_time').value:
                raise ParameterError('use_sim_time', True,
                                     'false: the nodes run in real time, simulate in lockstep')
        except BlfError:
            self.destroy_node()
            raise
        self.stop = threading.Event()
        self.exit_code = 0
        self.drops: dict[str, int] = {}
        self._said: dict[str, float] = {}
        self._data_group = DataGroup()
        self._waited: list[tuple[Subscription, Handler, bool]] = []
        self._drained: list[tuple[Subscription, Handler, bool]] = []
        self.superseded = 0
        self._wait: DirectWait | None = None
        self._data_publishers: list[Publisher] = []
        self._samples = 0
        self._rate_since = time.monotonic()
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        # rclpy's logger asks inspect for its caller, and the first such question reads every
        # loaded module's file: 50 to 100 ms that must not fall into a control cycle.
        inspect.getframeinfo(sys._getframe())

    def data_publisher(self, message_type: type, topic: str) -> Publisher:
        """Return a reliable publisher; ``publish(bytes)`` sends CDR as it is."""
        publisher = self.create_publisher(message_type, topic, DEPTH)
        self._data_publishers.append(publisher)
        return publisher

    def data_subscription(self, message_type: type, topic: str, handler: Handler, *,
                          wake: bool = True, newest_only: bool = False,
                          reliable: bool = False, latched: bool = False,
                          depth: int = DEPTH) -> Subscription:
        """Subscribe to raw CDR.

        Args:
            message_type: Type of the topic.
            topic: Name of the topic.
            handler: Called with the bytes and the message info in the node's loop.
            wake: Whether a message wakes the loop; else it is taken before the waking ones.
            newest_only: When several messages wait, handle the last and count the others as
                superseded: acting on old data is worse than not acting on it.
            reliable: Ask for reliable delivery; best effort also hears reliable publishers.
            latched: Ask for what a transient local publisher sent before.
            depth: History depth.
        """
        qos = QoSProfile(depth=depth)
        if latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        qos.reliability = (ReliabilityPolicy.RELIABLE if reliable
                           else ReliabilityPolicy.BEST_EFFORT)
        subscription = self.create_subscription(
            message_type, topic, lambda _: None, qos, callback_group=self._data_group, raw=True)
        (self._waited if wake else self._drained).append(
            (subscription, handler, newest_only))
        self._wait = None
        return subscription

    def end_data_subscription(self, subscription: Subscription) -> None:
        """Stop hearing what :meth:`data_subscription` returned; call it in the node's loop."""
        for entries in (self._waited, self._drained):
            entries[:] = [entry for entry in entries if entry[0] is not subscription]
        self._wait = None
        self.destroy_subscription(subscription)

    def drop(self, reason: str, detail: str) -> None:
        """Count a message that is not used and say why, at most once a second per reason."""
        self.drops[reason] = self.drops.get(reason, 0) + 1
        now = time.monotonic()
        # The logger's own throttle goes by line of code, so one reason would silence another.
        if now - self._said.get(reason, -SAY_AGAIN) >= SAY_AGAIN:
            self._said[reason] = now
            self.get_logger().warning(f'{reason}: {detail} ({self.drops[reason]} so far)')

    def sampled(self) -> None:
        """Count one sample of the node's work, for the rate in the diagnostics."""
        self._samples += 1

    def spin_data(self, timeout: float = LONGEST_WAIT) -> None:
        """Wait for data for at most ``timeout`` [s] and handle all that is there."""
        if self._wait is None:
            self._wait = DirectWait([entry[0] for entry in self._waited], self.context)
        self._wait.wait(min(timeout, LONGEST_WAIT))
        for subscription, handler, newest_only in (*self._drained, *self._waited):
            taken = take_all(subscription, handler, newest_only)
            if newest_only and taken > 1:
                self.superseded += taken - 1

    def idle(self) -> None:
        """Do what has to be done between messages: watchdogs. Called after every wait."""

    def finish(self) -> None:
        """Do what has to be done at the end: zero torque, close files."""

    def run(self) -> int:
        """Serve data until :attr:`stop` is set or the context ends; return the exit code."""
        self.create_timer(1.0, self._publish_diagnostics)
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self)
        thread = threading.Thread(target=self._serve, args=(executor,), daemon=True)
        thread.start()
        gc.collect()
        gc.freeze()  # nothing made so far will be collected: no pauses for it
        try:
            self._while_up(self.loop)
        finally:
            try:
                self._while_up(self.finish)
                self._while_up(self._deliver)
            finally:
                self.stop.set()
                executor.shutdown(timeout_sec=2.0)
                thread.join(timeout=2.0)
        return self.exit_code

    def _deliver(self) -> None:
        """Wait until every reliable subscriber has the last messages: sent is not delivered.

        DDS sends behind our back; a process that ended at once would take the final zero torque
        with it.
        """
        give_up = time.monotonic() + LAST_WORDS
        for publisher in self._data_publishers if self.context.ok() else ():
            left = max(give_up - time.monotonic(), 0.0)
            publisher.wait_for_all_acked(Duration(seconds=left))

    def _while_up(self, action: Callable[[], None]) -> None:
        try:
            action()
        except RuntimeError:  # also rclpy's own errors
            if self.context.ok():
                raise  # else ROS was shut down under a message being sent: that is the end

    def loop(self) -> None:
        """Serve data until the end; the driver replaces this with a timed loop."""
        while not self.stop.is_set() and self.context.ok():
            self.spin_data()
            self.idle()

    def _serve(self, executor: SingleThreadedExecutor) -> None:
        while not self.stop.is_set() and self.context.ok():
            try:
                executor.spin_once(timeout_sec=LONGEST_WAIT)
            except ExternalShutdownException:
                self.stop.set()
            except Exception as error:  # one bad request must not take all services away
                if self.context.ok():
                    self.drop('failed request', f'{type(error).__name__}: {error}')

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Return level, message and values for the diagnostics (REP 107)."""
        return DiagnosticStatus.OK, 'running', {}

    def _publish_diagnostics(self) -> None:
        now = time.monotonic()
        rate = self._samples / max(now - self._rate_since, 1e-9)
        self._samples, self._rate_since = 0, now
        level, text, values = self.status()
        values = {'rate': f'{rate:.1f}', **values,
                  **{f'dropped: {reason}': count for reason, count in dict(self.drops).items()}}
        array = DiagnosticArray()
        array.header.stamp = self.get_clock().now().to_msg()
        array.status = [DiagnosticStatus(
            level=level, name=f'{self.get_name()}: {self.kind}', message=text,
            hardware_id=self.get_namespace().strip('/') or 'arm',
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])]
        if self.context.ok():
            self._diagnostics.publish(array)


def run_node(kind: str, make: Callable[[], DataNode], args: list[str] | None) -> int:
    """Run a node as a process: signals, clear errors, clean shutdown.

    Args:
        kind: Name of the node, for messages.
        make: Makes the node.
        args: ROS arguments; those of the process where None.

    Returns:
        The exit status: 2 where the node cannot be made, or ends with an error of ours.
    """
    made: list[DataNode] = []
    asked: list[int] = []

    def end(number: int, _: object) -> None:
        asked.append(number)
        if not made:  # nothing to wind down yet, and making a node may take long
            raise SystemExit(128 + number)
        made[0].stop.set()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, end)
    try:
        _initialise(kind, args)
        made.append(make())
    except (BlfError, ParameterException, RuntimeError) as error:
        print(f'{kind}: {error}', file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    node = made[0]
    try:
        if asked:  # came in the moment the node was being handed over
            node.stop.set()
        return node.run()
    except BlfError as error:
        node.get_logger().fatal(str(error))
        return 2
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _initialise(kind: str, args: list[str] | None) -> None:
    """Start ROS without its signal handlers: the last torque and the bag's end come before.

    Raises:
        ParameterError: a parameter file cannot be used, with the reason in our words.
        RuntimeError: any other argument ROS does not take.
    """
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
