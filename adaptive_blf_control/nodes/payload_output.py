# SPDX-License-Identifier: Apache-2.0
"""The load that an identifier node has found: published, logged, in the diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from rclpy.publisher import Publisher

from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.identification.payload import PayloadEstimate, PayloadEstimator
from adaptive_blf_control.messages.identifier_codecs import PayloadStream
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['PayloadOutput']


class PayloadOutput:
    """Publishes the load every ``payload.period``; does nothing without ``payload.frame``."""

    def __init__(self, node: DataNode[IdentifierNodeSettings], found: PayloadEstimator | None,
                 publishers: Mapping[str, Publisher]) -> None:
        """Take what finds the load; ``publishers`` are those of the node, by topic."""
        self._node, self._found, self._publishers = node, found, publishers
        self._frame = node.settings.payload.frame
        self._stream = PayloadStream(self._frame)
        self._changes = 0

    @property
    def estimate(self) -> PayloadEstimate | None:
        """What is known of the load; None where none is looked for, and before the first block."""
        return None if self._found is None else self._found.estimate

    def observe(self, stamp: int, t: float, identifier: Identifier) -> None:
        """Look at the identifier after a sample of stamp ``stamp`` [ns] and time ``t`` [s]."""
        found = self._found
        try:
            if found is None or not found.follow(t, identifier) or found.estimate is None:
                return
        except np.linalg.LinAlgError as error:  # what is only shown ends no motion
            self._node.faults.report('load not found', f'load not found: {error}')
            return
        for topic, message in self._stream.messages(stamp, found.estimate).items():
            self._publishers[topic].publish(message)
        if found.changes != self._changes:
            self._changes = found.changes
            self._node.get_logger().info(self._text(found.estimate))

    def status(self) -> dict[str, object]:
        """Return what the diagnostics say of the load."""
        if self._found is None:
            return {}
        estimate = self._found.estimate
        return {'payload': 'not known yet' if estimate is None else self._text(estimate),
                'changes of the payload': self._found.changes}

    def _text(self, estimate: PayloadEstimate) -> str:
        if estimate.undecided:
            return (f'not known yet: up to {estimate.most:.2g} kg at {self._frame} need not have '
                    'shown in this motion')
        if not estimate.attached:
            return f'no load above {estimate.most:.2g} kg at {self._frame}'
        return (f'{estimate.load.mass:.4g} kg, standard deviation {estimate.std.mass:.2g} kg, at '
                f'{self._frame}')
