# SPDX-License-Identifier: Apache-2.0
"""``arm_control``: controller and identifier in one process, with their names and topics.

A joint state is received and decoded once. The command goes out first; then the identifier learns.
Estimate and adaptation term are handed over in memory (:mod:`adaptive_blf_control.nodes.handover`)
and published every ``composed_decimation`` samples. How the process runs (executor, priority,
processors) is what the controller's parameters say.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.context import Context
from sensor_msgs.msg import JointState

from adaptive_blf_control.control.refusal import Refusal
from adaptive_blf_control.messages.topics import JOINT_STATES
from adaptive_blf_control.nodes.controller import ControllerNode
from adaptive_blf_control.nodes.handover import Handover
from adaptive_blf_control.nodes.identifier import IdentifierNode
from adaptive_blf_control.nodes.state_input import JointSample
from adaptive_blf_control.runtime.rclpy_internals import Message
from adaptive_blf_control.runtime.stop_flag import StopFlag

__all__ = ['ArmControl']


class ArmControl:
    """Both nodes; the loop is that of the controller.

    Attributes:
        controller: Answers the newest state.
        identifier: Learns from every state, after the answer.
        stop: Set it to end :meth:`run`.
    """

    def __init__(self, *, context: Context | None = None, stop: StopFlag | None = None,
                 controller: dict[str, Any] | None = None,
                 identifier: dict[str, Any] | None = None) -> None:
        """Make both nodes, or none where one cannot be made.

        Args:
            context: Context of ROS, the default one where None.
            stop: What asks both to stop; a new one where None.
            controller: Options of the controller, as of ``rclpy.node.Node``.
            identifier: Those of the identifier.
        """
        self.stop = stop or StopFlag()
        self._handover = Handover()
        common: dict[str, Any] = {'context': context, 'stop': self.stop,
                                  'handover': self._handover}
        self.identifier = IdentifierNode(**common, **(identifier or {}))
        try:
            self.controller = ControllerNode(**common, **(controller or {}))
        except BaseException:
            self.identifier.destroy_node()
            raise
        self.controller.topics.subscribe_all(
            JointState, JOINT_STATES, self.on_messages, newest_only=True,
            reliable=self.controller.lockstep)

    @property
    def nodes(self) -> tuple[ControllerNode, IdentifierNode]:
        """Both nodes."""
        return self.controller, self.identifier

    def on_messages(self, messages: Sequence[Message]) -> None:
        """Let the controller answer the newest state, and keep all for the identifier."""
        samples: list[JointSample] = []
        answered = not self.controller.hears_states
        for message in reversed(messages):
            sample = self.identifier.states.read(*message)
            if isinstance(sample, Refusal):
                for node in self.nodes:
                    node.faults.refuse(sample)
                continue
            samples.append(sample)
            answered = answered or self.controller.on_state(sample)
        self._handover.states.extend(reversed(samples))

    def run(self) -> int:
        """Serve both until :attr:`stop` is set or the context ends; return the exit code."""
        self.identifier.begin(in_a_thread=True)
        try:
            code = self.controller.run()
        finally:
            self.identifier.end()
        return code or self.identifier.exit_code

    def destroy_node(self) -> None:
        """Leave the graph."""
        for node in self.nodes:
            node.destroy_node()
