# SPDX-License-Identifier: Apache-2.0
"""What is driven: the protocol of a plant, and the simulated arm behind it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arms.integrator import CompiledDynamics
from adaptive_blf_control.control.law import limited
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.parameters.guided import Guided
from adaptive_blf_control.parameters.settings import changed_names
from adaptive_blf_control.simulation.actuators import ActuatorArrays, idle_actuators
from adaptive_blf_control.simulation.delay_line import delayed, new_delay_line
from adaptive_blf_control.simulation.pushes import Links, PushArrays
from adaptive_blf_control.simulation.sensors import made_sensor, Measurement, Sensor
from adaptive_blf_control.simulation.settings import PlantSettings
from adaptive_blf_control.simulation.step import PlantArrays, ROUNDING
from adaptive_blf_control.simulation.true_arm import epochs_truth, true_epochs, Truth

__all__ = ['HasTruth', 'Plant', 'REQUIRED', 'Retunable', 'SimulatedArm', 'known_truth',
           'truth_of']

# First letters of the parameters that make the true arm; true friction is part of the arm.
TRUE_ARM = ('true_model', 'true_parameters', 'payload', 'schedule.')


class Plant(Protocol):
    """What the driver and `simulate` drive: our simulated arm, or a simulator of the user's.

    It needs no θ*, and it has sensors of its own. Optional abilities are methods that it may have:
    ``truth`` (`HasTruth`), ``retune`` (`Retunable`) and those of `simulation.abilities`. A class
    that inherits from it needs no more than q, qd, torque and ``advance``: it is measured
    perfectly.

    Attributes:
        q: True positions, shape (n,) [rad].
        qd: True velocities, shape (n,) [rad/s].
        torque: Torque that acts now, shape (n,) [N·m].
    """

    q: np.ndarray
    qd: np.ndarray
    torque: np.ndarray

    def measure(self, torque: np.ndarray, dt: float) -> Measurement:
        """Return what the sensors show, once a sample.

        Args:
            torque: Mean torque over the interval that ends now, shape (n,) [N·m].
            dt: Length of that interval [s], 0 for the first sample.
        """
        return Measurement(self.q, self.qd, torque)

    def measured_position(self) -> np.ndarray:
        """Return what the sensors show of q now, shape (n,) [rad], without taking a sample."""
        return self.q

    def apply(self, torque: np.ndarray) -> None:
        """Command a torque, shape (n,) [N·m], and hold it."""
        self.torque = torque

    @abstractmethod
    def advance(self, dt: float) -> None:
        """Move on by ``dt`` [s] under the torque that is held."""
        ...

    def brake(self) -> None:
        """Hold the arm where it is, without torque."""
        self.qd, self.torque = np.zeros_like(self.qd), np.zeros_like(self.torque)


REQUIRED = ('q', 'qd', 'torque', 'measure', 'measured_position', 'apply', 'advance', 'brake')
"""What a part has to have to be a `Plant`."""


@runtime_checkable
class HasTruth(Protocol):
    """A plant whose θ* is known."""

    def truth(self, parameters: Sequence[str]) -> Truth:
        """Return (t, θ*) over time in the order of ``parameters``, for monitors only."""
        ...


@runtime_checkable
class Retunable(Protocol):
    """A plant that can be changed while it runs."""

    def retune(self, settings: PlantSettings) -> None:
        """Take other settings between two samples, all of them or, with a BlfError, none."""
        ...


def truth_of(plant: Plant, parameters: Sequence[str]) -> Truth | None:
    """Return θ* of a plant over time, None where it has none to tell."""
    return plant.truth(parameters) if isinstance(plant, HasTruth) else None


def known_truth(plant: Plant, parameters: Sequence[str]) -> Truth:
    """Return θ* of a plant over time; ParameterError where it has none to tell."""
    truth = truth_of(plant, parameters)
    if truth is None:
        raise ParameterError('arm_driver.plant', type(plant).__name__,
                             'a plant whose theta* is known')
    return truth


_INSTEAD = {
    **dict.fromkeys(('theta', 'theta_star', 'theta_true', 'true_theta', 'parameters', 'nominal',
                     'true_parameters'), 'truth() has (t, theta) over time'),
    **dict.fromkeys(('payload', 'true_friction', 'initial_position'),
                    'settings has what it was made with'),
    'settings =': 'retune(settings.replace(payload=2.0)) changes them'}


class SimulatedArm(Guided, instead=_INSTEAD):
    """State (3) of the true arm, advanced with RK4 under the torque last applied.

    Attributes:
        q: True positions, shape (n,) [rad].
        qd: True velocities, shape (n,) [rad/s].
        t: Time since the start [s].
        torque: Torque that acts now, after saturation and dead time, shape (n,) [N·m].
        settings: The present settings; :meth:`retune` changes them.
        epochs: The true arm over time, the first from t = 0 on.
        sensor: How the state is measured.
    """

    _settable = ('q', 'qd', 't', 'torque', 'epochs', 'sensor', 'torque_limit')
    settings: PlantSettings

    def __init__(self, settings: PlantSettings, arm: Arm,
                 sensor: Sensor | type[Sensor] | None = None) -> None:
        """Start where the settings say, with zero torque.

        Args:
            settings: True parameters and their changes, start, limits, dead time, sensors.
            arm: The arm.
            sensor: In place of the sensor that the settings name.

        Raises:
            ParameterError: a value does not fit the arm, or the sensor cannot be made.
            ArmError: the arm cannot be simulated with its true parameters.
        """
        settings = settings.resolved(joints=arm.n)
        self._arm, self._given_sensor = arm, sensor
        self.epochs, self._epoch = true_epochs(settings, arm), 0
        self.sensor = made_sensor(settings.sensors, arm, sensor)
        self.q, self.qd = settings.initial_position.copy(), settings.initial_velocity.copy()
        self.t = 0.0
        self.torque = self._commanded = np.zeros(arm.n)
        self._idle, self._unpushed = idle_actuators(arm.n), Links(arm).pushed(())
        self._take(settings)

    def __repr__(self) -> str:
        """Name the arm and the time."""
        return f'<{type(self).__name__} of {self._arm!r} at {self.t:.4g} s>'

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of its arrays."""
        return self._arm.joints

    def _take(self, settings: PlantSettings) -> None:
        """Take limit and dead time; what was commanded last is under way for that long."""
        vars(self)['settings'] = settings  # refused where a program sets it, see `Guided`
        self.torque_limit = settings.torque_limit.copy()  # the limit is compiled for such
        self._line = new_delay_line(max(settings.dead_time, 1), self._commanded)

    def truth(self, parameters: Sequence[str] | None = None) -> Truth:
        """Return (t, θ*) of each epoch, for monitors only.

        Args:
            parameters: Names in the order that is wanted; those of the arm where None.
        """
        return epochs_truth(self.epochs,
                            self._arm.parameters if parameters is None else parameters)

    def measure(self, torque: np.ndarray, dt: float) -> Measurement:
        """Take a sample ``dt`` [s] after the last one; call it once a sample.

        Args:
            torque: Mean torque over the interval that ends now, shape (n,) [N·m].
            dt: Length of that interval [s].
        """
        if self.settings.dead_time:
            self.torque = np.empty_like(self._commanded)
            delayed(self._line, self._commanded, self.torque)
        return self.sensor.measure(self.q, self.qd, torque, dt)

    def measured_position(self) -> np.ndarray:
        """Return what the sensors show of q now, shape (n,) [rad], without taking a sample."""
        return self.sensor.position(self.q)

    def apply(self, torque: np.ndarray) -> None:
        """Command ``torque``, shape (n,) [N·m], clipped to the drives' limit, and hold it."""
        self._commanded = limited(torque, self.torque_limit)
        if not self.settings.dead_time:
            self.torque = self._commanded

    def advance(self, dt: float) -> None:
        """Move on by ``dt`` [s] under the held torque; changes act from the next advance on."""
        self.enter_epoch()
        self.q, self.qd = self.epochs[self._epoch].dynamics.advance(
            self.q, self.qd, self.torque, dt, self.settings.substeps)
        self.t += dt

    def enter_epoch(self) -> None:
        """Be the true arm of now; :meth:`advance` begins with it."""
        following = self._epoch + 1
        while following < len(self.epochs) and self.t >= self.epochs[following].t - ROUNDING:
            self._epoch, following = following, following + 1

    def retune(self, settings: PlantSettings) -> None:
        """Take another payload, limit, sensor or dead time; state and time stay.

        Sensors whose settings do not change go on as they are, and so do commands under way.

        Raises:
            ParameterError: a value cannot be used; nothing has changed.
            ArmError: likewise.
        """
        before, settings = self.settings, settings.resolved(joints=self._arm.n)
        changed = changed_names(before, settings)
        if any(name.startswith(TRUE_ARM) for name in changed):
            epochs = true_epochs(settings, self._arm)
        else:
            epochs = self.epochs
        if settings.sensors != before.sensors:
            self.sensor = made_sensor(settings.sensors, self._arm, self._given_sensor)
        if epochs is not self.epochs:
            self.epochs, self._epoch = epochs, 0
        line = self._line
        self._take(settings)
        if settings.dead_time == before.dead_time:
            self._line = line
        self.apply(self._commanded)

    def brake(self) -> None:
        """Hold the arm where it is, without torque."""
        self.qd = np.zeros_like(self.qd)
        self.apply(self.qd)

    def arrays(self, samples: int = 0) -> PlantArrays | None:
        """Return a copy as `plant_step` takes it; None where the true arm has no arrays.

        It holds until the true arm changes, see :meth:`steady`. The commands under way are shared.

        Args:
            samples: How many it is for.
        """
        if type(self) is not SimulatedArm:
            return None
        return self._arrays(False, self._idle._replace(
            acting=self.torque.copy(), commanded=self._commanded.copy(), limit=self.torque_limit,
            waits=self.settings.dead_time > 0, line=self._line), self._unpushed)

    def _arrays(self, actuated: bool, actuators: ActuatorArrays,
                pushes: PushArrays) -> PlantArrays | None:
        self.enter_epoch()
        dynamics = self.epochs[self._epoch].dynamics
        if not isinstance(dynamics, CompiledDynamics):
            return None
        return PlantArrays(dynamics.arm, self.q.copy(), self.qd.copy(), np.array([self.t]),
                           self.settings.substeps, actuated, actuators, pushes)

    def steady(self, samples: int, dt: float) -> int:
        """Return how many of the next steps of ``dt`` [s] are steps of the present true arm."""
        following = self._epoch + 1
        if following >= len(self.epochs):
            return samples
        times = np.add.accumulate(np.concatenate([[self.t], np.full(samples - 1, dt)]))
        return max(int(np.searchsorted(times, self.epochs[following].t - ROUNDING)), 1)

    def take(self, arrays: PlantArrays) -> None:
        """Go on from what the steps have done to `arrays`."""
        self.q, self.qd, self.t = arrays.q, arrays.qd, float(arrays.clock[0])
        self.torque, self._commanded = arrays.actuators.acting, arrays.actuators.commanded

    def trial(self, torque: np.ndarray, dt: float) -> None:
        """Compute a step without taking it, e.g. to compile it before the clock runs."""
        self.epochs[self._epoch].dynamics.advance(
            self.q, self.qd, limited(torque, self.torque_limit), dt, self.settings.substeps)
