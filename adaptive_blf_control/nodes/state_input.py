# SPDX-License-Identifier: Apache-2.0
"""Joint states as they come to a node: decoded, and those of one source only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
import time
from typing import NamedTuple

import numpy as np

from adaptive_blf_control.control.refusal import Refusal
from adaptive_blf_control.control.source_gate import SourceGate
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.messages.stamp import STAMP_LIMIT
from adaptive_blf_control.messages.topics import JOINT_STATES
from adaptive_blf_control.messages.usual_joint_state import UsualJointStateReader
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.heard_topic import HeardTopic
from adaptive_blf_control.runtime.message_age import MessageAge

__all__ = ['JointSample', 'StateInput']

UNUSABLE = 'unusable joint state'


class JointSample(NamedTuple):
    """A joint state in the order of the node's joints; arrays of shape (n,).

    Attributes:
        stamp: Of the sample [ns].
        q: Measured positions [rad].
        qd: Measured velocities [rad/s].
        torque: Mean torque over the interval that ends at the stamp [N·m]; NaN where unknown.
        source: What the message says of its publisher.
        info: Message info of the middleware.
    """

    stamp: int
    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray
    source: bytes
    info: dict[str, int]


class StateInput:
    """What a node hears on ``joint_states``.

    Attributes:
        heard: Whose states are believed.
        sent_at: When the sample that :meth:`too_old` was last asked about was sent, monotonic
            [s]; when it was asked where that is not known, and in lockstep.
    """

    def __init__(self, node: DataNode, joints: Sequence[str],
                 timeout: Callable[[], float]) -> None:
        """Take the joints, and what returns the silence after which another source may follow."""
        self.heard = HeardTopic(node, JOINT_STATES, SourceGate('joint state'), timeout,
                                others_belong=True)
        self._node = node
        self._reader = UsualJointStateReader(joints)
        self._timeout = timeout
        self._ages, self.sent_at = MessageAge(), 0.0
        self._taken_at, self._taken_ns = math.inf, 0  # the last sample: monotonic [s], its stamp

    def read(self, data: bytes, info: dict[str, int]) -> JointSample | Refusal:
        """Decode a message, or return why it is not one of this arm."""
        try:
            stamp, q, qd, torque = self._reader.read(data)
        except BagError as error:
            return Refusal(UNUSABLE, str(error))
        if stamp >= STAMP_LIMIT:
            return Refusal(UNUSABLE, f'stamp {stamp} ns does not fit its field')
        return JointSample(stamp, q, qd, torque, self._reader.source, info)

    def refuse(self, sample: JointSample) -> Refusal | None:
        """Return why a sample is not believed, None where it is; in lockstep all are."""
        return None if self._node.lockstep else self.heard.refuse(sample.source, sample.info)

    def too_old(self, sample: JointSample) -> Refusal | None:
        """Refuse a sample that has waited to be taken, or to be sent.

        This process may have been stopped, or the driver between the stamp and the sending, which
        gives it a new date. Then no sample came for a while, and its stamp is not later by that.
        """
        sent = sample.info.get('source_timestamp')
        # In this order: where the process is stopped between the two clocks, a sample counts as
        # older than it is, never as younger.
        now = time.monotonic()
        age = 0.0 if self._node.lockstep or not sent else self._ages.of(sent, time.time_ns())
        if not self._node.lockstep and sample.stamp > self._taken_ns:
            held_up = now - self._taken_at - (sample.stamp - self._taken_ns) * 1e-9
            age = max(age, held_up if held_up > self._timeout() else 0.0)
        self._taken_at, self._taken_ns = now, sample.stamp
        self.sent_at = now - age
        return None if age <= self._timeout() else Refusal('joint state too old', f'{age:.3g} s')
