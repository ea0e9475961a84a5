# SPDX-License-Identifier: Apache-2.0
"""Driver, controller and identifier joined in lockstep without ROS.

The order within a sample is that of the nodes: the controller answers the state with the θ̂ of the
last sample, the identifier advances θ̂ with the adaptation term of the last sample (the one that
was held over the interval that ends now), then the arm moves on under the new torque.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import time
from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arrays import checked_array, checked_finite
from adaptive_blf_control.control.controller import Controller, ControlOutput
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.parameters.plugin import require
from adaptive_blf_control.simulation.plant import Plant, REQUIRED, SimulatedArm
from adaptive_blf_control.simulation.sensors import Measurement

__all__ = ['ClosedLoop', 'Sample', 'Trace', 'sample_time']


def sample_time(k: int, period: float) -> float:
    """Return the time of sample k [s], that of a stamp in whole nanoseconds.

    A node that gets the stamp computes the very same double from it.
    """
    return round(k * period * 1e9) * 1e-9


class Sample(NamedTuple):
    """One sample of the loop: the measured state and what the nodes answer to it.

    Attributes:
        t: Time since the start [s].
        measured: The state as the sensors show it.
        output: The controller's answer.
        theta_used: θ it was computed with, shape (m,).
        theta_hat: The identifier's answer, shape (m,).
        rank: Rank of the history.
        sigma_min: σ_min of the history.
    """

    t: float
    measured: Measurement
    output: ControlOutput
    theta_used: np.ndarray
    theta_hat: np.ndarray
    rank: int
    sigma_min: float


@dataclass(frozen=True)
class Trace:
    """A run as arrays over N samples.

    t (N,) [s]; q, e1 (N, n) [rad] and qd (N, n) [rad/s], the true ones; torque (N, n) [N·m];
    theta_hat (N, m); rank and σ_min (N,).
    """

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    e1: np.ndarray
    torque: np.ndarray
    theta_hat: np.ndarray
    rank: np.ndarray
    sigma_min: np.ndarray
    wall_s: float


class ClosedLoop:
    """The whole path on one thread: the same objects that run in the nodes."""

    def __init__(self, plant: Plant, controller: Controller, identifier: Identifier | None = None,
                 period: float = 0.001, initial_estimate: Any = None, known: bool = False,
                 ) -> None:
        """Join the parts.

        Args:
            plant: What is driven.
            controller: The law.
            identifier: Learns along; one of the controller's arm with the defaults where None.
            period: Sample interval [s].
            initial_estimate: θ the controller starts with, shape (m,); the identifier's where
                None.
            known: The controller keeps that θ and never hears the identifier (34).

        Raises:
            ParameterError: the plant lacks what a plant needs, or a value cannot be used.
        """
        require('plant', plant, plant, REQUIRED)
        require('controller', controller, controller, ('arm', 'reference', 'update'))
        self.plant = plant
        self.controller = controller
        self.identifier = Identifier(controller.arm) if identifier is None else identifier
        require('identifier', identifier, self.identifier, ('arm', 'theta', 'stack', 'update'))
        self.period = checked_finite('period', period, 'a time > 0 s', above=0.0)
        arm = controller.arm
        self._initial_estimate = (
            self.identifier.theta if initial_estimate is None else checked_array(
                'initial_estimate', initial_estimate, (arm.m,), arm.parameters))
        self._known = known

    @property
    def initial_estimate(self) -> np.ndarray:
        """θ the controller starts with, shape (m,)."""
        return self._initial_estimate

    @property
    def known(self) -> np.ndarray | None:
        """θ that the controller keeps (34), shape (m,); None where it hears the identifier."""
        return self._initial_estimate if self._known else None

    @property
    def arm(self) -> Arm:
        """The arm that controller and identifier know."""
        return self.controller.arm

    def warm_up(self) -> None:
        """Compile everything on throw-away objects, so that a run starts at full speed."""
        self.controller.warm_up(self._initial_estimate)
        self.identifier.warm_up()
        if isinstance(self.plant, SimulatedArm):
            self.plant.trial(np.zeros(self.arm.n), self.period)

    def run(self, duration: float, observer: Callable[[Sample], None] | None = None) -> Trace:
        """Run for ``duration`` [s] of arm time and return the trace.

        Args:
            duration: Length of the run [s]; the sample at its end is included.
            observer: Called with every sample, e.g. to write a bag.
        """
        steps, plant = self._steps(duration), self.plant
        q, qd, e1, torque = (np.empty((steps, self.arm.n)) for _ in range(4))
        t, theta_hat = np.empty(steps), np.empty((steps, self.arm.m))
        rank, sigma_min = np.empty(steps, dtype=int), np.empty(steps)
        begin = time.perf_counter()  # duration of the computation, not a time of the logic
        for k, sample in enumerate(self.samples(duration)):
            q[k], qd[k], e1[k] = plant.q, plant.qd, plant.q - sample.output.reference.position
            t[k], torque[k], theta_hat[k] = sample.t, sample.output.torque, sample.theta_hat
            rank[k], sigma_min[k] = sample.rank, sample.sigma_min
            if observer is not None:
                observer(sample)
        wall = time.perf_counter() - begin
        return Trace(t, q, qd, e1, torque, theta_hat, rank, sigma_min, wall)

    def samples(self, duration: float) -> Iterator[Sample]:
        """Run for ``duration`` [s] of arm time, the sample at its end included; store nothing.

        Yields:
            Each sample, before the plant moves on.
        """
        plant, controller, identifier = self.plant, self.controller, self.identifier
        theta, term = self._initial_estimate, np.zeros(self.arm.m)
        for k in range(self._steps(duration)):
            t = sample_time(k, self.period)
            measured = plant.measure(plant.torque, self.period if k else 0.0)
            output = controller.update(t, measured.q, measured.qd, theta, measured.torque)
            estimate = identifier.update(t, *measured, term)
            term = output.adaptation_term
            stack = identifier.stack
            yield Sample(t, measured, output, theta, estimate, stack.rank, stack.sigma_min)
            theta = theta if self._known else estimate
            plant.apply(output.torque)
            plant.advance(self.period)

    def _steps(self, duration: float) -> int:
        return int(round(duration / self.period)) + 1
