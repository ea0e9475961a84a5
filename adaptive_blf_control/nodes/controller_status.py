# SPDX-License-Identifier: Apache-2.0
"""What the diagnostics say of a controller: what it waits for, what is wrong, the margins."""

from __future__ import annotations

from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus

from adaptive_blf_control.control.motion import Motion
from adaptive_blf_control.control.safety_filter import status_of
from adaptive_blf_control.nodes.command_topic import CommandTopic
from adaptive_blf_control.nodes.controller_monitors import ControllerMonitors
from adaptive_blf_control.nodes.estimate_input import EstimateInput
from adaptive_blf_control.nodes.gravity_watch import GravityWatch
from adaptive_blf_control.nodes.motion_inputs import MotionInputs
from adaptive_blf_control.nodes.state_input import StateInput
from adaptive_blf_control.runtime.status_report import Status

__all__ = ['ControllerStatus']


class ControllerStatus(NamedTuple):
    """The parts of a configured controller that are looked at; nothing here changes them."""

    motion: Motion
    states: StateInput
    estimates: EstimateInput
    commands: CommandTopic
    monitors: ControllerMonitors
    gravity: GravityWatch
    inputs: MotionInputs

    def awaited(self) -> str:
        """Return what a motion waits for."""
        return ('waiting for joint states and a listener' if self.estimates.ready else
                'waiting for the identifier: no estimate yet')

    def second_source(self) -> str:
        """Return which topic has a second publisher, '' where none has."""
        return (self.states.heard.second_source() or self.commands.others()
                or (self.estimates.heard.second_source() if self.estimates.wanted else '')
                or self.inputs.sets.second_source())

    def status(self, *, active: bool, wants_activation: bool, lockstep: bool) -> Status:
        """Return level, message and values: the margins of all constraints, V and saturation.

        Args:
            active: Whether the node is active.
            wants_activation: Whether it activates itself as soon as it can.
            lockstep: Whether the driver waits for it: then there are no second sources.
        """
        if not lockstep and (second := self.second_source()):
            return DiagnosticStatus.ERROR, second, {}
        if not active:
            return DiagnosticStatus.WARN, (
                self.awaited() if wants_activation else 'inactive'), {}
        motion = self.motion
        if motion.controller is None or motion.output is None:
            return DiagnosticStatus.WARN, self.awaited(), {}
        values = self.monitors.status(motion.output.saturated)
        values.update(status_of(motion.controller.safety_filter))
        if motion.lost:
            return DiagnosticStatus.ERROR, f'{motion.lost}: zero torque', values
        if self.gravity.found:
            return DiagnosticStatus.ERROR, self.gravity.found, values
        if self.monitors.violations:
            return DiagnosticStatus.ERROR, self.monitors.first_violation, values
        if self.estimates.wanted and not lockstep:
            return self.estimates.status(values)
        return DiagnosticStatus.OK, 'running', values
