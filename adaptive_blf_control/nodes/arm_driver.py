# SPDX-License-Identifier: Apache-2.0
"""``arm_driver``: a simulated arm behind the topics of a real one.

In real time the arm moves with the clock: a command acts from the moment it arrives, so the delay
of the loop is in the simulation, and ``effort`` is the mean torque over the interval that ends at
the stamp. States lie on the grid of the rate; where the machine is late, periods are missed, not
squeezed. Until the first command the brakes hold the arm: velocity as set, effort NaN (nothing
measured). Under ``use_sim_time`` see :mod:`adaptive_blf_control.nodes.arm_lockstep`.

Lifecycle: inactive, the states are published and the brakes hold; active, the first command
releases them; deactivated, the torque goes to zero over ``ramp_time``, then the brakes hold.
"""

from __future__ import annotations

from collections import deque
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from rclpy.context import Context
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from adaptive_blf_control.configuration.build import build_plant, build_simulated_arm
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.errors import BagError, ParameterError
from adaptive_blf_control.messages.cdr import decode_float64_array
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.topics import COMMANDS, JOINT_STATES
from adaptive_blf_control.nodes.arm_lockstep import ArmLockstep, SteppedDriver
from adaptive_blf_control.nodes.command_source import CommandSource
from adaptive_blf_control.parameters.table import broadcast
from adaptive_blf_control.runtime.endpoints import full_name, UNNAMED
from adaptive_blf_control.runtime.loop_statistics import Histogram
from adaptive_blf_control.runtime.process import run_node
from adaptive_blf_control.runtime.robot_description import arm_of
from adaptive_blf_control.simulation.plant import SimulatedArm

__all__ = ['ArmDriver', 'main']

NEVER = 2**63  # ns, before the grid of the states is laid
# A command cannot answer a state that is younger than this: decoding and the law take longer.
SHORTEST_ANSWER = 50_000  # ns
# Live parameters of the simulated arm itself, beside those under schedule and sensors.
PLANT = {'true_parameters', 'payload', 'torque_limit', 'substeps', 'dead_time'}


class ArmDriver(SteppedDriver):
    """Simulated arm: commands in, joint states out.

    Attributes:
        plant: The true arm.
        started: Whether a first command has released the brakes.
        missed: Periods in which no state was published.
        period_ns: Period of the states [ns].
        round_trip: From the publication of a state to the arrival of the command that answers it.
    """

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        """Make the node; with ``autostart`` ready to run, the reason raised where it cannot."""
        self.started = False
        self.timed_out = False
        self.missed = 0
        self._ready = False
        self.round_trip = Histogram()
        super().__init__('arm_driver', DriverSettings, context=context, **options)
        self.statistics.histograms.append(self.round_trip)
        if self.wants_activation:
            self.activate_by_itself()

    def configure(self) -> None:
        """Build the arm from the parameters; ParameterError or ArmError where that fails."""
        self.arm = arm_of(self, self.settings)
        self.plant = build_plant(self.settings, self.arm)
        if isinstance(self.plant, SimulatedArm):
            self.plant.trial(self.plant.torque, 1e-3)  # compile before the clock runs
        self.period_ns = int(round(1e9 / self.settings.rate))
        self._codec = JointStateCodec(self.arm.joints, self.settings.frame_id)
        self._nan = np.full(self.arm.n, np.nan)
        self._impulse = np.zeros(self.arm.n)  # ∫ τ dt since the last state [N·m·s]
        self._due_ns = NEVER  # monotonic, like all times but the stamps
        self._offset_ns = self._begin_ns = self._moved_ns = self._last_state_ns = 0
        self._command_ns = 0
        self._source = CommandSource()
        self._sent: deque[int] = deque(maxlen=50)  # when states were published, system time [ns]
        self._ramp: tuple[np.ndarray, int] | None = None
        self._states = self.topics.publisher(JointState, JOINT_STATES)
        self._command_input = self.topics.subscribe(Float64MultiArray, COMMANDS,
                                                     self.on_command, reliable=True)
        self._lockstep = ArmLockstep(self) if self.lockstep else None
        self._ready = True

    def activate(self) -> None:
        """Let the next command release the brakes."""
        self._ramp = None

    def deactivate(self) -> None:
        """Begin to bring the torque to zero; the brakes follow."""
        if self._lockstep is not None:  # its time stands still meanwhile
            self.plant.brake()
        elif self.started:
            self._ramp = (self.plant.torque, time.monotonic_ns())

    def cleanup(self) -> None:
        """Take the topics down; the loop waits for another :meth:`configure`."""
        self._ready = False
        self.topics.unsubscribe(self._command_input)
        self.topics.end_publisher(self._states)
        if self._lockstep is not None:
            self._lockstep.close()
        self._due_ns = NEVER
        self.started = False

    def retune(self, settings: DriverSettings, changed: set[str]) -> None:
        """Change payload, friction, sensors, limits or rate between two samples."""
        if not hasattr(self, 'plant'):
            return
        if changed & PLANT or any(name.startswith(('schedule.', 'sensors.')) for name in changed):
            if not isinstance(self.plant, SimulatedArm):
                raise ParameterError('arm_driver.plant', settings.plant,
                                     'builtin: another plant cannot be changed while it runs')
            self.plant.retune(build_simulated_arm(settings, self.arm))
        period_ns = int(round(1e9 / settings.rate))
        if period_ns != self.period_ns:
            if self._due_ns != NEVER:
                self._due_ns += period_ns - self.period_ns
            self.period_ns = period_ns
            self.statistics.restart()

    def on_command(self, data: bytes, info: dict[str, int]) -> None:
        """Apply a command from now on; a wrong length or a non-finite value drops it whole."""
        try:
            torque = decode_float64_array(data)
        except BagError as error:
            self.faults.drop('unreadable command', str(error))
            return
        if torque.size != self.arm.n:
            self.faults.drop('command of wrong length',
                             f'{torque.size} values for {self.arm.n} joints')
            return
        if not np.isfinite(torque).all():
            joint = self.arm.joints[int(np.argmin(np.isfinite(torque)))]
            self.faults.drop('non-finite command', f'joint {joint!r}')
            return
        now = time.monotonic_ns()
        silent = now - self._command_ns > self.settings.command_timeout * 1e9
        number = info.get('publication_sequence_number')
        # A controller that was activated anew has a new publisher and the topic for itself.
        if not (self._source.obeys(number, silent)
                or (self._command_input.get_publisher_count() == 1
                    and self._source.obeys(number, True))):
            self.faults.last = 'commands of a second publisher refused'
            self.faults.drop('command of a second publisher',
                             'one controller at a time: it is refused')
            return
        if self._lockstep is not None:
            self._command_ns = now
            self._lockstep.on_command(torque)
            return
        if not self.active:
            self.faults.drop('command while inactive', 'activate the driver first')
            return
        self._count_round_trip(info)
        self._command_ns = now
        self._catch_up(now)  # a state that is due before the command does not see it
        if not self.started:
            self.started = True
            self._begin_ns = self._moved_ns = now
            self.statistics.restart()
        self._move_to(now)
        self.timed_out = False
        self.plant.apply(torque)

    def _count_round_trip(self, info: dict[str, int]) -> None:
        self.aged(info)
        answered = info.get('source_timestamp', 0) - SHORTEST_ANSWER
        sent, found = self._sent, 0
        while sent and sent[0] <= answered:  # the newest state that was there to be answered
            found = sent.popleft()
        if found:
            self.round_trip.add(time.time_ns() - found)

    def _move_to(self, now_ns: int) -> None:
        ahead_ns = now_ns - self._moved_ns
        if ahead_ns > 0:
            # After a stall in steps of a period still: one long step could be an unstable one.
            steps = -(-ahead_ns // self.period_ns)
            for _ in range(steps):
                self.plant.advance(ahead_ns * 1e-9 / steps)
            self._impulse = self._impulse + self.plant.torque * (ahead_ns * 1e-9)
            self._moved_ns = now_ns

    @property
    def serves(self) -> bool:
        """Whether the node is configured and nobody has asked it to stop."""
        return self._ready and self.up

    def loop(self) -> None:
        """Publish states from each configuration to its end, or until the duration is over."""
        while self.up:
            if not self._ready:  # requests come through the executor
                self.spin_data(0.01)
                continue
            wait_for = self.settings.wait_for_subscribers
            while self.serves and not self.heard_by(wait_for):
                self.spin_data(0.01)
            if (self._real_time if self._lockstep is None else self._lockstep.loop)():
                return

    def heard_by(self, count: int) -> bool:
        """Whether at least ``count`` subscribe to the joint states."""
        with self.between_samples:
            return not self._ready or self._states.get_subscription_count() >= count

    def _real_time(self) -> bool:
        """Publish a state every period, take commands in between; True once duration is over."""
        with self.between_samples:
            if self._ready:
                self._start_clock()
        while self.serves and self._due_ns != NEVER:  # else configured anew meanwhile
            self.spin_data(max(self._due_ns - time.monotonic_ns(), 0) * 1e-9)
            with self.between_samples:
                begin_ns = time.monotonic_ns()
                if begin_ns >= self._due_ns:
                    self._catch_up(begin_ns)
                    self.statistics.callback.add(time.monotonic_ns() - begin_ns)
            duration = self.settings.duration
            if duration > 0.0 and self.started and (
                    self._last_state_ns - self._begin_ns >= duration * 1e9):
                self.get_logger().info(f'duration of {duration:g} s is over, '
                                       f'{self.missed} periods missed')
                return True
        return False

    def _start_clock(self) -> None:
        """Lay the grid of the states."""
        self._due_ns = self._moved_ns = self._last_state_ns = time.monotonic_ns()
        self._offset_ns = self.get_clock().now().nanoseconds - self._due_ns

    def _catch_up(self, now_ns: int) -> None:
        """Publish the state that is due, on the grid; periods that passed unseen are missed."""
        if now_ns < self._due_ns:
            return
        late = (now_ns - self._due_ns) // self.period_ns
        self.missed += late
        due_ns = self._due_ns + late * self.period_ns
        self._due_ns = due_ns + self.period_ns
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
        self.send_state(due_ns + self._offset_ns, effort, interval)

    def send_state(self, stamp_ns: int, effort: np.ndarray, interval: float) -> None:
        """Measure and publish; ``effort`` is the mean torque over the ``interval`` [s] before."""
        data = self._codec.encode(stamp_ns, *self.plant.measure(effort, interval))
        self._sent.append(time.time_ns())
        self._states.publish(data)

    def _watch(self, now_ns: int) -> None:
        """Ramp down when deactivated, act on missing commands: never the last torque for ever."""
        if self._ramp is not None:
            torque, since_ns = self._ramp
            ramp_ns = self.settings.ramp_time * 1e9
            left = 1.0 - (now_ns - since_ns) / ramp_ns if ramp_ns > 0.0 else 0.0
            self.plant.apply(max(min(left, 1.0), 0.0) * torque)
            if left <= 0.0:
                self._ramp = None
                self.started = False
                self.plant.brake()
                self._moved_ns = now_ns
            return
        if now_ns - self._command_ns <= self.settings.command_timeout * 1e9:
            return
        # Each time anew: the action may change while commands are missing.
        damping = (broadcast(self.settings.damping, self.arm.n)
                   if self.settings.timeout_action == 'damping' else np.zeros(self.arm.n))
        self.plant.apply(-damping * self.plant.qd)
        if not self.timed_out:
            self.timed_out = True
            self.faults.report('no commands', (
                f'no command for {self.settings.command_timeout:g} s: '
                f'{self.settings.timeout_action} torque'))

    def _timing(self) -> dict[str, object]:
        parts = (0.5, 0.99, 0.999)
        trip = ', '.join(f'{value:.3f}' for value in self.round_trip.quantiles(parts))
        due = max(self.statistics.span_ns / self.period_ns, 1.0)
        in_time = min(self.round_trip.within(self.period_ns) / due, 1.0)
        return {'missed periods': self.missed,
                'round trip p50, p99, p99.9, largest so far [ms]':
                    f'{trip}, {self.round_trip.largest_ns * 1e-6:.3f}',
                'answered within their period so far [%]': f'{100.0 * in_time:.3f}'}

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Report brakes, watchdog, round trip and missed periods."""
        if not self._ready:
            return DiagnosticStatus.WARN, 'unconfigured', {}
        values = {} if self.lockstep else self._timing()
        publishers = [] if self.lockstep else self.get_publishers_info_by_topic(COMMANDS)
        if len(publishers) > 1:
            names = ', '.join(full_name(info) or UNNAMED for info in publishers)
            return DiagnosticStatus.ERROR, f'several publishers of commands: {names}', values
        if not self.active:
            return DiagnosticStatus.WARN, 'inactive: brakes on', values
        if not self.started:
            return DiagnosticStatus.WARN, 'brakes on, waiting for a command', values
        if self.timed_out:
            return (DiagnosticStatus.ERROR,
                    f'no commands: {self.settings.timeout_action} torque', values)
        return DiagnosticStatus.OK, 'running', values


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run_node('arm_driver', ArmDriver, args)


if __name__ == '__main__':
    sys.exit(main())
