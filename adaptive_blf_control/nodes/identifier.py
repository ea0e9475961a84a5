# SPDX-License-Identifier: Apache-2.0
"""``identifier``: joint states in, parameter estimate and the rank of its history stack out."""

from __future__ import annotations

from collections import deque
from pathlib import Path
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from rclpy.context import Context
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Int32
from std_srvs.srv import Trigger

from adaptive_blf_control.bags.cdr import encode_float64, encode_int32
from adaptive_blf_control.bags.joint_state import JointStateCodec, JointStateReader
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.identification.estimate_file import write_estimate
from adaptive_blf_control.identification.rank_condition import rank_warning
from adaptive_blf_control.nodes.data_node import DataNode, DEPTH, run_node, TOO_LATE
from adaptive_blf_control.nodes.node_parameters import on_change
from adaptive_blf_control.nodes.robot_description import arm_of
from adaptive_blf_control.parameters.build import build_identifier, identifier_settings
from adaptive_blf_control.topics import (
    ADAPTATION_TERM,
    EXCITATION,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    JOINT_STATES,
    THETA_HAT,
)

__all__ = ['IdentifierNode', 'main']

# Rank and σ_min are published when they change and at least every this many samples.
HEARTBEAT = 200


class IdentifierNode(DataNode):
    """Torque-filtered concurrent learning on the joint states of a running arm.

    Attributes:
        identifier: The object that learns; its ``theta`` and ``stack`` are what is published.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        """Build the identifier from the parameters."""
        super().__init__('identifier', context=context, **options)
        self.arm = arm_of(self)
        self.identifier = build_identifier(self.values, self.arm)
        self.identifier.warm_up()
        warning = rank_warning(self.identifier.settings, self.arm.n, self.arm.m)
        if warning:
            self.get_logger().warning(warning)
        self._changes = 0
        # A few, because a backlog of states needs the terms of their own times.
        self._terms: deque[tuple[int, np.ndarray]] = deque(maxlen=DEPTH)
        self._zero_ns: int | None = None
        self._published_insertions = -1
        self._since_published = 0
        self._reset_requested = False
        self._state_reader = JointStateReader(self.arm.joints)
        self._term_reader = JointStateReader(self.arm.parameters)
        self._theta_codec = JointStateCodec(self.arm.parameters, fields=('position',))
        self._theta = self.data_publisher(JointState, THETA_HAT)
        self._rank = self.data_publisher(Int32, HISTORY_RANK)
        self._sigma_min = self.data_publisher(Float64, HISTORY_SIGMA_MIN)
        self._excitation = self.data_publisher(Float64, EXCITATION)
        self.data_subscription(JointState, ADAPTATION_TERM, self.on_adaptation_term, wake=False)
        self.data_subscription(JointState, JOINT_STATES, self.on_joint_states)
        self.create_service(Trigger, '~/reset_history', self.on_reset_history)
        self.create_service(Trigger, '~/save_estimate', self.on_save_estimate)
        on_change(self, 'identifier', self.values, self._retune)

    def _retune(self, values: dict[str, Any]) -> None:
        # θ̂(0) is history; its file may be gone or hold another arm's by now.
        settings = identifier_settings({**values, 'initial_estimate_file': ''}, self.arm)
        self.identifier.settings = settings  # one assignment: between two samples

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
        if self._reset_requested:
            self._reset_requested = False
            self.identifier.reset_history()
        if self._zero_ns is None:
            self._zero_ns = stamp  # seconds since 1970 as a double would cost 2e-7 s of precision
        theta = self.identifier.update((stamp - self._zero_ns) * 1e-9, q, qd, tau,
                                       self._held_term(stamp))
        self.sampled()
        self._theta.publish(self._theta_codec.encode(stamp, theta))
        stack = self.identifier.stack
        self._since_published += 1
        if stack.insertions != self._published_insertions or self._since_published >= HEARTBEAT:
            self._published_insertions, self._since_published = stack.insertions, 0
            self._rank.publish(encode_int32(stack.rank))
            self._sigma_min.publish(encode_float64(stack.sigma_min))
            excitation = self.identifier.excitation
            if excitation is not None:
                self._excitation.publish(encode_float64(excitation))
        if self.identifier.monitor.changes != self._changes:
            self._changes = self.identifier.monitor.changes
            self.get_logger().warning(f'the arm has changed: the history is emptied '
                                      f'({self._changes} so far)')

    def _held_term(self, stamp: int) -> np.ndarray | None:
        """Return the newest term sent before ``stamp``, the one held over the interval before."""
        for sent, term in reversed(self._terms):
            if sent < stamp:
                fresh = (stamp - sent) * 1e-9 <= self.values['adaptation_term_timeout']
                return term if fresh else None
        return None

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
        path = Path(self.values['estimate_file'])
        try:
            write_estimate(path, self.arm.parameters, self.identifier)
        except (OSError, ValueError) as error:
            response.success, response.message = False, f'{path}: {error}'
        else:
            response.success, response.message = True, str(path.resolve())
        return response

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Report rank, σ_min and what was not used."""
        stack, identifier = self.identifier.stack, self.identifier
        values: dict[str, object] = {
            'rank': stack.rank, 'parameters': self.arm.m, 'sigma_min': f'{stack.sigma_min:.6g}',
            'pairs': stack.count, 'insertions': stack.insertions,
            'filter restarts': identifier.restarts,
            'changes of the arm': identifier.monitor.changes,
            'excitation index': identifier.excitation,
            'norm of theta_hat': f'{np.linalg.norm(identifier.theta):.6g}',
            **{f'samples {reason}': count for reason, count in identifier.dropped.items()}}
        if stack.rank < self.arm.m:
            return DiagnosticStatus.OK, f'learning: rank {stack.rank} of {self.arm.m}', values
        return DiagnosticStatus.OK, 'rank full', values


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_node('identifier', IdentifierNode, args)


if __name__ == '__main__':
    sys.exit(main())
