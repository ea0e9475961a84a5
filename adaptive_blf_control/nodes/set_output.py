# SPDX-License-Identifier: Apache-2.0
"""The set that surely holds θ*, as an identifier node knows it: published, in the diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.publisher import Publisher

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.build_set_estimator import build_set_estimator
from adaptive_blf_control.configuration.node_settings import IdentifierNodeSettings
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.messages.identifier_codecs import ParameterSetCodec
from adaptive_blf_control.messages.topics import PARAMETER_SET
from adaptive_blf_control.nodes.handover import Handover
from adaptive_blf_control.runtime.data_node import DataNode

__all__ = ['SetOutput']


class SetOutput:
    """Publishes the set every ``parameter_set.period``; does nothing where that is 0.

    Attributes:
        estimator: Of the set; None where nobody asked for it.
    """

    def __init__(self, node: DataNode[IdentifierNodeSettings], arm: Arm,
                 publishers: Mapping[str, Publisher], handover: Handover | None) -> None:
        """Make the set of the prior.

        Args:
            node: The node, for its settings, its faults and its name.
            arm: The arm.
            publishers: Those of the node, by topic.
            handover: Takes the bounds to the controller of the same process, if it is there.

        Raises:
            ParameterError: the prior cannot be one of this arm.
        """
        self._node, self._publisher, self._handover = node, publishers[PARAMETER_SET], handover
        self.estimator = build_set_estimator(node.settings, arm)
        if self.estimator is not None:
            self._codec = ParameterSetCodec(arm.parameters, self.estimator.bounds().names,
                                            node.label)
        if handover is not None:
            handover.set_estimator = self.estimator

    def observe(self, stamp: int, t: float, identifier: Identifier) -> None:
        """Look at the pairs after a sample of stamp ``stamp`` [ns] and time ``t`` [s]."""
        known = self.estimator
        if known is None:
            return
        before = known.falsified
        if not known.observe(t, identifier):
            return
        if known.falsified > before:
            self._node.faults.report(
                'parameter set falsified',
                'the recorded pairs contradict the prior of parameter_set, or its unexplained '
                'torque: what is sure is the prior, if that is right, until the pairs are '
                'forgotten (~/reset_history)')
        bounds, ellipsoid = known.bounds(), known.ellipsoid
        if self._handover is not None:
            self._handover.bounds.append(bounds)
        self._publisher.publish(self._codec.encode(
            stamp, ellipsoid.centre, ellipsoid.half_widths(), ellipsoid.size, known.falsified,
            bounds.least, bounds.most))

    def status(self) -> dict[str, object]:
        """Return what the diagnostics say of the set."""
        if self.estimator is None:
            return {}
        return {'size of the parameter set': f'{self.estimator.ellipsoid.size:.6g}',
                'parameter set falsified': self.estimator.falsified}
