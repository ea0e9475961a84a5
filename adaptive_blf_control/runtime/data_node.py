# SPDX-License-Identifier: Apache-2.0
"""What the four nodes share, put together from its parts: a loop over raw data topics."""

from __future__ import annotations

from collections.abc import Callable
import gc
import secrets
import sys
import threading
import time
from typing import Any, Generic

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runtime.channels import LARGEST_BATCH, LONGEST_WAIT
from adaptive_blf_control.runtime.data_topics import DataTopics
from adaptive_blf_control.runtime.fault_log import FaultLog
from adaptive_blf_control.runtime.loop_statistics import LoopStatistics
from adaptive_blf_control.runtime.node_parameters import (
    declare,
    ill_formed,
    NodeSettings,
    on_change,
    refuse_untyped,
)
from adaptive_blf_control.runtime.rclpy_internals import DIRECT, know_callers_of_loggers
from adaptive_blf_control.runtime.realtime import cpus_of, go_first
from adaptive_blf_control.runtime.request_server import RequestServer
from adaptive_blf_control.runtime.sample_clock import SampleClock
from adaptive_blf_control.runtime.status_report import Status, StatusReport
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['PAUSE', 'DataNode']

DELIVERY_TIMEOUT = 0.3  # s for the last messages at the end
DRAIN_TIMEOUT = 5.0  # s
# Passes of rclpy's executor without data, in a row, after which all data have been taken: a single
# one may have served something else.
EMPTY_PASSES = 20
# Python's default of 5 ms would let a thread that answers a request delay a control cycle.
SWITCH_INTERVAL = 2e-5  # s
PAUSE = 2.0 * LONGEST_WAIT  # s between two passes of the loop: something kept it


def _new_label(name: str) -> str:
    """Return what the messages of a node with this full name say of their source.

    No other process says the same, so that a restarted node is another source.
    """
    return f'{name}#{secrets.token_hex(4)}'


class DataNode(Node, Generic[NodeSettings]):
    """A node whose loop serves raw data topics, and whose requests are served beside it.

    A subclass subscribes and publishes through :attr:`topics` and fills in :meth:`retune`,
    :meth:`idle`, :meth:`finish` and :meth:`status`.

    Attributes:
        kind: Kind of the node, by which its parameters are declared.
        joined_at: Since when DDS finds other nodes for this one, monotonic [s].
        settings: Validated parameters; their paths are the names.
        stop: Set it to end :meth:`run`.
        exit_code: What the process returns; non-zero after a failure.
        topics: What the loop hears and sends.
        faults: Dropped messages and faults.
        statistics: How well the loop holds its rate.
        between_samples: Held while messages are handled; its holder is between two samples.
        label: What its messages say of their source; '' in lockstep, where every run is to send
            the same bytes.
        lockstep: Whether time is that of /clock (``use_sim_time``) and every sample is answered.
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
        self.kind, self.joined_at = kind, time.monotonic()
        try:
            self.settings = declare(self, kind, settings_class)
            cpus_of(self.settings.realtime.cpus)
        except BlfError:
            self.destroy_node()
            raise
        self.lockstep = bool(self.get_parameter('use_sim_time').value)
        self.label = '' if self.lockstep else _new_label(self.get_fully_qualified_name())
        self.stop = stop or StopFlag()
        self.exit_code = 0
        self._listening_since = float('-inf')
        self._passed_at = float('inf')  # when the loop last waited for data
        self.between_samples = threading.RLock()
        self._compose()
        on_change(self, kind, lambda: self.settings, self._retune_between_samples)
        know_callers_of_loggers()

    def _compose(self) -> None:
        direct = self.settings.executor == 'direct'
        if direct and not DIRECT:
            direct = False
            self.get_logger().warning('this rclpy has no wait sets to use: executor: plain')
        self.faults = FaultLog(self.get_logger())
        self._cautions: list[str] = []  # of the request being answered
        self.statistics = LoopStatistics()
        self._clock_of_samples = SampleClock(self) if self.lockstep else None
        self._requests = RequestServer(
            self, self.stop, lambda text: self.faults.drop('failed request', text))
        self.topics = DataTopics(self, self.statistics, self._requests.serve_once,
                                 direct=direct, lockstep=self.lockstep)
        self._diagnostics = StatusReport(self, self.kind, self.status, self.faults,
                                         self.statistics)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all of them or none, as rclpy does.

        A refusal says what would be accepted, a success what is to be said of the new values.
        """
        problem = ill_formed(self, self.kind, parameter_list)
        if problem is not None:
            return SetParametersResult(successful=False, reason=str(problem))
        self._cautions.clear()
        result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            result.reason = '; '.join(self._cautions)
        return result

    def caution(self, text: str) -> None:
        """Log what is to be said of settings that are taken; who sets them live is told, too."""
        self.get_logger().warning(text)
        self._cautions.append(text)

    def _retune_between_samples(self, settings: NodeSettings, changed: set[str]) -> None:
        with self.between_samples:
            self.retune(settings, changed)
            self.settings = settings

    def retune(self, settings: NodeSettings, changed: set[str]) -> None:
        """Take new settings between two samples, all of them or (BlfError) none."""

    def wait_to_start(self, timeout: float) -> None:
        """Let ``timeout`` [s] pass before :meth:`run`; a node that need not wait may work."""
        time.sleep(timeout)

    def withdraw(self) -> None:
        """Undo what was begun, because the node is not to run; called in place of :meth:`run`."""

    def idle(self) -> None:
        """Do what has to be done between messages: watchdogs. Called after every wait."""

    def finish(self) -> None:
        """Do what has to be done at the end: zero torque, close files."""

    def status(self) -> Status:
        """Return level, message and values for the diagnostics (REP 107)."""
        return DiagnosticStatus.OK, 'running', {}

    @property
    def nodes(self) -> tuple[DataNode[Any], ...]:
        """The nodes that run where this one runs: itself."""
        return (self,)

    @property
    def up(self) -> bool:
        """Whether neither the node nor ROS has been asked to stop."""
        return not self.stop.is_set() and self.context.ok()

    def sampled(self, stamp_ns: int = 0) -> None:
        """Count one sample of the node's work, measured at ``stamp_ns``."""
        self.statistics.sample(time.monotonic_ns(), stamp_ns)
        if self._clock_of_samples is not None:
            self._diagnostics.sampled(self._clock_of_samples.show(stamp_ns))

    def aged(self, info: dict[str, int]) -> None:
        """Count the time a message took from its publication to being handled, on one host."""
        sent = info.get('source_timestamp')
        if sent and not self.lockstep:
            self.statistics.age.add(time.time_ns() - sent)

    @property
    def listening_since(self) -> float:
        """When the loop last went on after a pause longer than PAUSE, monotonic [s].

        E.g. because the process was stopped: it heard nothing meanwhile. Minus infinity before
        the first pause. Ask for it after the time that it is compared with.
        """
        self._note_pause()  # one that a handler is in
        return self._listening_since

    def _note_pause(self) -> float:
        """Note a pause that ends now, and return the time [s]."""
        now = time.monotonic()
        if now - self._passed_at > PAUSE:
            self._listening_since = now
        return now

    def spin_data(self, timeout: float = LONGEST_WAIT) -> int:
        """Wait for data for at most ``timeout`` [s], handle what is there, return how much."""
        with self.between_samples:
            wait = self.topics.ready()
        wait.wait(min(timeout, LONGEST_WAIT))
        self._passed_at = self._note_pause()
        return self.work(self.topics.handle)

    def work(self, handle: Callable[[], int]) -> int:
        """Call ``handle``, which returns how much it did, between two samples; report if due."""
        begin = time.monotonic_ns()
        with self.between_samples:
            handled = handle()
        if handled:
            self.statistics.callback.add(time.monotonic_ns() - begin)
        # Here, with the work on a sample just done, and not in a thread that would take the
        # interpreter away in the middle of one, nor in front of a state that is due.
        if self._diagnostics.due(0.0 if handled else LONGEST_WAIT):
            with self.between_samples:
                self._diagnostics.publish()
        return handled

    def take_the_rest(self) -> None:
        """Handle all that has arrived, for at most DRAIN_TIMEOUT: the senders may not stop."""
        # The executor serves one message at a time, and other things in between.
        least, needed = (LARGEST_BATCH, 1) if self.topics.direct else (1, EMPTY_PASSES)
        give_up, empty = time.monotonic() + DRAIN_TIMEOUT, 0
        while empty < needed and time.monotonic() < give_up:
            empty = 0 if self.spin_data(0.0) >= least else empty + 1

    def loop(self) -> None:
        """Serve data until the end; the driver replaces this with a timed loop."""
        while self.up:
            self.spin_data()
            with self.between_samples:
                self.idle()

    def run(self) -> int:
        """Serve data until :attr:`stop` is set or the context ends; return the exit code."""
        for reason in go_first(self.settings.realtime, self.settings.niceness):
            self.get_logger().warning(f'{reason}: running as usual')
        self.begin(in_a_thread=self.topics.direct)
        sys.setswitchinterval(SWITCH_INTERVAL)
        gc.collect()
        gc.freeze()  # what is made so far stays: collecting it costs no pauses
        try:
            self._unless_ros_ends(self.loop)
        finally:
            self.end()
        return self.exit_code

    def begin(self, *, in_a_thread: bool) -> None:
        """Report once a second from now on, and answer requests ``in_a_thread`` or in the loop."""
        if not self.lockstep:  # there reports go with the samples, and runs compare
            self._diagnostics.begin()
        if in_a_thread:
            self._requests.start()

    def end(self) -> None:
        """Finish, stay until that is delivered, and answer nothing any longer."""
        try:
            self._unless_ros_ends(self._finish)
            self._unless_ros_ends(self._deliver)
        finally:
            self.stop.set()
            self._requests.close()

    def _finish(self) -> None:
        with self.between_samples:  # a ramp that is under way comes to its end first
            self.finish()

    def _deliver(self) -> None:
        """Stay a moment until the last messages have arrived: sent is not delivered.

        A process that ended at once would take the final zero torque with it. Whether it arrived
        is only known once the middleware asks, which may take seconds (Fast DDS: 3 s).
        """
        if self.context.ok():
            self.topics.deliver(DELIVERY_TIMEOUT)

    def _unless_ros_ends(self, action: Callable[[], None]) -> None:
        try:
            action()
        except RuntimeError:  # also rclpy's own errors
            if self.context.ok():
                raise  # else ROS was shut down under a message being sent: that is the end
