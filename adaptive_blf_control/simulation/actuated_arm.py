# SPDX-License-Identifier: Apache-2.0
"""The simulated arm behind actuators, and pushed from outside."""

from __future__ import annotations

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.simulation.actuators import Actuators
from adaptive_blf_control.simulation.plant import SimulatedArm
from adaptive_blf_control.simulation.pushes import add_push_torque, Links
from adaptive_blf_control.simulation.schedule import changes_of
from adaptive_blf_control.simulation.sensors import Measurement, Sensor
from adaptive_blf_control.simulation.settings import ActuatorSettings, PlantSettings
from adaptive_blf_control.simulation.step import begin_span, PlantArrays, ROUNDING
from adaptive_blf_control.simulation.targets import pushes, timed_pushes

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
        self._links = Links(arm)
        changes = timed_pushes(changes_of(settings.schedule), self._links.names)
        super().__init__(arm_alone(settings), arm, sensor)
        self._actuators = Actuators(self.settings)
        self._pushes = self._links.pushed(changes)

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
        """Move on by ``dt`` [s], exactly to each command and each force that comes to act.

        Other changes act from the next advance on.
        """
        self.enter_epoch()
        left, dynamics, substeps = dt, self.epochs[self._epoch].dynamics, self.settings.substeps
        while left > ROUNDING:
            span = self._begin_span(left)
            self.q, self.qd = dynamics.advance(self.q, self.qd, self._torque_with_pushes(), span,
                                               substeps)
            self._actuators.act(span)
            self.t += span
            left -= span
        self._begin_span(0.0)
        self.torque = self._actuators.torque

    def _begin_span(self, left: float) -> float:
        return begin_span(self._actuators.arrays, self._pushes, self.t, left)

    def _torque_with_pushes(self) -> np.ndarray:
        torque = self._actuators.torque
        if self._pushes.wrenches.any():
            add_push_torque(self._pushes, self.q, torque)
        return torque

    def retune(self, settings: PlantSettings) -> None:
        """Take another payload, schedule, limit or sensor; see `SimulatedArm.retune`."""
        following = timed_pushes(changes_of(settings.schedule), self._links.names)
        super().retune(arm_alone(settings))
        self._actuators.retune(self.settings)
        self._pushes = self._links.pushed(following)
        self._begin_span(0.0)
        self.torque = self._actuators.torque

    def brake(self) -> None:
        """Hold the arm where it is, without torque."""
        self._actuators.stop()
        self.qd, self.torque = np.zeros_like(self.qd), self._actuators.torque

    def arrays(self, samples: int = 0) -> PlantArrays | None:
        """Return a copy as `plant_step` takes it; actuators and pushes are shared."""
        if type(self) is not ActuatedArm:
            return None
        self._actuators.reserve(samples)
        return self._arrays(True, self._actuators.arrays, self._pushes)

    def take(self, arrays: PlantArrays) -> None:
        """Go on from what the steps have done to `arrays`."""
        super().take(arrays)
        self.torque = self._actuators.torque
        self._commanded = self._actuators.arrays.commanded

    def trial(self, torque: np.ndarray, dt: float) -> None:
        """Compute a step without taking it, see `SimulatedArm.trial`."""
        super().trial(torque, dt)
        add_push_torque(self._pushes, self.q, torque.copy())
