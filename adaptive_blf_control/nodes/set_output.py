# SPDX-License-Identifier: Apache-2.0
"""The set that surely holds θ*, as an identifier node knows it: published, in the diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.publisher import Publisher

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.limits.parameter_set import ParameterSet
from adaptive_blf_control.limits.prior import prior_of
from adaptive_blf_control.messages.identifier_codecs import ParameterSetCodec
from adaptive_blf_control.messages.topics import PARAMETER_SET
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['SetOutput']


class SetOutput:
    """Publishes the set every ``parameter_set.period``; does nothing where that is 0."""

    def __init__(self, node: DataNode[IdentifierNodeSettings], arm: Arm,
                 publishers: Mapping[str, Publisher]) -> None:
        """Make the set of the prior; ``publishers`` are those of the node, by topic.

        Raises:
            ParameterError: the prior cannot be one of this arm.
        """
        given = node.settings.parameter_set.resolved(joints=arm.n)
        self._node, self._publisher = node, publishers[PARAMETER_SET]
        self._period = given.period
        self._codec = ParameterSetCodec(arm.parameters)
        self._due, self._revision = 0.0, -1
        self.set: ParameterSet | None = None
        if self._period > 0.0:
            self.set = ParameterSet(
                prior_of(arm, mass_error=given.prior.mass_error, payload=given.prior.payload,
                         friction=given.prior.friction), given.prior.unexplained)

    def observe(self, stamp: int, t: float, identifier: Identifier) -> None:
        """Look at the pairs after a sample of stamp ``stamp`` [ns] and time ``t`` [s]."""
        known = self.set
        if known is None or t < self._due:
            return
        self._due = t + self._period
        stack = identifier.stack
        if stack.revision != self._revision:
            self._revision, count = stack.revision, stack.count
            if not known.update(stack.regressors[:count], stack.torques[:count]):
                self._node.faults.report(
                    'parameter set falsified',
                    'the recorded pairs contradict the prior of parameter_set, or its '
                    'unexplained torque: what is sure is the prior again, if that is right')
        self._publisher.publish(self._codec.encode(stamp, known.centre, known.half_widths(),
                                                   known.size, known.falsified))

    def status(self) -> dict[str, object]:
        """Return what the diagnostics say of the set."""
        if self.set is None:
            return {}
        return {'size of the parameter set': f'{self.set.size:.6g}',
                'parameter set falsified': self.set.falsified}
