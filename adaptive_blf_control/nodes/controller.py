# SPDX-License-Identifier: Apache-2.0
"""``controller``: joint states and θ̂ in, torques and the adaptation term out.

The motion begins with the first joint state after somebody listens to the commands. θ̂ may arrive
late or never: the controller goes on with the last one.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from rclpy.context import Context
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from adaptive_blf_control.bags.cdr import Float64MultiArrayCodec
from adaptive_blf_control.bags.controller_codecs import ControllerCodecs
from adaptive_blf_control.bags.joint_state import JointStateReader
from adaptive_blf_control.control.controller import (
    Controller,
    ControllerSettings,
    ControlOutput,
    sampling_number,
)
from adaptive_blf_control.control.guarantee import bounded_value, guarantee, GuaranteeMonitor
from adaptive_blf_control.control.reference import Reference, SmoothStart
from adaptive_blf_control.errors import BagError, BlfError
from adaptive_blf_control.nodes.data_node import DataNode, run_node, TOO_LATE
from adaptive_blf_control.nodes.joint_trajectory import reference_through
from adaptive_blf_control.nodes.node_parameters import on_change
from adaptive_blf_control.nodes.robot_description import arm_of
from adaptive_blf_control.parameters.build import (
    build_controller,
    controller_settings,
    initial_theta,
)
from adaptive_blf_control.topics import (
    ADAPTATION_TERM,
    BARRIER,
    COMMANDS,
    GUARANTEE,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    REFERENCE,
    THETA_HAT,
    TRACKING_ERROR,
)

__all__ = ['ControllerNode', 'main']

HEAD_START = 0.1  # s from a trajectory's arrival to its beginning
HEARTBEAT = 500  # monitored samples between two repetitions of the guarantee


class ControllerNode(DataNode):
    """Equation (38) behind the topics of ros2_controllers' effort group controller.

    Attributes:
        theta: θ̂ in use, shape (m,).
        output: Last output of the law, None before the first.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        """Validate everything that can be validated before the arm is seen."""
        super().__init__('controller', context=context, **options)
        values = self.values
        self.arm = arm_of(self)
        self.theta = initial_theta(values, self.arm)
        self.output: ControlOutput | None = None
        self._controller: Controller | None = None
        self._warm_up()
        self._start_ns = 0
        self._last_ns: int | None = None
        self._jumped_ns: int | None = None
        self._heard_at: float | None = None
        self._lost = False
        self._samples_seen = 0
        self._resumes = False
        self._new_settings: ControllerSettings | None = None
        self._new_reference: tuple[Controller, Reference] | None = None
        self._violations = 0
        self._first_violation = ''
        self._margins = np.zeros(2 * self.arm.n)
        self._lyapunov = 0.0
        self._make_topics()
        on_change(self, 'controller', values, self._retune)

    def _make_topics(self) -> None:
        arm = self.arm
        self._state_reader = JointStateReader(arm.joints)
        self._theta_reader = JointStateReader(arm.parameters)
        self._torque_codec = Float64MultiArrayCodec(arm.n)
        self._codecs = ControllerCodecs(arm.joints, arm.parameters)
        self._commands = self.data_publisher(Float64MultiArray, COMMANDS)
        self._term = self.data_publisher(JointState, ADAPTATION_TERM)
        self._monitors = {topic: self.data_publisher(JointState, topic)
                          for topic in (REFERENCE, TRACKING_ERROR, BARRIER)}
        self._guarantee_topic = self.data_publisher(JointState, GUARANTEE)
        self._guarantee: GuaranteeMonitor | None = None
        self.create_subscription(JointTrajectory, JOINT_TRAJECTORY, self.on_joint_trajectory, 10)
        if self.values['model'] == 'estimated':
            self.data_subscription(JointState, THETA_HAT, self.on_theta_hat, wake=False,
                                   newest_only=True)
        self.data_subscription(JointState, JOINT_STATES, self.on_joint_states, newest_only=True)

    def _warm_up(self) -> None:
        """Check the sets (9) and compile the law, on the posture the reference starts in."""
        zero = np.zeros(self.arm.n)
        try:
            trial = build_controller(self.values, self.arm, None)
        except BlfError:
            self.destroy_node()
            raise
        start = trial.reference.at(0.0).position
        SmoothStart(trial.reference, 1.0, start).at(0.5)  # compiled here, not in the first answer
        trial.lyapunov(start, trial.update(0.0, start, zero, self.theta), self.theta)
        number = sampling_number(self.arm, trial.settings.k2, start, self.theta, 1e-3)
        if number >= 2.0:
            self.get_logger().warning(
                f'k2 λ_max(M⁻¹) dt = {number:.2f} at 1 kHz with the initial estimate: 2 or more '
                f'is unstable in a sampled loop; lower k2 or check the estimate')

    def _retune(self, values: dict[str, Any]) -> None:
        # Taken by the loop before its next sample, also by a motion that is only just beginning.
        self._new_settings = controller_settings(values, self.arm.n)

    def on_theta_hat(self, data: bytes, info: dict[str, int]) -> None:
        """Take the newest estimate; one that is not finite or not ours is dropped."""
        try:
            _, theta, _, _ = self._theta_reader.read(data)
        except BagError as error:
            self.drop('unusable estimate', str(error))
            return
        if np.isfinite(theta).all():
            self.theta = theta
        else:
            self.drop('non-finite estimate', 'the last one is kept')

    def on_joint_trajectory(self, message: JointTrajectory) -> None:
        """Follow the points instead of the reference so far; one that cannot be is dropped whole.

        Runs beside the loop: the new reference is made for a moment that is still to come.
        """
        controller, last_ns = self._controller, self._last_ns
        if controller is None or last_ns is None:
            self.drop('trajectory before the motion has begun', 'send it again then')
            return
        t = (last_ns - self._start_ns) * 1e-9 + HEAD_START
        try:
            self._new_reference = controller, reference_through(message, controller, t)
        except BlfError as error:
            self.drop('unusable trajectory', str(error))

    def on_joint_states(self, data: bytes, info: dict[str, int]) -> None:
        """Answer a joint state with a torque."""
        try:
            stamp, q, qd, _ = self._state_reader.read(data)
        except BagError as error:
            self.drop('unusable joint state', str(error))
            return
        if not (np.isfinite(q).all() and np.isfinite(qd).all()):
            joint = self.arm.joints[int(np.argmin(np.isfinite(q) & np.isfinite(qd)))]
            self.drop('non-finite joint state', f'joint {joint!r}')
            return
        if not self._in_order(stamp):
            return
        if self._lost:
            self._controller, self._resumes = None, True
        begins = self._controller is None
        if begins and not self._start(stamp, q):
            return
        self._last_ns = stamp
        self._heard_at, self._lost = time.monotonic(), False
        self._answer(stamp, q, qd)
        if begins:  # after the answer: writing a log line takes longer than the law
            self.get_logger().info('motion begins')
            self._promise(stamp)

    def _in_order(self, stamp: int) -> bool:
        """Whether time goes on; a stamp far ahead counts once a second message confirms it.

        One wild stamp would otherwise throw the reference ahead and make every later state old.
        """
        if stamp >= TOO_LATE:
            self.drop('unusable joint state', f'stamp {stamp} ns does not fit its field')
            return False
        if self._last_ns is None:
            return True
        ahead = stamp - self._last_ns
        if ahead <= 0:
            self.drop('joint state out of order', f'stamp {stamp} ns after {self._last_ns} ns')
            return False
        jumped, longest = self._jumped_ns, self.values['state_timeout'] * 1e9
        if ahead > longest and (jumped is None or not 0 < stamp - jumped <= longest):
            self._jumped_ns = stamp
            self.drop('stamp jumps ahead', f'{ahead * 1e-9:.6g} s after the last one')
            return False
        if ahead > longest:  # the clock stays ahead: the motion begins anew on it
            self._controller, self._resumes = None, True
        self._jumped_ns = None
        return True

    def _start(self, stamp: int, q: np.ndarray) -> bool:
        if not self._someone_drives():
            return False
        values = dict(self.values)
        if self._resumes:  # the reference has moved on meanwhile, and so may the arm
            values['reference.smooth_start'] = max(values['reference.smooth_start'],
                                                   values['reference.resume_time'])
        self._controller = build_controller(values, self.arm, q)
        self._start_ns = stamp
        self._guarantee = None
        return True

    def _someone_drives(self) -> bool:
        """Whether an arm listens to the commands; a recorder of ours does not move one."""
        if self._commands.get_subscription_count() == 0:
            return False
        return any(info.node_name != 'recorder'
                   for info in self.get_subscriptions_info_by_topic(COMMANDS))

    def _answer(self, stamp: int, q: np.ndarray, qd: np.ndarray) -> None:
        controller = self._controller
        if controller is None:
            return
        new, self._new_settings = self._new_settings, None
        if new is not None:
            controller.settings = new
        follow, self._new_reference = self._new_reference, None
        if follow is not None and follow[0] is controller:
            controller.reference = follow[1]
        output = controller.update((stamp - self._start_ns) * 1e-9, q, qd, self.theta)
        self._commands.publish(self._torque_codec.encode(output.torque))
        self._term.publish(self._codecs.adaptation_term(stamp, output))
        self.output = output
        self.sampled()
        self._measure(controller, q, output)
        if self._samples_seen % self.values['monitor_decimation'] == 0:
            self._monitor(controller, stamp, q, output)
        self._samples_seen += 1

    def _promise(self, stamp: int) -> None:
        """State what Theorem 2 promises from here on, given bounds on the unknown arm."""
        values, controller, output = self.values, self._controller, self.output
        if values['guarantee.mode'] == 'off' or controller is None or output is None:
            return
        smallest, largest = values['guarantee.mass']
        value = bounded_value(output.e1, output.e2, controller.performance, largest,
                              values['guarantee.theta_error'],
                              np.array([values['guarantee.smallest_gamma']]))
        promised = guarantee(value, controller.performance, controller.reference.range(),
                             smallest)
        self._guarantee = GuaranteeMonitor(promised, controller.performance, self.arm.joints)
        self._guarantee_topic.publish(self._codecs.guarantee(stamp, promised))
        bounds = ', '.join(f'{joint} {low:.4g} .. {high:.4g} rad' for joint, low, high in zip(
            self.arm.joints, promised.error_lower, promised.error_upper))
        self.get_logger().info(f'Theorem 2: V(0) <= {value:.4g}, so e1 stays in {bounds}')

    def _watch_promise(self, t: float, stamp: int, e1: np.ndarray) -> None:
        monitor = self._guarantee
        if monitor is None:
            return
        if self._samples_seen % HEARTBEAT == 0:
            self._guarantee_topic.publish(self._codecs.guarantee(stamp, monitor.promised))
        left = monitor.observe(t, e1)
        if left is not None:
            self.get_logger().error(
                f'joint {left.joint}: e1 = {left.value:.4g} rad is beyond the {left.bound:.4g} '
                f'rad that Theorem 2 promises: check the bounds under guarantee, torque limits '
                f'and the delay', throttle_duration_sec=1.0)

    def _measure(self, controller: Controller, q: np.ndarray, output: ControlOutput) -> None:
        """Take the margins of every sample; say which joint left which set, by how much."""
        n = self.arm.n
        self._margins[:n] = controller.safety.margin(q)
        self._margins[n:] = controller.performance.margin(output.e1)
        if self._margins.min() > 0.0:
            return
        worst = int(np.argmin(self._margins))
        i, name = worst % n, 'safety' if worst < n else 'performance'
        value = q[i] if worst < n else output.e1[i]
        bounds = controller.safety if worst < n else controller.performance
        text = (f'joint {self.arm.joints[i]!r} has left its {name} set: {value:.5g} rad is not '
                f'within {bounds.lower[i]:.5g} .. {bounds.upper[i]:.5g} rad')
        self._violations += 1
        self._first_violation = self._first_violation or text
        self.get_logger().error(text, throttle_duration_sec=1.0)

    def _monitor(self, controller: Controller, stamp: int, q: np.ndarray,
                 output: ControlOutput) -> None:
        self._lyapunov = controller.lyapunov(q, output, self.theta)
        for topic, message in self._codecs.monitors(stamp, output, self._margins,
                                                    self._lyapunov).items():
            self._monitors[topic].publish(message)
        self._watch_promise((stamp - self._start_ns) * 1e-9, stamp, output.e1)

    def idle(self) -> None:
        """Command zero torque when the joint states stop coming."""
        timeout = self.values['state_timeout']
        if (self._heard_at is not None and not self._lost
                and time.monotonic() - self._heard_at > timeout):
            self._lost = True
            self._commands.publish(self._torque_codec.encode(np.zeros(self.arm.n)))
            self.get_logger().error(f'no joint state for {timeout:g} s: zero torque')

    def finish(self) -> None:
        """Zero torque is the last thing sent."""
        if self._heard_at is not None and self.context.ok():
            self._commands.publish(self._torque_codec.encode(np.zeros(self.arm.n)))

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Report the margins to both sets, V and saturation."""
        if self._controller is None or self.output is None:
            return DiagnosticStatus.WARN, 'waiting for joint states and a listener', {}
        n = self.arm.n
        values: dict[str, object] = {'V': f'{self._lyapunov:.6g}',
                                     'superseded messages': self.superseded}
        for i, joint in enumerate(self.arm.joints):
            values[f'{joint} safety margin [rad]'] = f'{self._margins[i]:.6g}'
            values[f'{joint} performance margin [rad]'] = f'{self._margins[n + i]:.6g}'
            values[f'{joint} saturated'] = bool(self.output.saturated[i])
        if self._lost:
            return DiagnosticStatus.ERROR, 'joint states lost: zero torque', values
        if self._violations:
            values['samples outside a set'] = self._violations
            values['first violation'] = self._first_violation
        if self._guarantee is not None and self._guarantee.first is not None:
            values['left what Theorem 2 promises at [s]'] = f'{self._guarantee.first.t:.3f}'
        if self._violations:
            return DiagnosticStatus.ERROR, self._first_violation, values
        return DiagnosticStatus.OK, 'running', values


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_node('controller', ControllerNode, args)


if __name__ == '__main__':
    sys.exit(main())
