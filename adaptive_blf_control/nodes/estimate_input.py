# SPDX-License-Identifier: Apache-2.0
"""The controller's side of ``identifier/theta_hat``: estimates checked, kept, and their age."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.initial_theta import initial_theta
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.estimate_gate import EstimateGate
from adaptive_blf_control.control.source_gate import SourceGate
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.topics import THETA_HAT
from adaptive_blf_control.messages.usual_joint_state import UsualJointStateReader
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.heard_topic import HeardTopic
from adaptive_blf_control.runtime.status_report import Status

__all__ = ['EstimateInput', 'limit_of']

OLD_ESTIMATE = 1.0  # s


class EstimateInput:
    """Estimates as messages.

    Attributes:
        gate: θ̂ in use, and which estimates are refused.
        heard: Whose estimates are believed.
        wanted: Whether the law uses an estimate that the identifier learns.
    """

    def __init__(self, node: DataNode[ControllerNodeSettings], arm: Arm) -> None:
        """Start from ``initial_estimate`` of the node's settings."""
        self.gate = EstimateGate(arm.parameters, initial_theta(node.settings, arm),
                                 limit_of(node.settings, arm))
        self.wanted = False
        self._node = node
        self._reader = UsualJointStateReader(arm.parameters)
        self.heard = HeardTopic(node, THETA_HAT, SourceGate('estimate'), lambda: OLD_ESTIMATE)
        self._received_at: float | None = None  # monotonic [s]

    @property
    def theta(self) -> np.ndarray:
        """θ̂ in use, shape (m,)."""
        return self.gate.theta

    def receive(self, data: bytes, info: dict[str, int]) -> bool:
        """Take an estimate; one that is not finite, too large or of another arm is dropped."""
        node = self._node
        try:
            stamp, theta, _, _ = self._reader.read(data)
        except BagError as error:
            node.faults.drop('unusable estimate', str(error))
            return False
        if not node.lockstep:
            second = self.heard.refuse(self._reader.source, info)
            if second is not None:
                node.faults.refuse(second)
                return False
        return self.take(stamp, theta)

    def take(self, stamp: int, theta: np.ndarray) -> bool:
        """Use θ̂, shape (m,), after the state of ``stamp`` [ns]; False where it is refused."""
        refusal = (self.gate.offer_after(stamp, theta) if self._node.lockstep
                   else self.gate.offer(theta))
        if refusal is not None:
            self._node.faults.refuse(refusal)
            return False
        self._received_at = time.monotonic()
        return True

    def misses(self, last_ns: int | None) -> bool:
        """Whether the state after that of ``last_ns`` has to wait for its estimate (lockstep)."""
        if last_ns is None or not self.wanted:
            return False
        return not self.gate.use_after(last_ns) and self._node.count_publishers(THETA_HAT) > 0

    @property
    def ready(self) -> bool:
        """Whether a motion may begin: an estimate is there, or is not asked for."""
        return (not self.wanted or self._node.lockstep or self._received_at is not None
                or not self._node.settings.wait_for_identifier)

    def status(self, values: dict[str, object]) -> Status:
        """Return the diagnostics of a node that runs: a warning where the estimate is old."""
        if self._received_at is None:
            values['age of the estimate [s]'] = 'none yet'
            return DiagnosticStatus.WARN, 'no estimate yet: initial_estimate is used', values
        age = time.monotonic() - self._received_at
        values['age of the estimate [s]'] = f'{age:.3f}'
        if age > OLD_ESTIMATE:
            text = f'no estimate for {age:.1f} s: the last one is used'
            return DiagnosticStatus.WARN, text, values
        return DiagnosticStatus.OK, 'running', values


def limit_of(settings: ControllerNodeSettings, arm: Arm) -> np.ndarray:
    """Return the largest absolute value of each parameter that is accepted, shape (m,)."""
    return settings.resolved(parameters=arm.m).estimate_limit
