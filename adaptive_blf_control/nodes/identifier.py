# SPDX-License-Identifier: Apache-2.0
"""``identifier``: joint states in, parameter estimate and the rank of its history stack out."""

from __future__ import annotations

from collections import deque
from datetime import datetime, timezone
import os
from pathlib import Path
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.timer import Timer
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32
from std_srvs.srv import Trigger

from adaptive_blf_control.configuration.build import build_identifier
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.identification.estimate_file import (
    estimate_path,
    recent_estimate,
    write_estimate,
)
from adaptive_blf_control.identification.rank_condition import rank_warning
from adaptive_blf_control.identification.republish import HistoryPublication
from adaptive_blf_control.messages.cdr import encode_float64, encode_int32
from adaptive_blf_control.messages.joint_state import JointStateCodec, JointStateReader
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    EXCITATION,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    JOINT_STATES,
    THETA_HAT,
)
from adaptive_blf_control.runtime.data_node import DataNode, DEPTH, TOO_LATE
from adaptive_blf_control.runtime.process import run_node
from adaptive_blf_control.runtime.robot_description import arm_of

__all__ = ['IdentifierNode', 'main']


SHORTEST_SAVE = 0.1  # s; each write waits for the disk


class IdentifierNode(DataNode[IdentifierNodeSettings]):
    """Torque-filtered concurrent learning on the joint states of a running arm.

    Attributes:
        identifier: The object that learns; its ``theta`` and ``stack`` are what is published.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        """Build the identifier from the parameters."""
        super().__init__('identifier', IdentifierNodeSettings, context=context, **options)
        with self.compiling():
            self.arm = arm_of(self, self.settings)
            self.identifier = build_identifier(self.settings, self.arm, self._where_it_was())
            self.identifier.warm_up()
        self._check_rank()
        self._changes = 0
        # A few, because a backlog of states needs the terms of their own times.
        self._terms: deque[tuple[int, np.ndarray]] = deque(maxlen=DEPTH)
        self._zero_ns: int | None = None
        self._history = HistoryPublication()
        self._reset_requested = False
        self._state_reader = JointStateReader(self.arm.joints)
        self._term_reader = JointStateReader(self.arm.parameters)
        self._theta_codec = JointStateCodec(self.arm.parameters, fields=('position',))
        self._theta = self.data_publisher(JointState, THETA_HAT)
        self._rank = self.data_publisher(Int32, HISTORY_RANK)
        self._sigma_min = self.data_publisher(Float64, HISTORY_SIGMA_MIN)
        self._excitation = self.data_publisher(Float64, EXCITATION)
        self._last_ns = 0
        self._reported = self.identifier.theta, 0.0
        self.data_subscription(JointState, ADAPTATION_TERM, self.on_adaptation_term,
                               wake=self.lockstep, reliable=self.lockstep)
        self.data_subscription(JointState, JOINT_STATES, self.on_joint_states,
                               reliable=self.lockstep)
        self.create_service(Trigger, '~/reset_history', self.on_reset_history)
        self.create_service(Trigger, '~/save_estimate', self.on_save_estimate)
        self._saved_samples = 0
        self._saver: Timer | None = None
        self._set_saver(self.settings.estimate_period)

    def _check_rank(self) -> None:
        warning = rank_warning(self.identifier.settings, self.arm.n, self.arm.m)
        if warning:
            self.get_logger().warning(warning)

    def _where_it_was(self) -> np.ndarray | None:
        """Return the estimate of an identifier that ended a moment ago, None to start afresh."""
        within = self.settings.resume_within
        if within <= 0.0:
            return None
        path = self._estimate_path()
        theta = recent_estimate(path, self.arm.parameters, _now(), within)
        if theta is not None:
            self.get_logger().info(f'going on from the estimate in {path}')
        return theta

    def _estimate_path(self) -> Path:
        return estimate_path(self.settings.estimate_file, self.get_namespace(), os.environ)

    def _set_saver(self, period: float) -> None:
        if self._saver is not None:
            self.destroy_timer(self._saver)
        self._saver = self.create_timer(
            max(period, SHORTEST_SAVE), self._save_now_and_then,
            clock=Clock(clock_type=ClockType.STEADY_TIME)) if period > 0.0 else None

    def _save_now_and_then(self) -> None:
        if self.statistics.samples == self._saved_samples:
            return  # nothing learned since
        self._saved_samples = self.statistics.samples
        try:
            self._save()
        except (OSError, ValueError) as error:
            self.fault('estimate not written', f'estimate not written: {error}')

    def _save(self) -> Path:
        """Write what is known now; OSError names the file and the reason."""
        path = self._estimate_path()
        with self.between_samples:
            snapshot = self.identifier.snapshot()
        try:
            write_estimate(path, snapshot, _now(), make_folder=not self.settings.estimate_file)
        except OSError as error:
            raise OSError(f'{path}: {error.strerror or error}') from None
        return path

    def finish(self) -> None:
        """Keep what was learned since the last time."""
        if self.settings.estimate_period > 0.0:
            self._save_now_and_then()

    def retune(self, settings: IdentifierNodeSettings, changed: set[str]) -> None:
        """Change gains, filters, monitor or history between two samples."""
        self.identifier.retune(settings)
        self._check_rank()
        if 'estimate_period' in changed:
            self._set_saver(settings.estimate_period)

    def on_adaptation_term(self, data: bytes, info: dict[str, int]) -> None:
        """Keep Xᵀe2 of (37) until the next one; it acts over the interval that follows."""
        try:
            stamp, term, _, _ = self._term_reader.read(data)
        except BagError as error:
            self.drop('unusable adaptation term', str(error))
            return
        if np.isfinite(term).all():
            self._terms.append((stamp, term))
        else:
            self.drop('non-finite adaptation term', 'the last one is kept')

    def on_joint_states(self, data: bytes, info: dict[str, int]) -> None:
        """Learn from one joint state and publish θ̂."""
        try:
            stamp, q, qd, tau = self._state_reader.read(data)
        except BagError as error:
            self.drop('unusable joint state', str(error))
            return
        if stamp >= TOO_LATE:
            self.drop('unusable joint state', f'stamp {stamp} ns does not fit its field')
            return
        if self.lockstep and self._must_wait(stamp):
            self.later(self.on_joint_states, data, info)
            return
        self.drain()  # of a backlog every state needs the term that was sent before it
        if stamp < self._last_ns:  # time begins again: the terms of before are of another run
            self._terms = deque((term for term in self._terms if term[0] < stamp), maxlen=DEPTH)
        self._last_ns = stamp
        self.aged(info)
        if self._reset_requested:
            self._reset_requested = False
            self.identifier.reset_history()
        if self._zero_ns is None:
            self._zero_ns = stamp  # seconds since 1970 as a double would cost 2e-7 s of precision
        theta = self.identifier.update((stamp - self._zero_ns) * 1e-9, q, qd, tau,
                                       self._held_term(stamp))
        stack = self.identifier.stack
        if self._history.due(stack.insertions):
            self._rank.publish(encode_int32(stack.rank))
            self._sigma_min.publish(encode_float64(stack.sigma_min))
            excitation = self.identifier.excitation
            if excitation is not None:
                self._excitation.publish(encode_float64(excitation))
        # Last: it is the answer, and in lockstep it ends the sample.
        self._theta.publish(self._theta_codec.encode(stamp, theta))
        self.sampled(stamp)
        if self.identifier.changes != self._changes:
            self._changes = self.identifier.changes
            self.get_logger().warning(f'the arm has changed: the history is emptied '
                                      f'({self._changes} so far)')

    def _held_term(self, stamp: int) -> np.ndarray | None:
        """Return the newest term sent before ``stamp``, the one held over the interval before."""
        for sent, term in reversed(self._terms):
            if sent < stamp:
                fresh = (stamp - sent) * 1e-9 <= self.settings.adaptation_term_timeout
                return term if fresh else None
        return None

    def _must_wait(self, stamp: int) -> bool:
        """In lockstep a state is used with the adaptation term of the one before it.

        Once a later term is there, that one does not come any more; nor does it for a state that
        is sent again, or begins time anew.
        """
        return (0 < self._last_ns < stamp and all(sent < self._last_ns for sent, _ in self._terms)
                and self.count_publishers(ADAPTATION_TERM) > 0)

    def on_reset_history(self, request: Trigger.Request,
                         response: Trigger.Response) -> Trigger.Response:
        """Empty the history stack before the next sample; θ̂ stays."""
        self._reset_requested = True
        response.success = True
        response.message = f'{self.identifier.stack.count} pairs will be forgotten'
        return response

    def on_save_estimate(self, request: Trigger.Request,
                         response: Trigger.Response) -> Trigger.Response:
        """Write θ̂ to the file of the parameter ``estimate_file``."""
        try:
            path = self._save()
        except (OSError, ValueError) as error:
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, str(path.resolve())
        return response

    def _drift(self) -> float:
        """Return ‖Δθ̂‖ over the time since the last diagnostics [per second]."""
        theta, t = self.identifier.theta, self._last_ns * 1e-9
        before, since = self._reported
        self._reported = theta, t
        return float(np.linalg.norm(theta - before)) / (t - since) if t > since > 0.0 else 0.0

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Report rank, σ_min and what was not used."""
        stack, identifier = self.identifier.stack, self.identifier
        values: dict[str, object] = {
            'rank': stack.rank, 'parameters': self.arm.m, 'sigma_min': f'{stack.sigma_min:.6g}',
            'pairs': stack.count, 'insertions': stack.insertions,
            'change of theta_hat per second, norm': f'{self._drift():.6g}',
            'filter restarts': identifier.restarts,
            'changes of the arm': identifier.changes,
            'artificial noise': 'in use' if identifier.artificial_noise else 'not in use',
            'excitation index': identifier.excitation,
            'norm of theta_hat': f'{np.linalg.norm(identifier.theta):.6g}',
            **{f'samples {reason}': count for reason, count in identifier.dropped.items()}}
        if identifier.artificial_noise:
            return DiagnosticStatus.WARN, ('theta_hat is biased: it is learned with artificial '
                                           'noise (history.noise)'), values
        if stack.rank < self.arm.m:
            return DiagnosticStatus.OK, f'learning: rank {stack.rank} of {self.arm.m}', values
        return DiagnosticStatus.OK, 'rank full', values


def _now() -> str:
    return datetime.now(timezone.utc).isoformat()


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_node('identifier', IdentifierNode, args)


if __name__ == '__main__':
    sys.exit(main())
