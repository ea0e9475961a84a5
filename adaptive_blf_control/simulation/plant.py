# SPDX-License-Identifier: Apache-2.0
"""The simulated arm: true dynamics, drives that saturate, torque held between changes."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from adaptive_blf_control.arms.arm import ForwardDynamics
from adaptive_blf_control.control.law import limited
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.simulation.sensors import Measurement, Sensors
from adaptive_blf_control.simulation.settings import SensorSettings
from adaptive_blf_control.simulation.truth_fit import TruthFit

__all__ = ['Epoch', 'HasFit', 'HasInverseDynamics', 'HasTruth', 'Plant', 'REQUIRED',
           'SimulatedArm', 'Truth', 'known_truth', 'truth_of', 'unexpressed_by']

_EXACT = 1e-6  # part of a torque under which a fit of theta* counts as exact


class Epoch(NamedTuple):
    """The true arm from ``t`` [s] on: its dynamics, and θ* by parameter name."""

    t: float
    dynamics: ForwardDynamics
    parameters: Mapping[str, float]


Truth = tuple[tuple[float, np.ndarray], ...]
"""(t, θ*) from t [s] on, in ascending order from 0, θ* of shape (m,)."""


class Plant(Protocol):
    """What the driver and `simulate` drive: an arm of ours or a foreign simulator.

    It needs no θ*. What it can do besides, it says by having the method: :class:`HasTruth`.
    A class that inherits from it needs no more than q, qd, torque and ``advance``: it is measured
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
        """Return what the sensors show of q now, shape (n,) [rad]; it is no sample."""
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
class HasInverseDynamics(Protocol):
    """A plant that tells the torque of a motion, whatever its parameters are."""

    def inverse_dynamics(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray,
                         t: float | None = None) -> np.ndarray:
        """Return τ of a motion (q, q̇, q̈) at time ``t`` [s], now where None, shape (n,) [N·m]."""
        ...


@runtime_checkable
class HasFit(Protocol):
    """A plant whose θ* is a fit to its inverse dynamics."""

    def fits(self, parameters: Sequence[str]) -> Sequence[TruthFit]:
        """Return the fit of each epoch of :meth:`HasTruth.truth`."""
        ...


def unexpressed_by(plant: Plant, parameters: Sequence[str]) -> np.ndarray | None:
    """Return the part of each joint's torque that no θ expresses, at worst over time.

    Returns:
        Shape (n,); None where θ* is exact or not known.
    """
    if not isinstance(plant, HasFit):
        return None
    worst = np.max([fit.unexpressed for fit in plant.fits(parameters)], axis=0)
    return worst if np.any(worst > _EXACT) else None


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


class SimulatedArm:
    """State (3) of the true arm, advanced with RK4 under the torque last applied.

    Attributes:
        q: True positions, shape (n,) [rad].
        qd: True velocities, shape (n,) [rad/s].
        t: Time since the start [s].
        torque: Torque that acts now, after saturation and dead time, shape (n,) [N·m].
    """

    def __init__(self, epochs: Sequence[Epoch], q: np.ndarray, qd: np.ndarray,
                 torque_limit: np.ndarray, substeps: int = 1, sensors: Sensors | None = None,
                 dead_time: int = 0) -> None:
        """Start at rest or in motion with zero torque.

        Args:
            epochs: The true arm over time, the first from t = 0 on.
            q: Positions, shape (n,) [rad].
            qd: Velocities, shape (n,) [rad/s].
            torque_limit: Where the drives saturate, shape (n,) [N·m].
            substeps: RK4 steps per advance.
            sensors: How the state is measured; None measures perfectly.
            dead_time: Whole samples after which a command acts.
        """
        for name, value in (('initial_position', q), ('initial_velocity', qd)):
            if not np.all(np.isfinite(value)):
                raise ParameterError(f'arm_driver.{name}', value.tolist(), 'finite values')
        self.epochs = tuple(epochs)
        self._ahead = deque(self.epochs[1:])
        self._dynamics = self.epochs[0].dynamics
        self.q = np.array(q, dtype=float)
        self.qd = np.array(qd, dtype=float)
        self.t = 0.0
        self.torque_limit = np.array(torque_limit, dtype=float)
        self.torque = np.zeros_like(self.q)
        self._substeps = substeps
        self._sensors = sensors or Sensors(SensorSettings())
        self._dead_time = dead_time
        self._commanded = self.torque
        self._underway: deque[np.ndarray] = deque(
            [self.torque] * max(dead_time - 1, 0))

    def truth(self, parameters: Sequence[str]) -> Truth:
        """Return (t, θ*) of each epoch in the order of ``parameters``, for monitors only.

        An effect the true arm does not have counts as 0.
        """
        return tuple((epoch.t, np.array([epoch.parameters.get(name, 0.0) for name in parameters]))
                     for epoch in self.epochs)

    def measure(self, torque: np.ndarray, dt: float) -> Measurement:
        """Take a sample ``dt`` [s] after the last one; call it once a sample.

        Args:
            torque: Mean torque over the interval that ends now, shape (n,) [N·m].
            dt: Length of that interval [s].
        """
        if self._dead_time:
            self._underway.append(self._commanded)
            self.torque = self._underway.popleft()
        return self._sensors.measure(self.q, self.qd, torque, dt)

    def measured_position(self) -> np.ndarray:
        """Return what the sensors show of q now, shape (n,) [rad]; it is no sample."""
        return self._sensors.position(self.q)

    def apply(self, torque: np.ndarray) -> None:
        """Command ``torque``, shape (n,) [N·m], clipped to the drives' limit, and hold it."""
        self._commanded = limited(torque, self.torque_limit)
        if not self._dead_time:
            self.torque = self._commanded

    def advance(self, dt: float) -> None:
        """Move on by ``dt`` [s] under the held torque; changes act from the next advance on."""
        while self._ahead and self.t >= self._ahead[0].t - 1e-9:
            self._dynamics = self._ahead.popleft().dynamics
        self.q, self.qd = self._dynamics.advance(self.q, self.qd, self.torque, dt,
                                                 self._substeps)
        self.t += dt

    def retune(self, other: SimulatedArm) -> None:
        """Become ``other`` but for state and time: another payload, limit, sensor or dead time.

        The sensors go on as they are where their settings do not change.
        """
        self.epochs = other.epochs
        passed = sum(epoch.t <= self.t + 1e-9 for epoch in other.epochs[1:])
        self._dynamics = other.epochs[passed].dynamics
        self._ahead = deque(other.epochs[passed + 1:])
        self.torque_limit = other.torque_limit
        self._substeps = other._substeps
        if other._sensors.settings != self._sensors.settings:
            self._sensors = other._sensors
        if other._dead_time != self._dead_time:
            self._dead_time = other._dead_time
            self._underway = deque([self._commanded] * max(other._dead_time - 1, 0))
        self.apply(self._commanded)

    def brake(self) -> None:
        """Hold the arm where it is, without torque."""
        self.qd = np.zeros_like(self.qd)
        self.apply(self.qd)

    def trial(self, torque: np.ndarray, dt: float) -> None:
        """Compute a step without taking it, e.g. to compile it before the clock runs."""
        self._dynamics.advance(self.q, self.qd, limited(torque, self.torque_limit), dt,
                               self._substeps)
