# SPDX-License-Identifier: Apache-2.0
"""The controller's messages about itself: adaptation term, reference, errors, margins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptive_blf_control.bags.joint_state import JointStateCodec
from adaptive_blf_control.control.controller import ControlOutput
from adaptive_blf_control.control.guarantee import Guarantee
from adaptive_blf_control.topics import ADAPTATION_TERM, BARRIER, REFERENCE, TRACKING_ERROR

__all__ = ['ControllerCodecs', 'barrier_names', 'guarantee_names']


def barrier_names(joints: Sequence[str]) -> list[str]:
    """Return the names on ``controller/barrier``: margins to both sets per joint, then V."""
    return [f'{joint}.{what}' for what in ('safety_margin', 'performance_margin')
            for joint in joints] + ['V']


def guarantee_names(joints: Sequence[str]) -> list[str]:
    """Return the names on ``controller/guarantee``: (39), (41) per joint, V(0), (40)."""
    return [f'{joint}.{what}' for what in ('error_lower', 'error_upper', 'output_lower',
                                           'output_upper')
            for joint in joints] + ['V0', 'e2_norm']


class ControllerCodecs:
    """Encodes what the controller publishes beside the torque, for the node and for a bag."""

    def __init__(self, joints: Sequence[str], parameters: Sequence[str]) -> None:
        """Prepare the templates for these joint and parameter names."""
        self._term = JointStateCodec(parameters, fields=('position',))
        # y_d, its velocity, and its acceleration [rad/s²] in the third array, effort.
        self._reference = JointStateCodec(joints)
        self._error = JointStateCodec(joints, fields=('position', 'velocity'))
        self._barrier = JointStateCodec(barrier_names(joints), fields=('position',))
        self._guarantee = JointStateCodec(guarantee_names(joints), fields=('position',))

    def guarantee(self, stamp: int, promised: Guarantee) -> bytes:
        """Encode what Theorem 2 promises; ``stamp`` in ns."""
        return self._guarantee.encode(stamp, np.concatenate([
            promised.error_lower, promised.error_upper, promised.output_lower,
            promised.output_upper, [promised.value, promised.e2_norm]]))

    def adaptation_term(self, stamp: int, output: ControlOutput) -> bytes:
        """Encode Xᵀe2 of (37) by parameter name; ``stamp`` in ns."""
        return self._term.encode(stamp, output.adaptation_term)

    def monitors(self, stamp: int, output: ControlOutput, margins: np.ndarray,
                 lyapunov: float) -> dict[str, bytes]:
        """Encode reference, e1 with e2, and margins (2n,) [rad] with V; by topic."""
        return {
            REFERENCE: self._reference.encode(stamp, *output.reference),
            TRACKING_ERROR: self._error.encode(stamp, output.e1, output.e2),
            BARRIER: self._barrier.encode(stamp, np.append(margins, lyapunov)),
        }

    def encode(self, stamp: int, output: ControlOutput, margins: np.ndarray,
               lyapunov: float) -> dict[str, bytes]:
        """Encode everything; by topic."""
        return {ADAPTATION_TERM: self.adaptation_term(stamp, output),
                **self.monitors(stamp, output, margins, lyapunov)}
