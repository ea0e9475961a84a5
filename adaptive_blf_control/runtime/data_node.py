# SPDX-License-Identifier: Apache-2.0
"""What the four nodes share: parameters, raw data topics, the loop, diagnostics, a clean end."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
import functools
import gc
import inspect
import math
import sys
import threading
import time
from typing import Any, Generic, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import ROSClock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.time import Time as ROSTime

from adaptive_blf_control.compiled import before_each_compilation
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.diagnostics import encode_diagnostics
from adaptive_blf_control.runtime.direct_wait import (
    DIRECT,
    DirectChannel,
    DirectWait,
    HandleGone,
    MOST,
    PlainChannel,
    PlainWait,
    take_over_clock,
)
from adaptive_blf_control.runtime.loop_statistics import LoopStatistics
from adaptive_blf_control.runtime.node_parameters import (
    declare,
    NodeSettings,
    on_change,
    refuse_untyped,
)
from adaptive_blf_control.runtime.realtime import (
    cpus_of,
    lock_memory,
    raise_priority,
    short_slices,
    stay_on,
    step_back,
)
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['DEPTH', 'LONGEST_WAIT', 'TOO_LATE', 'DataNode', 'Handler']

# A wait on data alone does not see a stop request: it ends at least this often to look.
LONGEST_WAIT = 0.05  # s
# Each pass of the executor builds a wait set, and the loop waits for the interpreter meanwhile.
# What there is to serve, and the end, wake it.
REQUESTS_WAIT = 10.0  # s
DEPTH = 100
# Messages that a publisher keeps for a reliable reader that falls behind. Fast DDS goes through
# them when it is told every 3 s what has arrived, and what is published meanwhile waits.
KEPT = 100
KEPT_LOCKSTEP = 1000  # the recorder is not waited for, and nothing is late there
TOO_LATE = 2**31 * 10**9  # ns, the first time that header.stamp cannot hold
LAST_WORDS = 0.3  # s to deliver the last messages at the end
SAY_AGAIN = 1.0  # s between two log lines about the same reason
SWITCH = 2e-5  # s the loop waits at most, each time, for a thread that answers a request
REPORT = 1.0  # s between two diagnostics
DRAIN = 5.0  # s
EMPTY_PASSES = 20
SILENCE = 2.0  # s after which it is said what takes so long

Handler = Callable[[bytes, dict[str, int]], bool | None]


class _Topic(NamedTuple):
    channel: DirectChannel | PlainChannel
    handler: Handler
    newest_only: bool
    wake: bool


class DataNode(Node, Generic[NodeSettings]):
    """A node with raw data topics served by its own loop and the rest by an executor.

    Attributes:
        settings: Validated parameters; their paths are the names.
        stop: Set it to end :meth:`run`.
        exit_code: What the process returns; non-zero after a failure.
        drops: Messages not used, counted by reason.
        superseded: Messages passed over because a newer one was there already.
        between_samples: Held while messages are handled; whoever holds it is between two samples.
        lockstep: Whether time is that of /clock (``use_sim_time``) and every sample is answered.
        statistics: How well the loop holds its rate.
        last_fault: What went wrong last, '' where nothing has.
    """

    def __init__(self, kind: str, settings_class: type[NodeSettings], *,
                 context: Context | None = None, stop: StopFlag | None = None,
                 **options: Any) -> None:
        """Make the node named ``kind`` and declare its parameters.

        Args:
            kind: Kind of the node and its name, unless remapped.
            settings_class: Declares its parameters.
            context: Context of ROS, the default one where None.
            stop: What asks the node to stop, already while it is made; its own where None.
            options: As of ``rclpy.node.Node``.
        """
        try:
            super().__init__(kind, context=context,
                             automatically_declare_parameters_from_overrides=True, **options)
        except ValueError:  # rclpy does not tell which
            refuse_untyped(self, kind)
            raise
        self.kind = kind
        try:
            self.settings = declare(self, kind, settings_class)
            cpus_of(self.settings.realtime.cpus)
        except BlfError:
            self.destroy_node()
            raise
        self.lockstep = bool(self.get_parameter('use_sim_time').value)
        self._ros_clock = self.get_clock()
        if self.lockstep:
            take_over_clock(self)
        self.stop = stop or StopFlag()
        self.exit_code = 0
        self.drops: dict[str, int] = {}
        self.superseded = 0
        self.between_samples = threading.RLock()
        self.statistics = LoopStatistics()
        self.last_fault = ''
        self._said: dict[str, float] = {}
        self._topics: list[_Topic] = []
        self._leaving: list[Subscription] = []
        self._later: tuple[Handler, bytes, dict[str, int]] | None = None
        self._wait: DirectWait | PlainWait | None = None
        self._executor_alone: SingleThreadedExecutor | None = None
        self._data_publishers: list[Publisher] = []
        self._rate_since = time.monotonic()
        self._report_at = math.inf
        self._rate_samples = 0
        self._direct = self.settings.executor == 'direct'
        if self._direct and not DIRECT:
            self._direct = False
            self.get_logger().warning('this rclpy has no wait sets to use: executor: plain')
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._second = -1
        on_change(self, kind, lambda: self.settings, self._retune_between_samples)
        # rclpy's logger asks inspect for its caller, and the first such question reads every
        # loaded module's file: 50 to 100 ms that must not fall into a control cycle.
        inspect.getframeinfo(sys._getframe())

    def _retune_between_samples(self, settings: NodeSettings, changed: set[str]) -> None:
        with self.between_samples:
            self.retune(settings, changed)
            self.settings = settings

    def retune(self, settings: NodeSettings, changed: set[str]) -> None:
        """Take new settings between two samples, all of them or (BlfError) none."""

    def data_publisher(self, message_type: type, topic: str) -> Publisher:
        """Return a reliable publisher; ``publish(bytes)`` sends CDR as it is."""
        publisher = self.create_publisher(message_type, topic,
                                          KEPT_LOCKSTEP if self.lockstep else KEPT)
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
            handler: Called with the bytes and the message info in the node's loop; returns False
                where it could not use the message.
            wake: Whether a message wakes the loop; else it is taken before the waking ones.
            newest_only: When several messages wait, handle the last that can be used and count
                the others as superseded: acting on old data is worse than not acting on it.
            reliable: Ask for reliable delivery; best effort also hears reliable publishers.
            latched: Ask for what a transient local publisher sent before.
            depth: History depth.
        """
        qos = QoSProfile(depth=depth)
        if latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        qos.reliability = (ReliabilityPolicy.RELIABLE if reliable
                           else ReliabilityPolicy.BEST_EFFORT)
        channel = (DirectChannel if self._direct else PlainChannel)(self, message_type, topic, qos)
        # Those that do not wake come first: they are handled before what they are needed for.
        self._topics.insert(len(self._topics) if wake else sum(not t.wake for t in self._topics),
                            _Topic(channel, handler, newest_only, wake))
        self._wait = None
        return channel.subscription

    def end_data_subscription(self, subscription: Subscription) -> None:
        """Stop hearing what :meth:`data_subscription` returned; call it between two samples."""
        self._topics = [t for t in self._topics if t.channel.subscription is not subscription]
        self._later = None  # it may have come from there
        self._leaving.append(subscription)  # the loop may be waiting on it

    def _forget_leaving(self) -> None:
        self._wait = None
        while self._leaving:
            self.destroy_subscription(self._leaving.pop())

    def end_data_publisher(self, publisher: Publisher) -> None:
        """Take down what :meth:`data_publisher` returned."""
        self._data_publishers.remove(publisher)
        self.destroy_publisher(publisher)

    def drop(self, reason: str, detail: str) -> None:
        """Count a message that is not used and say why, at most once a second per reason."""
        self.drops[reason] = self.drops.get(reason, 0) + 1
        if self._may_say(reason):
            self.get_logger().warning(f'{reason}: {detail} ({self.drops[reason]} so far)')

    def fault(self, reason: str, text: str) -> None:
        """Keep ``text`` as the last fault and log it, at most once a second per ``reason``."""
        self.last_fault = text
        if self._may_say(reason):
            self.get_logger().error(text)

    def _may_say(self, reason: str) -> bool:
        # The logger's own throttle goes by line of code, so one reason would silence another.
        now = time.monotonic()
        if now - self._said.get(reason, -SAY_AGAIN) < SAY_AGAIN:
            return False
        self._said[reason] = now
        return True

    def sampled(self, stamp_ns: int = 0) -> None:
        """Count one sample of the node's work, measured at ``stamp_ns``."""
        self.statistics.sample(time.monotonic_ns(), stamp_ns)
        if isinstance(self._ros_clock, ROSClock) and self.lockstep:
            stamp_ns = min(max(stamp_ns, 0), TOO_LATE - 1)  # rclpy knows no other times
            self._ros_clock.set_ros_time_override(
                ROSTime(nanoseconds=stamp_ns, clock_type=ClockType.ROS_TIME))
            if stamp_ns // 10**9 != self._second:
                self._second = stamp_ns // 10**9
                self._report(stamp_ns)

    def spin_data(self, timeout: float = LONGEST_WAIT) -> int:
        """Wait for data for at most ``timeout`` [s], handle what is there, return how much."""
        with self.between_samples:
            if self._leaving:
                self._forget_leaving()
            wait = self._wait = self._wait or self._new_wait()
        wait.wait(min(timeout, LONGEST_WAIT))
        begin, handled = time.monotonic_ns(), 0
        with self.between_samples:
            for topic in self._topics:
                taken = topic.channel.take(topic.handler, topic.newest_only)
                handled += taken
                if topic.newest_only and taken > 1:
                    self.superseded += taken - 1
            waiting, self._later = self._later, None
            if waiting is not None:
                waiting[0](*waiting[1:])
        if handled:
            self.statistics.callback.add(time.monotonic_ns() - begin)
        # Here, with the work on a sample just done, and not in a thread that would take the
        # interpreter away in the middle of one, nor in front of a state that is due.
        now = time.monotonic()
        if now >= self._report_at + (0.0 if handled else LONGEST_WAIT):
            self._report_at = now + REPORT
            with self.between_samples:
                self._report()
        return handled

    def take_the_rest(self) -> None:
        """Handle all that has arrived, for at most ``DRAIN``: who sends may not stop."""
        # The executor serves one message at a time, and in between what is none.
        least, needed = (MOST, 1) if self._direct else (1, EMPTY_PASSES)
        give_up, empty = time.monotonic() + DRAIN, 0
        while empty < needed and time.monotonic() < give_up:
            empty = 0 if self.spin_data(0.0) >= least else empty + 1

    def compiling(self) -> AbstractContextManager[None]:
        """Return a context for work that may compile, which takes half a minute the first time.

        It says so, and where the node is asked to stop a BlfError ends it before the next
        function; none takes more than a few seconds.
        """
        begun: list[float] = []

        def before_compilation() -> None:
            if self.stop.is_set():
                raise BlfError('asked to stop while it was compiling')
            begun.append(time.monotonic())
            if begun[-1] > begun[0] + SILENCE:
                self.get_logger().info('compiling for this machine: once, up to half a minute',
                                       once=True)

        return before_each_compilation(before_compilation)

    def later(self, handler: Handler, data: bytes, info: dict[str, int]) -> None:
        """Hand the message to ``handler`` again with the next that is heard, or after a while.

        In lockstep alone: there a sample waits for what answers the one before it. In real time
        a newer one comes.
        """
        if self.lockstep:
            self._later = handler, data, info

    def drain(self) -> None:
        """Handle what waits on the topics that do not wake the loop; call it in a handler."""
        for topic in self._topics:
            if not topic.wake:
                topic.channel.take(topic.handler, topic.newest_only)

    def _new_wait(self) -> DirectWait | PlainWait:
        if self._direct:
            return DirectWait([t.channel.subscription for t in self._topics if t.wake],
                              self.context)
        if self._executor_alone is None:
            self._executor_alone = self._new_executor()
        return PlainWait(functools.partial(self._serve_once, self._executor_alone))

    def _new_executor(self) -> SingleThreadedExecutor:
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self)
        return executor

    def aged(self, info: dict[str, int]) -> None:
        """Count the time a message took from its publication to being handled, on one host."""
        sent = info.get('source_timestamp')
        if sent and not self.lockstep:
            self.statistics.age.add(time.time_ns() - sent)

    def idle(self) -> None:
        """Do what has to be done between messages: watchdogs. Called after every wait."""

    def finish(self) -> None:
        """Do what has to be done at the end: zero torque, close files."""

    def run(self) -> int:
        """Serve data until :attr:`stop` is set or the context ends; return the exit code."""
        if not self.lockstep:  # there it belongs to the samples, so that runs can be compared
            self._report_at = time.monotonic() + REPORT
        self._ask_for_real_time()
        executor = self._new_executor() if self._direct else None
        thread = threading.Thread(target=self._serve, args=(executor,), daemon=True)
        if executor is not None:
            thread.start()
        sys.setswitchinterval(SWITCH)
        gc.collect()
        gc.freeze()  # nothing made so far will be collected: no pauses for it
        try:
            self._while_up(self.loop)
        finally:
            try:
                self._while_up(self._finish)
                self._while_up(self._deliver)
            finally:
                self.stop.set()
                if executor is not None:
                    executor.create_task(int)  # a wake without work would let it wait on
                    thread.join(timeout=2.0)
                    executor.shutdown(timeout_sec=2.0)
                if self._executor_alone is not None:
                    self._executor_alone.shutdown(timeout_sec=2.0)
        return self.exit_code

    def _ask_for_real_time(self) -> None:
        stay_on(cpus_of(self.settings.realtime.cpus))
        short_slices(self.settings.realtime.slice)
        step_back(self.settings.niceness)
        priority = self.settings.realtime.priority
        refused = [raise_priority(priority) if priority else None,
                   lock_memory() if self.settings.realtime.lock_memory else None]
        for reason in filter(None, refused):
            self.get_logger().warning(f'{reason}: running as usual')

    def _finish(self) -> None:
        with self.between_samples:  # a ramp that is under way comes to its end first
            self.finish()

    def _deliver(self) -> None:
        """Stay a moment until the last messages have arrived: sent is not delivered.

        A process that ended at once would take the final zero torque with it. Whether it arrived
        is only known once the middleware asks, which may take seconds (Fast DDS: 3 s).
        """
        give_up = time.monotonic() + LAST_WORDS
        for publisher in list(self._data_publishers) if self.context.ok() else ():
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
        while self.up:
            self.spin_data()
            with self.between_samples:
                self.idle()

    @property
    def up(self) -> bool:
        """Whether neither the node nor ROS has been asked to stop."""
        return not self.stop.is_set() and self.context.ok()

    def _serve(self, executor: SingleThreadedExecutor) -> None:
        while self.up:
            self._serve_once(executor, REQUESTS_WAIT)

    def _serve_once(self, executor: SingleThreadedExecutor, timeout: float) -> None:
        try:
            executor.spin_once(timeout_sec=timeout)
        except ExternalShutdownException:
            self.stop.set()
        except HandleGone:  # the loop has just given back what the wait was to hold
            return
        except Exception as error:  # one bad request must not take all services away
            if self.up:
                self.drop('failed request', f'{type(error).__name__}: {error}')

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Return level, message and values for the diagnostics (REP 107)."""
        return DiagnosticStatus.OK, 'running', {}

    def _report(self, stamp_ns: int = 0) -> None:
        try:
            self._publish_diagnostics(stamp_ns)
        except Exception as error:  # what is only shown ends no motion
            if self.context.ok():
                self.drop('failed diagnostics', f'{type(error).__name__}: {error}')

    def _publish_diagnostics(self, stamp_ns: int) -> None:
        level, text, values = self.status()
        if not stamp_ns:
            values = {**self._measured(), **values}
        values.update({f'dropped: {reason}': count for reason, count in dict(self.drops).items()})
        values['last fault'] = self.last_fault or 'none'
        if self.context.ok():
            self._diagnostics.publish(encode_diagnostics(
                stamp_ns or self.get_clock().now().nanoseconds, level,
                f'{self.get_name()}: {self.kind}', text,
                self.get_namespace().strip('/') or 'arm', values))

    def _measured(self) -> dict[str, object]:
        now, samples = time.monotonic(), self.statistics.samples
        rate = (samples - self._rate_samples) / max(now - self._rate_since, 1e-9)
        self._rate_samples, self._rate_since = samples, now
        return {'rate [Hz]': f'{rate:.1f}', **self.statistics.take(),
                'superseded messages': self.superseded}
