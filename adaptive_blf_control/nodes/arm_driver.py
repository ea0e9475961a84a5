# SPDX-License-Identifier: Apache-2.0
"""``arm_driver``: a simulated arm in real time behind the topics of a real one.

The arm moves with the clock: a command acts from the moment it arrives, so the delay of the loop
is in the simulation, and ``effort`` is the mean torque over the interval that ends at the stamp.
States lie on the grid of the rate; where the machine is late, periods are missed, not squeezed.
Until the first command the brakes hold the arm: velocity as set, effort NaN (nothing measured).
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

from adaptive_blf_control.bags.cdr import decode_float64_array
from adaptive_blf_control.bags.joint_state import JointStateCodec
from adaptive_blf_control.errors import BagError
from adaptive_blf_control.nodes.data_node import DataNode, run_node
from adaptive_blf_control.nodes.robot_description import arm_of
from adaptive_blf_control.parameters.build import build_plant
from adaptive_blf_control.topics import COMMANDS, JOINT_STATES

__all__ = ['ArmDriver', 'main']

NEVER = 2**63  # ns, before the grid of the states is laid


class ArmDriver(DataNode):
    """Simulated arm: commands in, joint states out.

    Attributes:
        plant: The true arm.
        started: Whether a first command has released the brakes.
        missed: Periods in which no state was published.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        """Build the arm from the parameters; ParameterError or ArmError where that fails."""
        super().__init__('arm_driver', context=context, **options)
        self.arm = arm_of(self)
        self.plant = build_plant(self.values, self.arm)
        self.plant.trial(self.plant.torque, 1e-3)  # compile before the clock runs
        self.started = False
        self.timed_out = False
        self.missed = 0
        self._period_ns = int(round(1e9 / self.values['rate']))
        self._codec = JointStateCodec(self.arm.joints, self.values['frame_id'])
        self._nan = np.full(self.arm.n, np.nan)
        self._impulse = np.zeros(self.arm.n)  # ∫ τ dt since the last state [N·m·s]
        self._due_ns = NEVER  # monotonic, like all times but the stamps
        self._offset_ns = self._begin_ns = self._moved_ns = self._last_state_ns = 0
        self._command_ns = 0
        self._states = self.data_publisher(JointState, JOINT_STATES)
        self.data_subscription(Float64MultiArray, COMMANDS, self.on_command, reliable=True)

    def on_command(self, data: bytes, info: dict[str, int]) -> None:
        """Apply a command from now on; a wrong length or a non-finite value drops it whole."""
        try:
            torque = decode_float64_array(data)
        except BagError as error:
            self.drop('unreadable command', str(error))
            return
        if torque.size != self.arm.n:
            self.drop('command of wrong length', f'{torque.size} values for {self.arm.n} joints')
            return
        if not np.isfinite(torque).all():
            joint = self.arm.joints[int(np.argmin(np.isfinite(torque)))]
            self.drop('non-finite command', f'joint {joint!r}')
            return
        now = time.monotonic_ns()
        self._catch_up(now)  # a state that is due before the command does not see it
        if not self.started:
            self.started = True
            self._begin_ns = self._moved_ns = now
        self._move_to(now)
        self._command_ns = now
        self.timed_out = False
        self.plant.apply(torque)

    def _move_to(self, now_ns: int) -> None:
        ahead_ns = now_ns - self._moved_ns
        if ahead_ns > 0:
            # After a stall in steps of a period still: one long step could be an unstable one.
            steps = -(-ahead_ns // self._period_ns)
            for _ in range(steps):
                self.plant.advance(ahead_ns * 1e-9 / steps)
            self._impulse = self._impulse + self.plant.torque * (ahead_ns * 1e-9)
            self._moved_ns = now_ns

    def loop(self) -> None:
        """Publish a state every period, take commands in between."""
        wait_for, duration = self.values['wait_for_subscribers'], self.values['duration']
        while self._states.get_subscription_count() < wait_for and not self._ended():
            self.spin_data(0.01)
        self._start_clock()
        while not self._ended():
            wait_ns = self._due_ns - time.monotonic_ns()
            if wait_ns > 0:
                self.spin_data(wait_ns * 1e-9)
            self._catch_up(time.monotonic_ns())
            if duration > 0.0 and self.started and (
                    self._last_state_ns - self._begin_ns >= duration * 1e9):
                self.get_logger().info(f'duration of {duration:g} s is over, '
                                       f'{self.missed} periods missed')
                return

    def _start_clock(self) -> None:
        """Lay the grid of the states."""
        self._due_ns = self._moved_ns = self._last_state_ns = time.monotonic_ns()
        self._offset_ns = self.get_clock().now().nanoseconds - self._due_ns

    def _catch_up(self, now_ns: int) -> None:
        """Publish the state that is due, on the grid; periods that passed unseen are missed."""
        if now_ns < self._due_ns:
            return
        late = (now_ns - self._due_ns) // self._period_ns
        self.missed += late
        due_ns = self._due_ns + late * self._period_ns
        self._due_ns = due_ns + self._period_ns
        self._publish_state(due_ns)
        self.sampled()

    def _publish_state(self, due_ns: int) -> None:
        effort, interval = self._nan, 0.0
        if self.started:
            self._watch(due_ns)
            self._move_to(due_ns)
            interval = (due_ns - max(self._last_state_ns, self._begin_ns)) * 1e-9
            # No interval yet where a command came before the clock started.
            effort = self._impulse / interval if interval > 0.0 else self.plant.torque
            self._impulse = np.zeros(self.arm.n)
        self._last_state_ns = due_ns
        self._states.publish(self._codec.encode(
            due_ns + self._offset_ns, *self.plant.measure(effort, interval)))

    def _watch(self, now_ns: int) -> None:
        if not self.timed_out and now_ns - self._command_ns > self.values[
                'command_timeout'] * 1e9:
            self.timed_out = True
            self.plant.apply(np.zeros(self.arm.n))
            self.get_logger().warning(
                f'no command for {self.values["command_timeout"]:g} s: zero torque')

    def _ended(self) -> bool:
        return self.stop.is_set() or not self.context.ok()

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Report brakes, watchdog and missed periods."""
        values: dict[str, object] = {'missed periods': self.missed}
        if not self.started:
            return DiagnosticStatus.WARN, 'brakes on, waiting for a command', values
        if self.timed_out:
            return DiagnosticStatus.ERROR, 'no commands: zero torque', values
        return DiagnosticStatus.OK, 'running', values


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_node('arm_driver', ArmDriver, args)


if __name__ == '__main__':
    sys.exit(main())
