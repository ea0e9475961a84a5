# SPDX-License-Identifier: Apache-2.0
"""The controller's side of ``identifier/parameter_set``: what the identifier is sure of."""

from __future__ import annotations

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.build_set_estimator import check_learns
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.motion import Motion
from adaptive_blf_control.control.source_gate import SourceGate
from adaptive_blf_control.errors import BagError, ParameterError
from adaptive_blf_control.limits.cause_intervals import CauseBounds
from adaptive_blf_control.limits.prior import stated_prior
from adaptive_blf_control.messages.identifier_codecs import BoundsReader
from adaptive_blf_control.messages.topics import PARAMETER_SET
from adaptive_blf_control.nodes.handover import emptied, Handover
from adaptive_blf_control.runtime.data_node import DataNode
from adaptive_blf_control.runtime.heard_topic import HeardTopic

__all__ = ['SetInput']


class SetInput:
    """Brings the bounds of the identifier to the safety filter of a motion.

    Attributes:
        wanted: Whether the filter learns: ``limits.learn``.
        heard: Whose bounds are believed.
    """

    def __init__(self, node: DataNode[ControllerNodeSettings], arm: Arm, motion: Motion,
                 handover: Handover | None) -> None:
        """Take the motion, and see whether its filter is to learn.

        Raises:
            ParameterError: it is, but nothing would come that it could learn from.
        """
        settings = node.settings
        self._node, self._motion, self._handover = node, motion, handover
        self.wanted = settings.safety_filter != 'none' and settings.limits.learn
        if handover is not None:
            check_learns(settings, handover.set_estimator)
        elif self.wanted and node.lockstep:
            raise ParameterError(
                'controller.limits.learn', True, 'false in lockstep, unless controller and '
                'identifier are one process (arm_control): nobody waits for identifier/parameter_'
                'set, so that no run would be like another')
        causes = stated_prior(arm, settings.limits.prior.resolved(joints=arm.n)
                              ).causes if self.wanted else ()
        self._reader = BoundsReader([cause.name for cause in causes])
        self.heard = HeardTopic(node, PARAMETER_SET, SourceGate('parameter set'),
                                lambda: node.settings.limits.learn_timeout)

    def receive(self, data: bytes, info: dict[str, int]) -> bool:
        """Take the bounds of a message; one that cannot be used is dropped."""
        faults = self._node.faults
        try:
            bounds = self._reader.read(data)
        except BagError as error:
            faults.drop('unusable parameter set', f'{error}; controller.limits.prior and '
                        'identifier.parameter_set.prior have to have the same causes')
            return False
        second = self.heard.refuse(self._reader.source, info)
        if second is not None:
            faults.refuse(second)
            return False
        return self._narrow(bounds)

    def take_over(self) -> None:
        """Take the bounds that the identifier of this process has left, if any."""
        if self._handover is not None and self.wanted:
            for bounds in emptied(self._handover.bounds):
                self._narrow(bounds)

    def _narrow(self, bounds: CauseBounds) -> bool:
        try:
            self._motion.narrow(bounds)
        except ParameterError as error:
            self._node.faults.report('parameter set falsified', f'{error}: the filter goes on '
                                     'with its prior')
            return False
        return True

    def second_source(self) -> str:
        """Return which nodes publish where one is to be heard; '' where there is no second one."""
        return self.heard.second_source() if self.wanted else ''
