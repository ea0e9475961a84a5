# SPDX-License-Identifier: Apache-2.0
"""The simulated arm behind actuators, and pushed from outside."""

from __future__ import annotations

import math

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.simulation.actuators import Actuators
from adaptive_blf_control.simulation.plant import ROUNDING, SimulatedArm
from adaptive_blf_control.simulation.schedule import changes_of
from adaptive_blf_control.simulation.sensors import Measurement, Sensor
from adaptive_blf_control.simulation.settings import ActuatorSettings, PlantSettings
from adaptive_blf_control.simulation.targets import pushes, timed_pushes
from adaptive_blf_control.simulation.wrenches import UrdfLinks, Wrenches

__all__ = ['ActuatedArm', 'arm_alone', 'is_actuated']


def is_actuated(settings: PlantSettings) -> bool:
    """Return whether an arm needs actuators, or is pushed."""
    return settings.actuator != ActuatorSettings() or any(map(pushes, settings.schedule.parameter))


def arm_alone(settings: PlantSettings) -> PlantSettings:
    """Return the settings with those changes alone that are changes of the arm itself."""
    own = [change for change in changes_of(settings.schedule) if not pushes(change.name)]
    times, names, values = zip(*own) if own else ([0.0], [''], [0.0])
    return settings.replace(schedule={'time': list(times), 'parameter': list(names),
                                      'value': list(values)})


class ActuatedArm(SimulatedArm):
    """A `SimulatedArm` whose commands act late, with a wrong gain, and beside other forces."""

    def __init__(self, settings: PlantSettings, arm: Arm,
                 sensor: Sensor | type[Sensor] | None = None) -> None:
        """Start where the settings say; see `SimulatedArm`.

        Raises:
            ParameterError: besides, a link is not known.
        """
        self._links = UrdfLinks(arm)
        self._pushes = timed_pushes(changes_of(settings.schedule), self._links.names)
        super().__init__(arm_alone(settings), arm, sensor)
        self._wrenches, self._done = Wrenches(), 0
        self._actuators = Actuators(self.settings)

    def measure(self, torque: np.ndarray, dt: float) -> Measurement:
        """Take a sample; the torque is what the actuators measure, but for an interval of 0 s."""
        measured = self._actuators.sample(self.t)
        self.torque = self._actuators.torque
        return self.sensor.measure(self.q, self.qd, measured if dt > 0.0 else torque, dt)

    def apply(self, torque: np.ndarray) -> None:
        """Command a torque, shape (n,) [N·m]; it acts after the delay of the actuators."""
        self._commanded = torque
        self._actuators.command(self.t, torque)
        self.torque = self._actuators.torque

    def advance(self, dt: float) -> None:
        """Move on by ``dt`` [s], exactly to each command and each force that comes to act."""
        left = dt
        while left > ROUNDING:
            self._let_act()
            following = self._pushes[self._done:]
            switch = min(self._actuators.next_switch, following[0].t if following else math.inf)
            span = min(left, switch - self.t)
            self._move(span)
            left -= span
        self._let_act()

    def _let_act(self) -> None:
        """Let act what is due now."""
        while self._done < len(self._pushes) and self._pushes[self._done].t <= self.t + ROUNDING:
            push = self._pushes[self._done]
            self._wrenches.set(push.target, push.value)
            self._done += 1
        self._actuators.advance_to(self.t + ROUNDING)
        self.torque = self._actuators.torque

    def _move(self, span: float) -> None:
        """Move on by ``span`` [s]; the torques of command and forces are held."""
        acting = self.torque
        if self._wrenches.by_link:
            self.torque = acting + self._links.torque(self.q, self._wrenches)
        super().advance(span)
        self.torque = acting
        self._actuators.act(span)

    def retune(self, settings: PlantSettings) -> None:
        """Take another payload, schedule, limit or sensor; see `SimulatedArm.retune`."""
        following = timed_pushes(changes_of(settings.schedule), self._links.names)
        super().retune(arm_alone(settings))
        self._actuators.retune(self.settings)
        self._pushes, self._wrenches, self._done = following, Wrenches(), 0
        self._let_act()

    def brake(self) -> None:
        """Hold the arm where it is, without torque."""
        self._actuators.stop()
        self.qd, self.torque = np.zeros_like(self.qd), self._actuators.torque
