# SPDX-License-Identifier: Apache-2.0
"""``controller``: joint states and θ̂ in, torques and the adaptation term out.

While it is inactive it listens to states and sends nothing. Activation is refused outside the
safety set, beside another publisher of commands, and without fresh joint states; the motion
begins with the next state, joined to the reference. Where θ̂ arrives late or never, the controller
goes on with the last one.
"""

from __future__ import annotations

from functools import partial
import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import State
import numpy as np
from rclpy.context import Context
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.answered import Answered
from adaptive_blf_control.control.arm_limits import limit_warnings
from adaptive_blf_control.control.control_output import ControlOutput
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.laws.protocol import uses_estimate
from adaptive_blf_control.control.motion import groups_of, Motion
from adaptive_blf_control.control.parts import controller_parts
from adaptive_blf_control.control.ramp import RAMP_STEP
from adaptive_blf_control.control.refusal import Refusal
from adaptive_blf_control.control.safety_filter import watched_by
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.messages.topics import JOINT_STATES, THETA_HAT
from adaptive_blf_control.nodes.command_topic import CommandTopic
from adaptive_blf_control.nodes.controller_monitors import ControllerMonitors
from adaptive_blf_control.nodes.controller_status import ControllerStatus
from adaptive_blf_control.nodes.estimate_input import EstimateInput, limit_of
from adaptive_blf_control.nodes.gravity_watch import GravityWatch
from adaptive_blf_control.nodes.handover import emptied, Handover
from adaptive_blf_control.nodes.motion_inputs import MotionInputs
from adaptive_blf_control.nodes.state_input import JointSample, StateInput
from adaptive_blf_control.parameters.table import broadcast
from adaptive_blf_control.runtime.channels import LONGEST_WAIT
from adaptive_blf_control.runtime.managed_node import ManagedNode
from adaptive_blf_control.runtime.robot_description import arm_of
from adaptive_blf_control.runtime.status_report import Status
from adaptive_blf_control.tuning.inertia import COUNT
from adaptive_blf_control.tuning.loop_check import check_loop, warnings_of_loop
from adaptive_blf_control.tuning.stated_loop import stated_delay

__all__ = ['ControllerNode']

GRAPH_PERIOD = 0.1  # s between looks at the publishers and subscriptions of commands
COUNT_LIVE = 25  # postures that a live change is checked in, between two samples
OF_THE_LOOP = {'k1', 'k2', 'barrier_weight', 'performance', 'reference'}  # its stability
OF_THE_GUARANTEE = {'k1', 'performance', 'reference'}  # groups of parameters that V depends on


class ControllerNode(ManagedNode[ControllerNodeSettings]):
    """A law, by default (38), behind the topics of ros2_controllers' effort group controller.

    Attributes:
        motion: The present motion, or the next one; from the configuration on.
        estimates: θ̂ in use; from the configuration on.
        monitors: What is published besides the torque; from the configuration on.
        gravity: Whether gravity as told fits the motion; from the configuration on.
        inputs: What it hears besides states and estimates; from the configuration on.
        heard_at: When the last usable state was sent, monotonic [s]; None before the first.
        commands: The command topic; from the configuration on.
        states: The joint states it believes; from the configuration on.
        handover: What it exchanges with the identifier in the same process; None where that is
            in a process of its own.
        hears_states: Whether it takes joint states: it is configured.
    """

    commands: CommandTopic
    gravity: GravityWatch
    inputs: MotionInputs
    motion: Motion
    estimates: EstimateInput
    monitors: ControllerMonitors
    states: StateInput

    def __init__(self, *, context: Context | None = None, handover: Handover | None = None,
                 **options: Any) -> None:
        """Make the node; ``autostart`` configures it, which checks all that needs no arm."""
        self.handover = handover
        self.hears_states = False
        self.heard_at: float | None = None
        self._looked_at = 0.0
        self._configured = False
        super().__init__('controller', ControllerNodeSettings, context=context, **options)

    @property
    def output(self) -> ControlOutput | None:
        """Last output of the law, None before the first."""
        return self.motion.output if self._configured else None

    @property
    def theta(self) -> np.ndarray:
        """θ̂ in use, shape (m,)."""
        return self.estimates.theta

    def configure(self) -> None:
        """Check the sets (9), compile the law, make the topics."""
        settings = self.settings
        self.arm = arm_of(self, self.settings)
        if self.handover is not None:
            self.handover.begin_for(self.arm)
        self.estimates = EstimateInput(self, self.arm)
        trial = Controller(self.arm, settings)
        trial.warm_up(self.theta)  # compile here, not in the first answer
        self._check_loop(settings, COUNT)
        for warning in limit_warnings(self.arm, settings):
            self.caution(warning)
        self.estimates.wanted = settings.model == 'estimated' and uses_estimate(trial.law)
        self.motion = Motion(self.arm, settings)
        self.gravity = GravityWatch(self.arm, self.faults)
        self.states = StateInput(self, self.arm.joints, lambda: self.settings.state_timeout)
        self.commands = CommandTopic(self, self.arm.n)
        self.heard_at = None
        self._looked_at = 0.0
        self._make_topics(trial)
        self._configured = True

    def _make_topics(self, controller: Controller) -> None:
        # States first: the driver takes the publishers for a sign that they are heard.
        self._inputs = [] if self.handover is not None else self._subscribe()
        self.monitors = ControllerMonitors(self, self.arm.joints, self.arm.parameters,
                                           controller.constraints.names,
                                           watched_by(controller.safety_filter),
                                           self.handover)
        self.inputs = MotionInputs(self, self.motion, self.handover)
        self.hears_states = True

    def _subscribe(self) -> list[Subscription]:
        """Listen to states and θ̂, which come in memory where there is a handover."""
        estimates = [self.topics.subscribe(
            JointState, THETA_HAT, self.estimates.receive, wake=self.lockstep,
            newest_only=not self.lockstep, reliable=self.lockstep)
        ] if self.estimates.wanted else []
        return [*estimates, self.topics.subscribe(
            JointState, JOINT_STATES, self.on_joint_states, newest_only=True,
            reliable=self.lockstep)]

    def cleanup(self) -> None:
        """Destroy the topics."""
        self.hears_states = False
        for subscription in self._inputs:
            self.topics.unsubscribe(subscription)
        self.inputs.close()
        self.monitors.close()

    def _check_loop(self, settings: ControllerNodeSettings, count: int) -> None:
        """Warn of gains that do not fit the loop, along ``count`` postures, or refuse them."""
        reference = controller_parts(settings, self.arm.joints).reference
        check = check_loop(self.arm, settings, reference, self.theta,
                           stated_delay(settings.loop), count=count)
        for warning in warnings_of_loop(check, settings.loop.unstable):
            self.caution(warning)

    def activate(self) -> None:
        """Check state and sets; claim the command topic.

        Raises:
            SetViolation: the arm is outside the safety set, with joint, value and bound.
            BlfError: no fresh joint states, or another node sends commands.
        """
        self._check_fresh()
        if not self.estimates.ready:
            raise BlfError(f'{self.resolve_topic_name(THETA_HAT)}: no estimate yet: the motion '
                           'waits for the identifier, unless wait_for_identifier is false')
        self.motion.check_start()
        self.commands.claim()
        self.motion.prepare()

    def _check_fresh(self) -> None:
        timeout = self.settings.state_timeout
        if self.heard_at is None or (not self.lockstep
                                     and time.monotonic() - self.heard_at > timeout):
            raise BlfError(f'{self.resolve_topic_name(JOINT_STATES)}: no joint state within '
                           f'{timeout:g} s: activation needs to know where the arm is')

    def deactivate(self) -> None:
        """Bring the torque to zero and release the command topic."""
        if not self.commands.claimed:
            return
        if self.output is not None:
            self.commands.ramp_down(self.motion.torque, self.settings.ramp_time,
                                    self._rate_limit())
        self.commands.release()
        self.motion.end()

    def _rate_limit(self) -> np.ndarray:
        return broadcast(self.settings.torque_rate_limit, self.arm.n)

    def retune(self, settings: ControllerNodeSettings, changed: set[str]) -> None:
        """Change gains, limits, sets and reference between two samples, or refuse with numbers."""
        if not self._configured:
            return
        limit = limit_of(settings, self.arm)
        if groups_of(changed) & OF_THE_LOOP:
            self._check_loop(settings, COUNT_LIVE)
        self.motion.retune(settings, changed)
        self.estimates.gate.limit = limit
        if self.motion.controller is not None and groups_of(changed) & OF_THE_GUARANTEE:
            self.monitors.begin()  # V(0) of Theorem 2 belonged to the settings before

    def on_joint_states(self, data: bytes, info: dict[str, int]) -> bool:
        """Answer a joint state as a message; see :meth:`on_state`."""
        self._watch_silence()
        sample = self.states.read(data, info)
        if isinstance(sample, Refusal):
            self.faults.refuse(sample)
            return False
        return self.on_state(sample)

    def on_state(self, sample: JointSample) -> bool:
        """Answer a joint state with a torque; False if it is of another source.

        The newest state decides: where it cannot be answered, none is.
        """
        self._watch_silence()
        if (second := self.states.refuse(sample)) is not None:
            self.faults.refuse(second)
            return False
        if self.handover is not None and self.estimates.wanted:
            for estimate in emptied(self.handover.estimates):
                self.estimates.take(*estimate)
        self.inputs.sets.take_over()
        stamp, q, qd, torque, _, info = sample
        refusal = self.states.too_old(sample) or self.motion.refuse(
            stamp, q, qd, self.settings.state_timeout)
        if refusal is not None:
            self.faults.refuse(refusal)
            return True  # it is the newest of its source: an older one is not answered instead
        if not self._ready(stamp, q, qd):
            self.topics.later(partial(self.on_state, sample))
            return True
        if self.motion.begins_quickly and self.commands.unheard():
            self.faults.report('unheard', 'a listener does not confirm the torques: '
                               'the motion begins again')
            self.motion.start_over()
        begins = self.motion.controller is None
        controller = self.motion.controller or self._begin(stamp, q, qd)
        self.heard_at = self.states.sent_at
        self.aged(info)
        answered = self._answer(stamp, q, qd, torque, controller, self._elapsed(info))
        # After the answer, because a log line takes longer than the law.
        if begins and not self.motion.lost:
            self.get_logger().info('motion begins')
            if self.active:
                self.monitors.state_guarantee(controller, stamp, answered)
        return True

    def _begin(self, stamp: int, q: np.ndarray, qd: np.ndarray) -> Controller:
        controller = self.motion.begin(stamp, q, qd)
        self.statistics.break_off()
        self.monitors.begin()
        self.gravity.begin(stamp)
        return controller

    def _ready(self, stamp: int, q: np.ndarray, qd: np.ndarray) -> bool:
        """Whether this state is to be answered now: the node is active and an arm listens."""
        if self.lockstep and self.estimates.misses(self.motion.gate.last_ns):
            return False
        if not self.active:
            self.motion.rest(q, qd)
            self.heard_at = self.states.sent_at
            if not (self.wants_activation and self.estimates.ready
                    and self.commands.someone_drives()
                    and self.activate_by_itself()):
                return False
        if self.motion.lost:
            self.motion.end()
        return self.motion.controller is not None or self.commands.heard

    def _elapsed(self, info: dict[str, int]) -> float | None:
        """Return the real time between the last torque and this one [s]; None in lockstep."""
        received = not self.lockstep and 'source_timestamp' in info
        return self.commands.interval() if received else None

    def _answer(self, stamp: int, q: np.ndarray, qd: np.ndarray, torque: np.ndarray,
                controller: Controller, elapsed: float | None) -> Answered:
        answered = self.motion.answer(stamp, q, qd, self.theta, torque, elapsed)
        self._watch_silence()
        if self.motion.lost:  # the process was stopped while it computed
            return answered
        if not self.commands.send(answered.torque, stamp, self._deadline()):
            self.motion.lose('joint states lost')
            self.faults.drop('joint state too old', 'while its answer was computed')
            return answered
        self.monitors.publish_term(stamp, answered)
        inside = self.monitors.watch(controller, stamp, answered, self.theta)
        self.sampled(stamp)
        told = self.gravity.fits(stamp, q, qd, torque)
        if not (inside and told) and self.settings.on_violation == 'stop':
            self.deactivate_by_itself()
        return answered

    def spin_data(self, timeout: float = LONGEST_WAIT) -> int:
        """Wait until the states count as lost at the latest; see :meth:`DataNode.spin_data`."""
        if self._configured and self.commands.pushes:
            timeout = min(timeout, max(self._deadline() - time.monotonic(), RAMP_STEP))
        handled = super().spin_data(timeout)
        if self.handover is not None:  # the command is out
            self.handover.learn()
        return handled

    def idle(self) -> None:
        """Watch the states and the command topic; in lockstep the driver does."""
        if self.lockstep or not self.active:
            return
        now = time.monotonic()
        if now - self._looked_at >= GRAPH_PERIOD:
            self.look_around(now)
        self._watch_silence()

    def _deadline(self) -> float:
        """Return the monotonic time until which the newest usable state may be answered [s]."""
        if self.lockstep or self.heard_at is None:
            return math.inf
        return self.heard_at + self.settings.state_timeout

    def _watch_silence(self) -> None:
        """Zero torque where no state came in time; before a state is taken, too.

        After a pause of this process a state is there at once, and the arm was left to itself.
        """
        if (self._configured and self.commands.pushes and self.active
                and time.monotonic() > self._deadline()):
            timeout = self.settings.state_timeout
            self._stop_motion('joint states lost',
                              f'no joint state for {timeout:g} s: zero torque',
                              orderly=self.count_publishers(JOINT_STATES) == 0)

    def look_around(self, now: float) -> None:
        """Stop if no arm listens; give way to another controller that sends commands.

        Args:
            now: Monotonic time [s].
        """
        self._looked_at = now
        if self.commands.pushes and not self.commands.someone_drives():
            self._stop_motion('nobody listens', 'nobody listens to the commands: zero torque')
        if self.commands.has_to_give_way(now):
            self.faults.report('two controllers',
                               'another controller sends commands, too: this one gives way')
            self.deactivate_by_itself()

    def _stop_motion(self, reason: str, text: str, *, orderly: bool = False) -> None:
        """Send zero torque; the next state begins a new motion."""
        self.motion.lose(reason)
        self.commands.send_zero()
        self.faults.report(reason, text, orderly=orderly)

    def finish(self) -> None:
        """Bring the torque to zero as fast as its rate may change; zero is the last command.

        Nothing is sent where none was sent before: the brakes are on.
        """
        if self._configured and self.commands.pushes:
            self.commands.ramp_down(self.motion.torque, 0.0, self._rate_limit())

    def status(self) -> Status:
        """Report the margins of all constraints, V and saturation."""
        if self.state_id == State.PRIMARY_STATE_UNCONFIGURED:
            return DiagnosticStatus.WARN, 'unconfigured', {}
        return ControllerStatus(
            self.motion, self.states, self.estimates, self.commands, self.monitors, self.gravity,
            self.inputs).status(active=self.active, wants_activation=self.wants_activation,
                 lockstep=self.lockstep)
