# SPDX-License-Identifier: Apache-2.0
"""``arm_driver``: a simulated arm behind the topics of a real one.

In real time the arm moves with the clock: a command acts from the moment it arrives, so the delay
of the loop is in the simulation, and ``effort`` is the mean torque over the interval that ends at
the stamp. States lie on the grid of the rate; where the machine is late, periods are missed, not
squeezed. Until the first command the brakes hold the arm, and effort is NaN (nothing measured).
Under ``use_sim_time`` see :mod:`adaptive_blf_control.nodes.arm_lockstep`.

Lifecycle: inactive, the states are published and the brakes hold; active, the first command
releases them; deactivated, the torque goes to zero over ``ramp_time``, then the brakes hold.
"""

from __future__ import annotations

from collections.abc import Iterable
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from rclpy.context import Context
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from adaptive_blf_control.arms.robot_description import robot_description
from adaptive_blf_control.configuration.build_plant import build_plant
from adaptive_blf_control.configuration.node_settings import DriverSettings
from adaptive_blf_control.errors import BagError, ParameterError
from adaptive_blf_control.messages.cdr import encode_text
from adaptive_blf_control.messages.command import read_command
from adaptive_blf_control.messages.joint_state import JointStateCodec
from adaptive_blf_control.messages.topics import COMMANDS, JOINT_STATES, ROBOT_DESCRIPTION
from adaptive_blf_control.nodes.arm_lockstep import ArmLockstep, SteppedDriver
from adaptive_blf_control.runtime.heard_topic import HeardTopic
from adaptive_blf_control.runtime.rclpy_internals import overrides_of
from adaptive_blf_control.runtime.robot_description import arm_of, is_topic
from adaptive_blf_control.runtime.round_trip import RoundTrips
from adaptive_blf_control.runtime.status_report import Status
from adaptive_blf_control.simulation.abilities import HasContacts
from adaptive_blf_control.simulation.command_gate import CommandGate
from adaptive_blf_control.simulation.drives import Drives
from adaptive_blf_control.simulation.encoder_check import encoder_warning
from adaptive_blf_control.simulation.plant import Plant, Retunable, SimulatedArm
from adaptive_blf_control.simulation.settings import PlantSettings
from adaptive_blf_control.simulation.state_grid import StateGrid

__all__ = ['ArmDriver']

# Of command_timeout: how long after its stamp a state may still be sent. Who hears it judges its
# age by when it was sent.
HELD_UP = 0.25
OF_THE_PLANT = {row.name for row in PlantSettings.table()}


class ArmDriver(SteppedDriver):
    """Simulated arm: commands in, joint states out.

    Attributes:
        drives: What moves the true arm; from the configuration on, like the other parts.
        grid: When states are due.
        commands: Which commands count.
        round_trips: From states to the commands that answer them.
        stepping: Moves the arm in lockstep; None in real time.
    """

    grid: StateGrid
    commands: CommandGate

    def __init__(self, *, context: Context | None = None, **options: Any) -> None:
        """Make the node; with ``autostart`` it is ready to run, or the reason is raised."""
        self._ready = False
        self.round_trips = RoundTrips()
        super().__init__('arm_driver', DriverSettings, context=context, **options)
        self.statistics.histograms.append(self.round_trips.histogram)
        if self.wants_activation:
            self.activate_by_itself()

    @property
    def plant(self) -> Plant:
        """The true arm."""
        return self.drives.plant

    @property
    def started(self) -> bool:
        """Whether a first command has released the brakes."""
        return self._ready and self.drives.released

    def configure(self) -> None:
        """Build the arm from the parameters; ParameterError or ArmError where that fails."""
        settings = self.settings
        self.arm = arm_of(self, settings)
        plant = build_plant(settings, self.arm)
        if isinstance(plant, SimulatedArm):
            plant.trial(plant.torque, 1e-3)  # compile before the clock runs
        self.drives = Drives(plant, settings, settings.ramp_time)
        self._warn_of_unused(overrides_of(self))
        self.grid = StateGrid(settings.rate)
        self.commands = CommandGate(self.arm.joints)
        self._heard = HeardTopic(self, COMMANDS, self.commands.source,
                                 lambda: self.settings.command_timeout)
        self._stamp_ns = 0  # of the newest state
        self._codec = JointStateCodec(self.arm.joints, settings.frame_id)
        self._offset_ns = 0  # from the monotonic clock, that of all times here, to the stamps
        self._states = self.topics.publisher(JointState, JOINT_STATES)
        self._description = self._describe()
        self._command_input = self.topics.subscribe(Float64MultiArray, COMMANDS, self.on_command,
                                                    reliable=True)
        self.stepping = ArmLockstep(self) if self.lockstep else None
        self._ready = True

    def _warn_of_unused(self, given: Iterable[str]) -> None:
        """Warn of parameters of an encoder that are set while none measures."""
        if unused := encoder_warning(given, self.plant):
            self.caution(unused)

    def _describe(self) -> Publisher | None:
        """Publish the URDF of the arm, unless it came from a topic."""
        text = None if is_topic(self.settings) else robot_description(self.arm)
        if text is None:
            return None
        publisher = self.topics.publisher(String, ROBOT_DESCRIPTION, latched=True)
        publisher.publish(encode_text(text))
        return publisher

    def activate(self) -> None:
        """Let the next command release the brakes."""
        self.drives.stay()

    def deactivate(self) -> None:
        """Begin to bring the torque to zero; the brakes follow."""
        if self.stepping is not None:  # its time stands still meanwhile
            self.plant.brake()
        else:
            self.drives.ramp_down(time.monotonic_ns())

    def cleanup(self) -> None:
        """Destroy the topics; the loop waits for another :meth:`configure`."""
        self._ready = False
        self.topics.unsubscribe(self._command_input)
        self.topics.end_publisher(self._states)
        if self._description is not None:
            self.topics.end_publisher(self._description)
        if self.stepping is not None:
            self.stepping.close()
        self.grid.end()

    def retune(self, settings: DriverSettings, changed: set[str]) -> None:
        """Change payload, friction, sensors, limits or rate between two samples."""
        if not hasattr(self, 'drives'):
            return
        if changed & OF_THE_PLANT:
            if not isinstance(self.plant, Retunable):
                raise ParameterError('arm_driver.plant', settings.plant,
                                     'builtin: another plant cannot be changed while it runs')
            self.plant.retune(settings)
            self._warn_of_unused(changed)
        self.drives.watchdog, self.drives.ramp_time = settings, settings.ramp_time
        if self.grid.retune(settings.rate):
            self.statistics.restart()

    def on_command(self, data: bytes, info: dict[str, int]) -> None:
        """Apply a command from now on; a wrong length or a non-finite value drops it whole."""
        try:
            torque, source, answered_ns = read_command(data)
        except BagError as error:
            self.faults.drop('unreadable command', str(error))
            return
        now, timeout = time.monotonic_ns(), self.settings.command_timeout
        refusal = self.commands.refuse(torque, source, info.get('publication_sequence_number'),
                                       now, timeout, self._heard.alone, self.listening_since)
        if refusal is None and self.stepping is None:
            refusal = self.commands.too_old(answered_ns, self._stamp_ns, timeout)
        if refusal is not None:
            self.faults.refuse(refusal)
        elif self.stepping is not None:
            self.commands.heard_ns = now
            self.stepping.answers.command(torque)
        elif not self.active:
            self.faults.drop('command while inactive', 'activate the driver first')
        else:
            self._apply(torque, now, info, answered_ns)

    def _apply(self, torque: np.ndarray, now_ns: int, info: dict[str, int],
               answered_ns: int | None) -> None:
        self.aged(info)
        self.round_trips.answered(answered_ns, info.get('source_timestamp', 0), time.time_ns())
        # A state that is due before the command does not see it: after a stall the arm has been
        # without commands until now.
        self.catch_up(now_ns)
        self.commands.heard_ns = now_ns
        if self.drives.command(torque, now_ns, self.grid.period_ns):
            self.statistics.restart()

    @property
    def serves(self) -> bool:
        """Whether the node is configured and has not been asked to stop."""
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
            if (self._real_time if self.stepping is None else self.stepping.loop)():
                return

    def heard_by(self, count: int) -> bool:
        """Whether at least ``count`` subscribe to the joint states."""
        with self.between_samples:
            return not self._ready or self._states.get_subscription_count() >= count

    def _real_time(self) -> bool:
        """Publish a state every period, take commands in between; True once duration is over."""
        with self.between_samples:
            if self._ready:
                self.start_clock()
        while self.serves and self.grid.laid:  # else it was configured again meanwhile
            self.spin_data(self.grid.left(time.monotonic_ns()))
            with self.between_samples:
                begin_ns = time.monotonic_ns()
                if self.catch_up(begin_ns):
                    self.statistics.callback.add(time.monotonic_ns() - begin_ns)
            duration, drives = self.settings.duration, self.drives
            if duration > 0.0 and drives.released and (
                    drives.sampled_ns - drives.begun_ns >= duration * 1e9):
                self.get_logger().info(f'duration of {duration:g} s is over, '
                                       f'{self.grid.missed} periods missed')
                return True
        return False

    def start_clock(self) -> None:
        """Lay the grid of the states."""
        now_ns = time.monotonic_ns()
        self.grid.begin(now_ns)
        self.drives.begin(now_ns)
        self._offset_ns = self.get_clock().now().nanoseconds - now_ns

    def catch_up(self, now_ns: int) -> bool:
        """Publish the state that is due at ``now_ns`` by the monotonic clock; False for none."""
        due_ns, drives = self.grid.take(now_ns), self.drives
        if due_ns is None:
            return False
        had_commands, settings = not drives.timed_out, self.settings
        effort = drives.sample(due_ns, self.grid.period_ns,
                               self.commands.silent(due_ns, settings.command_timeout))
        if drives.timed_out and had_commands:
            self.faults.report('no commands', (
                f'no command for {settings.command_timeout:g} s: '
                f'{settings.timeout_action} torque'), orderly=self.count_publishers(COMMANDS) == 0)
        stamp_ns = due_ns + self._offset_ns
        data = self._codec.encode(stamp_ns, *self.plant.measure(effort.torque, effort.interval))
        sent_ns = time.time_ns()
        # Right before it is sent: after a stop of the process it would be old and look new.
        if time.monotonic_ns() - due_ns > HELD_UP * settings.command_timeout * 1e9:
            self.faults.drop('state that was held up', 'the next one is sent in its place')
        else:
            self._send(stamp_ns, data, sent_ns)
        self.sampled()
        return True

    def send_state(self, stamp_ns: int, effort: np.ndarray, interval: float) -> None:
        """Measure and publish; ``effort`` is the mean torque over the ``interval`` [s] before."""
        data = self._codec.encode(stamp_ns, *self.plant.measure(effort, interval))
        self._send(stamp_ns, data, time.time_ns())

    def _send(self, stamp_ns: int, data: bytes, sent_ns: int) -> None:
        self._states.publish(data)
        self._stamp_ns = stamp_ns
        self.round_trips.sent(stamp_ns, sent_ns)

    def status(self) -> Status:
        """Report brakes, watchdog, round trip and missed periods."""
        if not self._ready:
            return DiagnosticStatus.WARN, 'unconfigured', {}
        values: dict[str, object] = {}
        if not self.lockstep:
            values = {'missed periods': self.grid.missed, **self.round_trips.figures(
                self.grid.period_ns, self.statistics.span_ns)}
        if isinstance(self.plant, HasContacts):
            values['contacts'] = len(self.plant.touched)
        second = '' if self.lockstep else self._heard.second_source()
        if second:
            return DiagnosticStatus.ERROR, second, values
        if not self.active:
            return DiagnosticStatus.WARN, 'inactive: brakes on', values
        if not self.started:
            return DiagnosticStatus.WARN, 'brakes on, waiting for a command', values
        if self.drives.timed_out:
            return (DiagnosticStatus.ERROR,
                    f'no commands: {self.settings.timeout_action} torque', values)
        return DiagnosticStatus.OK, 'running', values
