# SPDX-License-Identifier: Apache-2.0
"""The diagnostics of a node (REP 107), once a second: of real time, or of the samples."""

from __future__ import annotations

from collections.abc import Callable
import math
import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from adaptive_blf_control.messages.diagnostics import encode_diagnostics
from adaptive_blf_control.runtime.fault_log import FaultLog
from adaptive_blf_control.runtime.loop_statistics import LoopStatistics

__all__ = ['Status', 'StatusReport']

Status = tuple[bytes, str, dict[str, object]]  # level, message, values
PERIOD = 1.0  # s
QUEUE_DEPTH = 10  # one message a second


class StatusReport:
    """Publishes what a node says of itself with its faults and the figures of its loop."""

    def __init__(self, node: Node, kind: str, status: Callable[[], Status], faults: FaultLog,
                 statistics: LoopStatistics) -> None:
        """Make the topic; nothing is published before :meth:`begin` or :meth:`sampled`.

        Args:
            node: Whose diagnostics they are.
            kind: Its kind.
            status: Returns level, message and values.
            faults: What went wrong in it.
            statistics: Of its loop.
        """
        self._node = node
        self._kind = kind
        self._status = status
        self._faults = faults
        self._statistics = statistics
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', QUEUE_DEPTH)
        self._due = math.inf  # monotonic [s]
        self._second = -1  # of the samples' time
        self._since, self._samples_before = time.monotonic(), 0

    def begin(self) -> None:
        """Report every second of real time from now on."""
        self._due = time.monotonic() + PERIOD

    def due(self, delay: float) -> bool:
        """Whether a report has been due for ``delay`` [s]; the next is due a period from now."""
        now = time.monotonic()
        if now < self._due + delay:
            return False
        self._due = now + PERIOD
        return True

    def sampled(self, stamp_ns: int) -> None:
        """Report in lockstep, with the first sample of each second of their time [ns]."""
        if stamp_ns // 10**9 != self._second:
            self._second = stamp_ns // 10**9
            self.publish(stamp_ns)

    def publish(self, stamp_ns: int = 0) -> None:
        """Report now; at the time of a sample without the figures of the machine."""
        try:
            self._publish(stamp_ns)
        except Exception as error:  # what is only shown ends no motion
            if self._node.context.ok():
                self._faults.drop('failed diagnostics', f'{type(error).__name__}: {error}')

    def _publish(self, stamp_ns: int) -> None:
        node, faults = self._node, self._faults
        level, text, values = self._status()
        if not stamp_ns:
            values = {**self._figures(), **values}
        values.update({f'dropped: {reason}': n for reason, n in dict(faults.drops).items()})
        values['last fault'] = faults.last or 'none'
        if node.context.ok():
            self._publisher.publish(encode_diagnostics(
                stamp_ns or node.get_clock().now().nanoseconds, level,
                f'{node.get_name()}: {self._kind}', text,
                node.get_namespace().strip('/') or 'arm', values))

    def _figures(self) -> dict[str, object]:
        now, samples = time.monotonic(), self._statistics.samples
        rate = (samples - self._samples_before) / max(now - self._since, 1e-9)
        self._samples_before, self._since = samples, now
        return {'rate [Hz]': f'{rate:.1f}', **self._statistics.take(),
                'superseded messages': self._statistics.superseded}
