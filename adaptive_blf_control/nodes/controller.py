# SPDX-License-Identifier: Apache-2.0
"""``controller``: joint states and θ̂ in, torques and the adaptation term out.

Lifecycle: inactive, states are heard and nothing is sent; activation is refused outside the
safety set, beside another publisher of commands, and without fresh joint states; the motion then
begins with the next state, joined to the reference. θ̂ may arrive late or never: the controller
goes on with the last one.
"""

from __future__ import annotations

from collections import deque
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import State
import numpy as np
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.build import (
    build_controller,
    initial_theta,
)
from adaptive_blf_control.configuration.node_settings import ControllerNodeSettings
from adaptive_blf_control.control.controller import (
    Controller,
    ControlOutput,
    sampling_model,
    sampling_number,
)
from adaptive_blf_control.control.parts import controller_parts
from adaptive_blf_control.control.reference import Posture, settled, SmoothStart
from adaptive_blf_control.errors import BagError, BlfError, SetViolation
from adaptive_blf_control.messages.cdr import Float64MultiArrayCodec
from adaptive_blf_control.messages.joint_state import JointStateReader
from adaptive_blf_control.messages.topics import (
    ADAPTATION_TERM,
    COMMANDS,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    THETA_HAT,
)
from adaptive_blf_control.nodes.controller_monitors import ControllerMonitors
from adaptive_blf_control.nodes.joint_trajectory import reference_through
from adaptive_blf_control.parameters.table import broadcast
from adaptive_blf_control.runtime.data_node import LONGEST_WAIT, TOO_LATE
from adaptive_blf_control.runtime.managed_node import ManagedNode
from adaptive_blf_control.runtime.process import run_node
from adaptive_blf_control.runtime.robot_description import arm_of

__all__ = ['ControllerNode', 'main']

HEAD_START = 0.1  # s from a trajectory's arrival to its beginning
LOOK_AROUND = 0.1  # s between looks at who hears and who sends commands
# Discovery may show another sender of commands only a while after this one has begun.
GIVE_WAY = 3.0  # s
RAMP_STEP = 1e-3  # s between the torques of a ramp
LONGEST_RAMP = 5.0  # s that the rate limit may stretch it to: a stop is a stop
OLD_ESTIMATE = 1.0  # s
LINGER = Duration(seconds=0.1)  # sent is not delivered yet


class ControllerNode(ManagedNode[ControllerNodeSettings]):
    """Equation (38) behind the topics of ros2_controllers' effort group controller.

    Attributes:
        theta: θ̂ in use, shape (m,).
        output: Last output of the law, None before the first.
        monitors: What is shown besides the torque.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        """Make the node; with ``autostart`` validated as far as can be before the arm is seen."""
        self.output: ControlOutput | None = None
        self._controller: Controller | None = None
        self._commands: Publisher | None = None
        self._start_ns = 0
        self._last_ns: int | None = None
        self._pushes = False  # the torque sent last was not the zero one
        super().__init__('controller', ControllerNodeSettings, context=context, **options)

    def configure(self) -> None:
        """Check the sets (9), compile the law, make the topics."""
        settings = self.settings
        self.arm = arm_of(self, self.settings)
        self.theta = initial_theta(settings, self.arm)
        trial = build_controller(settings, self.arm, None)
        trial.warm_up(self.theta)  # compiled here, not in the first answer
        self._margin_names = trial.constraints.names
        self._check_sampling(trial)
        self._state_reader = JointStateReader(self.arm.joints)
        self._theta_reader = JointStateReader(self.arm.parameters)
        self._torque_codec = Float64MultiArrayCodec(self.arm.n)
        self._controller = None
        self._start_ns = 0
        self._last_ns = None
        self._q = np.zeros(self.arm.n)
        self._jumped_ns: int | None = None
        self._heard_at: float | None = None
        self._estimated_at: float | None = None
        self._lost = ''  # why the torque is zero until the next state
        self._resumes = False
        self._planned = False
        self._claimed_at = self._looked_at = 0.0
        self._estimates: deque[tuple[int, np.ndarray | None]] = deque(maxlen=4)
        self._estimate_limit = _estimate_limit(settings, self.arm)
        self._make_topics()

    def _make_topics(self) -> None:
        self.monitors = ControllerMonitors(self, self.arm.joints, self.arm.parameters,
                                           self._margin_names)
        self._term = self.data_publisher(JointState, ADAPTATION_TERM)
        self._trajectories = self.create_subscription(
            JointTrajectory, JOINT_TRAJECTORY, self.on_joint_trajectory, 10)
        self._inputs = []
        if self.settings.model == 'estimated':
            self._inputs.append(self.data_subscription(
                JointState, THETA_HAT, self.on_theta_hat, wake=self.lockstep,
                newest_only=not self.lockstep, reliable=self.lockstep))
        self._inputs.append(self.data_subscription(
            JointState, JOINT_STATES, self.on_joint_states, newest_only=True,
            reliable=self.lockstep))

    def cleanup(self) -> None:
        """Take the topics down."""
        for subscription in self._inputs:
            self.end_data_subscription(subscription)
        self.destroy_subscription(self._trajectories)
        self.end_data_publisher(self._term)
        self.monitors.close()

    def _check_sampling(self, controller: Controller) -> None:
        start, k2 = controller.reference.at(0.0).position, controller.settings.k2
        number = sampling_number(self.arm, k2, start, self.theta, 1e-3)
        if number >= 2.0:
            model = sampling_model(self.arm, start, self.theta)
            self.get_logger().warning(
                f'k2 λ_max(M⁻¹) dt = {number:.2f} at 1 kHz with the {model} parameters: 2 or '
                f'more is unstable in a sampled loop; lower k2 or check the model')

    def activate(self) -> None:
        """Check state and sets; claim the command topic.

        Raises:
            SetViolation: the arm is outside the safety set, with joint, value and bound.
            BlfError: no fresh joint states, or somebody else sends commands.
        """
        self._check_fresh()
        self._joined(self._q)
        others = [f'{info.node_namespace.rstrip("/")}/{info.node_name}'
                  for info in self.get_publishers_info_by_topic(COMMANDS)]
        if others:
            raise BlfError(f'{self.resolve_topic_name(COMMANDS)}: {", ".join(others)} sends '
                           f'commands already: one controller at a time')
        self._commands = self.data_publisher(Float64MultiArray, COMMANDS)
        self._controller, self._planned = None, False
        self._claimed_at = time.monotonic()

    def _check_fresh(self) -> None:
        timeout = self.settings.state_timeout
        if self._heard_at is None or (not self.lockstep
                                      and time.monotonic() - self._heard_at > timeout):
            raise BlfError(f'{self.resolve_topic_name(JOINT_STATES)}: no joint state within '
                           f'{timeout:g} s: activation needs to know where the arm is')

    def deactivate(self) -> None:
        """Bring the torque down to zero and give the command topic back."""
        commands, last = self._commands, self.output
        if commands is None:
            return
        if last is not None and self._pushes:
            steps = 0 if self.lockstep else int(self._ramp_time(last.torque) / RAMP_STEP)
            for left in range(steps - 1, 0, -1):
                commands.publish(self._torque_codec.encode(last.torque * (left / steps)))
                time.sleep(RAMP_STEP)
            self._send_zero()
            commands.wait_for_all_acked(LINGER)
        self.end_data_publisher(commands)
        self._commands, self._controller, self._resumes = None, None, True

    def _ramp_time(self, torque: np.ndarray) -> float:
        limit = broadcast(self.settings.torque_rate_limit, self.arm.n)
        ramp_time = self.settings.ramp_time
        return max(ramp_time, min(float((np.abs(torque) / limit).max()), LONGEST_RAMP))

    def _send_zero(self) -> None:
        if self._commands is not None and self.context.ok():
            self._commands.publish(self._torque_codec.encode(np.zeros(self.arm.n)))
            self._pushes = False

    def retune(self, settings: ControllerNodeSettings, changed: set[str]) -> None:
        """Change gains, limits, sets and reference between two samples, or refuse with numbers."""
        controller, last_ns = self._controller, self._last_ns
        limit = _estimate_limit(settings, self.arm) if hasattr(self, 'arm') else None
        if controller is None or last_ns is None:
            trial = None if limit is None else build_controller(settings, self.arm, None)
        else:
            trial = controller
            parts = controller_parts(settings, self.arm.joints)
            groups = {name.split('.')[0] for name in changed
                      if name not in ('reference.smooth_start', 'reference.resume_time')}
            controller.retune(
                (last_ns - self._start_ns) * 1e-9, self._q, settings=parts.settings,
                safety=parts.safety if 'safety' in groups else None,
                performance=parts.performance if 'performance' in groups else None,
                reference=parts.reference if 'reference' in groups else None,
                blend_time=settings.reference.resume_time)
            if groups & {'k1', 'performance', 'reference'}:
                self.monitors.begin()  # V(0) of Theorem 2 was that of another motion
            self._planned = self._planned and 'reference' not in groups
        if trial is not None and limit is not None:
            self._estimate_limit = limit
            if 'k2' in changed:
                self._check_sampling(trial)

    def on_theta_hat(self, data: bytes, info: dict[str, int]) -> bool:
        """Take the newest estimate; one that is not finite, absurd or not ours is dropped."""
        try:
            stamp, theta, _, _ = self._theta_reader.read(data)
        except BagError as error:
            self.drop('unusable estimate', str(error))
            return False
        usable = self._believes(theta)
        if self.lockstep:  # it may be that of the state which still waits for the one before
            self._estimates.append((stamp, theta if usable else None))
        elif usable:
            self.theta, self._estimated_at = theta, time.monotonic()
        return usable

    def _believes(self, theta: np.ndarray) -> bool:
        if not np.isfinite(theta).all():
            self.drop('non-finite estimate', 'the last one is kept')
            return False
        limit = self._estimate_limit
        if (np.abs(theta) > limit).any():
            i = int(np.argmax(np.abs(theta) / limit))
            text = (f'{self.arm.parameters[i]} = {theta[i]:.4g} is beyond estimate_limit '
                    f'{limit[i]:g}: the last estimate is kept')
            self.last_fault = text
            self.drop('absurd estimate', text)
            return False
        return True

    def on_joint_trajectory(self, message: JointTrajectory) -> None:
        """Follow the points instead of the reference so far; one that cannot be is dropped whole.

        The way is computed beside the loop, for a moment that is still to come: the longer that
        took, the later the moment of the next attempt.
        """
        head_start, done = HEAD_START, False
        while not done and self.up:
            done = self._follow(message, head_start)
            head_start *= 4.0

    def _follow(self, message: JointTrajectory, head_start: float) -> bool:
        """Try to follow the points from ``head_start`` [s] on; False where that has passed."""
        with self.between_samples:
            controller, last_ns, start_ns = self._controller, self._last_ns, self._start_ns
            if controller is None or last_ns is None or self._lost:
                self.drop('trajectory before the motion has begun', 'send it again then')
                return True
            known = controller.reference, controller.safety, controller.performance
        t = (last_ns - start_ns) * 1e-9 + head_start
        try:
            reference = reference_through(message, controller, t)
        except BlfError as error:
            self.drop('unusable trajectory', str(error))
            return True
        with self.between_samples:
            present = controller.reference, controller.safety, controller.performance
            if (self._controller is not controller or self._lost or self._last_ns is None
                    or any(now is not before for now, before in zip(present, known))):
                self.drop('unusable trajectory', 'the motion has changed meanwhile: send it again')
                return True
            now = (self._last_ns - start_ns) * 1e-9
            if now < t:
                controller.reference, self._planned = settled(reference, now), True
            return now < t

    def on_joint_states(self, data: bytes, info: dict[str, int]) -> bool:
        """Answer a joint state with a torque; False where it cannot be used."""
        try:
            stamp, q, qd, _ = self._state_reader.read(data)
        except BagError as error:
            self.drop('unusable joint state', str(error))
            return False
        if not (np.isfinite(q).all() and np.isfinite(qd).all()):
            i = int(np.argmin(np.isfinite(q) & np.isfinite(qd)))
            self.drop('non-finite joint state',
                      f'joint {self.arm.joints[i]!r}: {q[i]:g} rad, {qd[i]:g} rad/s')
            return False
        if not self._in_order(stamp):
            return False
        if self.lockstep and self._must_wait():
            self.later(self.on_joint_states, data, info)
            return True
        if not self.active:
            self._q, self._heard_at = q, time.monotonic()
            if not (self.wants_activation and self._someone_drives()
                    and self.activate_by_itself()):
                self.later(self.on_joint_states, data, info)
                return True
        if self._lost:
            self._controller, self._resumes = None, True
        begins = self._controller is None
        if begins and not self._start(stamp, q):
            self.later(self.on_joint_states, data, info)
            return True
        self._last_ns, self._q = stamp, q
        self._heard_at, self._lost = time.monotonic(), ''
        self.aged(info)
        self._answer(stamp, q, qd)
        if begins:  # after the answer: writing a log line takes longer than the law
            self.get_logger().info('motion begins')
            if self._controller is not None and self.output is not None:
                self.monitors.state_guarantee(self._controller, stamp, self.output)
        return True

    def _in_order(self, stamp: int) -> bool:
        """Whether time goes on; a stamp far ahead counts once a second message confirms it.

        One wild stamp would otherwise throw the reference ahead and make every later state old.
        Once the states count as lost, whatever comes next begins a new motion on its own clock.
        """
        if stamp >= TOO_LATE:
            self.drop('unusable joint state', f'stamp {stamp} ns does not fit its field')
            return False
        if self._lost and stamp == self._last_ns:
            self.drop('joint state out of order', f'stamp {stamp} ns again')
            return False
        if self._last_ns is None or self._lost or self._controller is None:
            return True
        ahead = stamp - self._last_ns
        if ahead <= 0:
            self.drop('joint state out of order', f'stamp {stamp} ns after {self._last_ns} ns')
            return False
        jumped, longest = self._jumped_ns, self.settings.state_timeout * 1e9
        if ahead > longest and (jumped is None or not 0 < stamp - jumped <= longest):
            self._jumped_ns = stamp
            self.drop('stamp jumps ahead', f'{ahead * 1e-9:.6g} s after the last one')
            return False
        if ahead > longest:  # the clock stays ahead: the motion begins anew on it
            self._controller, self._resumes = None, True
        self._jumped_ns = None
        return True

    def _must_wait(self) -> bool:
        """In lockstep a state is answered with the estimate that belongs to the one before it."""
        if self._last_ns is None or self.settings.model != 'estimated':
            return False
        for stamp, theta in self._estimates:
            if stamp == self._last_ns:
                self.theta = self.theta if theta is None else theta
                return False
        return self.count_publishers(THETA_HAT) > 0

    def _joined(self, q: np.ndarray) -> Controller:
        """Return the controller of a motion that begins in ``q``, joined to the reference.

        With ``reference.smooth_start`` 0 it begins on the reference itself, as the paper's, where
        ``q`` is within the performance set around that; SetViolation outside the safety set.
        """
        settings = self.settings
        if not self._resumes:  # else the reference has moved on meanwhile, and so may the arm
            try:
                return build_controller(settings, self.arm, q)
            except SetViolation:
                if settings.reference.smooth_start > 0.0:
                    raise
        settings = settings.replace(**{'reference.smooth_start': max(
            settings.reference.smooth_start, settings.reference.resume_time)})
        return build_controller(settings, self.arm, q)

    def _start(self, stamp: int, q: np.ndarray) -> bool:
        commands = self._commands
        if commands is None or not (commands.get_subscription_count() and self._someone_drives()):
            return False
        self._controller = self._new_motion(q)
        self._start_ns = stamp
        self.statistics.break_off()
        self.monitors.begin()
        return True

    def _new_motion(self, q: np.ndarray) -> Controller:
        """Return the controller of a motion that begins in ``q``.

        Where points were being followed, ``q`` is held until the planner speaks again: nobody
        asked for the way back to the reference of the parameters.
        """
        if not self._planned:
            return self._joined(q)
        parts = controller_parts(self.settings, self.arm.joints)
        hold = SmoothStart(Posture(q), self.settings.reference.resume_time, q)
        controller = Controller(self.arm, *parts._replace(reference=hold))
        controller.check_start(q)
        return controller

    def _someone_drives(self) -> bool:
        """Whether an arm listens to the commands; a recorder of ours does not move one."""
        return any(info.node_name != 'recorder'
                   for info in self.get_subscriptions_info_by_topic(COMMANDS))

    def _answer(self, stamp: int, q: np.ndarray, qd: np.ndarray) -> None:
        controller, commands = self._controller, self._commands
        if controller is None or commands is None:
            return
        t = (stamp - self._start_ns) * 1e-9
        output = controller.update(t, q, qd, self.theta)
        self._pushes = True
        commands.publish(self._torque_codec.encode(output.torque))
        self._term.publish(self.monitors.codecs.adaptation_term(stamp, output))
        self.output = output
        inside = self.monitors.watch(controller, stamp, output, self.theta)
        self.sampled(stamp)
        if not inside and self.settings.on_violation == 'stop':
            self.deactivate_by_itself()

    def spin_data(self, timeout: float = LONGEST_WAIT) -> int:
        """Wait no longer than until the states count as lost; see :meth:`DataNode.spin_data`."""
        if self._pushes and not self.lockstep and self._heard_at is not None:
            left = self._heard_at + self.settings.state_timeout - time.monotonic()
            timeout = min(timeout, max(left, RAMP_STEP))
        return super().spin_data(timeout)

    def idle(self) -> None:
        """Watch the states and who hears the commands; in lockstep the driver does."""
        if self.lockstep:
            return
        now = time.monotonic()
        if self.active and now - self._looked_at >= LOOK_AROUND:
            self._looked_at = now
            self._look_around(now)
        timeout = self.settings.state_timeout
        if (self.active and self._pushes and self._heard_at is not None
                and now - self._heard_at > timeout):
            self._stop_motion('joint states lost',
                              f'no joint state for {timeout:g} s: zero torque')

    def _look_around(self, now: float) -> None:
        """Stop where nobody hears the commands; give way to another who sends them, too."""
        commands = self._commands
        if commands is None:
            return
        if self._pushes and not self._someone_drives():
            self._stop_motion('nobody listens', 'nobody listens to the commands: zero torque')
        # Only to one of ours, which looks before it begins: not to whoever shouts.
        if (now - self._claimed_at < GIVE_WAY and self.count_publishers(COMMANDS) > 1
                and self.count_publishers(ADAPTATION_TERM) > 1):
            self.fault('two controllers', 'another controller sends commands, too: this one '
                                          'gives way')
            self.deactivate_by_itself()

    def _stop_motion(self, reason: str, text: str) -> None:
        """Send zero torque; the next state begins the motion anew."""
        self._lost = reason
        self._send_zero()
        self.fault(reason, text)

    def finish(self) -> None:
        """Zero torque is the last thing sent; where nothing was sent the brakes stay on."""
        if self._pushes:
            self._send_zero()

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Report the margins to both sets, V and saturation."""
        if self.state_id == State.PRIMARY_STATE_UNCONFIGURED:
            return DiagnosticStatus.WARN, 'unconfigured', {}
        if not self.active:
            waiting = 'waiting for joint states and a listener'
            return DiagnosticStatus.WARN, waiting if self.wants_activation else 'inactive', {}
        if self._controller is None or self.output is None:
            return DiagnosticStatus.WARN, 'waiting for joint states and a listener', {}
        values = self.monitors.status(self.output.saturated)
        if self._lost:
            return DiagnosticStatus.ERROR, f'{self._lost}: zero torque', values
        if self.count_publishers(COMMANDS) > 1:
            return DiagnosticStatus.ERROR, 'another node sends commands, too', values
        if self.monitors.violations:
            return DiagnosticStatus.ERROR, self.monitors.first_violation, values
        if self.settings.model == 'estimated' and not self.lockstep:
            return self._with_estimate(values)
        return DiagnosticStatus.OK, 'running', values

    def _with_estimate(self, values: dict[str, object]) -> tuple[bytes, str, dict[str, object]]:
        if self._estimated_at is None:
            values['age of the estimate [s]'] = 'none yet'
            return DiagnosticStatus.WARN, 'no estimate yet: initial_estimate is used', values
        age = time.monotonic() - self._estimated_at
        values['age of the estimate [s]'] = f'{age:.3f}'
        if age > OLD_ESTIMATE:
            text = f'no estimate for {age:.1f} s: the last one is used'
            return DiagnosticStatus.WARN, text, values
        return DiagnosticStatus.OK, 'running', values


def _estimate_limit(settings: ControllerNodeSettings, arm: Arm) -> np.ndarray:
    return settings.resolved(parameters=arm.m).estimate_limit


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_node('controller', ControllerNode, args)


if __name__ == '__main__':
    sys.exit(main())
