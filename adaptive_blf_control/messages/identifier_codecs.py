# SPDX-License-Identifier: Apache-2.0
"""What the identifier publishes about each sample, for the node and for a simulated bag."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.republish import HistoryPublication
from adaptive_blf_control.messages.cdr import encode_float64, encode_int32
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.topics import (
    EXCITATION,
    HISTORY_RANK,
    HISTORY_SIGMA_MIN,
    THETA_HAT,
)

__all__ = ['EstimateStream']


class EstimateStream:
    """The estimate after every sample, the figures of the history where they have changed."""

    def __init__(self, parameters: Sequence[str]) -> None:
        """Prepare the messages for the names of the parameters."""
        self._theta = JointStateCodec(parameters, fields=('position',))
        self._history = HistoryPublication()

    def messages(self, stamp: int, theta: np.ndarray, identifier: Identifier) -> dict[str, bytes]:
        """Return the messages of a sample by topic; the estimate, which answers it, is the last.

        Args:
            stamp: Of the sample [ns].
            theta: θ̂ after the sample, shape (m,).
            identifier: After the sample.
        """
        messages: dict[str, bytes] = {}
        stack = identifier.stack
        if self._history.due(stack.insertions):
            messages[HISTORY_RANK] = encode_int32(stack.rank)
            messages[HISTORY_SIGMA_MIN] = encode_float64(stack.sigma_min)
            excitation = identifier.excitation
            if excitation is not None:
                messages[EXCITATION] = encode_float64(excitation)
        messages[THETA_HAT] = self._theta.encode(stamp, theta)
        return messages
