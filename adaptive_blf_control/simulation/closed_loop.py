# SPDX-License-Identifier: Apache-2.0
"""Driver, controller and identifier joined in lockstep without ROS.

The order within a sample is that of the nodes: the controller answers the state with the θ̂ of the
last sample, the identifier advances θ̂ with the adaptation term of the last sample (the one that
was held over the interval that ends now), then the arm moves on under the new torque.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
import time
from typing import Any

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.arrays import checked_array, checked_finite, checked_theta
from adaptive_blf_control.calls import checked_call
from adaptive_blf_control.control.controller import Controller
from adaptive_blf_control.control.safety_filter import narrow
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification.identifier import Identifier
from adaptive_blf_control.limits.set_estimator import SetEstimator
from adaptive_blf_control.parameters.guided import Guided
from adaptive_blf_control.parameters.plugin import require, require_call
from adaptive_blf_control.simulation.block import trace_rows, TraceRows
from adaptive_blf_control.simulation.block_run import BlockRun, LoopParts, parts_in_python
from adaptive_blf_control.simulation.failure import Failure, failure_at, first_failure
from adaptive_blf_control.simulation.plant import Plant, REQUIRED, SimulatedArm
from adaptive_blf_control.simulation.sample import Sample, sample_time, sample_times
from adaptive_blf_control.simulation.sensors import Measurement
from adaptive_blf_control.time_units import unit_of_period, UNITS

__all__ = ['ClosedLoop', 'Trace']

_DURATION = 'a time >= 0 s'


@dataclass(frozen=True, eq=False)
class Trace:
    """A run as arrays over N samples.

    t (N,) [s]; q, e1 (N, n) [rad] and qd (N, n) [rad/s], the true ones; torque (N, n) [N·m];
    theta_hat (N, m); rank and σ_min (N,); measured, what the sensors showed, (N, n) each.
    ``torque`` is the command that is held *from* t on, ``measured.torque`` the mean over the
    interval that *ends* at t, as in every log. ``in_python`` names the parts for which it went
    sample by sample; it is empty where whole blocks ran as one compiled function. ``failure`` is
    the first state or torque that is not finite.
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
    in_python: tuple[str, ...]
    measured: Measurement = field(kw_only=True)
    failure: Failure | None = field(default=None, kw_only=True)


class ClosedLoop(Guided, instead={'step': 'samples(duration) yields sample after sample'}):
    """The whole path on one thread: the same objects that run in the nodes.

    Attributes:
        sample_by_sample: Whether :meth:`run` calls its observer before the loop goes on, for one
            that looks at the parts; the loop then runs no blocks.
    """

    _settable = ('sample_by_sample', 'plant', 'controller', 'identifier')

    @checked_call
    def __init__(self, plant: Plant, controller: Controller, identifier: Identifier | None = None,
                 period: float = 0.001, initial_estimate: Any = None, known: bool = False,
                 set_estimator: SetEstimator | None = None) -> None:
        """Join the parts.

        Args:
            plant: What is driven.
            controller: The law.
            identifier: Learns along; one of the controller's arm with the defaults where None.
            period: Sample interval [s].
            initial_estimate: θ the controller starts with, shape (m,), or by name; the
                identifier's where None.
            known: The controller keeps that θ and never hears the identifier (34).
            set_estimator: Narrows the prior of a safety filter that learns; None where none does.

        Raises:
            ParameterError: the plant lacks what a plant needs, plant or identifier is of other
                joints than the controller, or of the same in another order, or a value cannot be
                used.
        """
        if hasattr(plant, 'Y1') or hasattr(plant, 'acceleration'):
            raise ParameterError('plant', plant, 'what moves under torques: simulate(arm) drives '
                                 'a simulated arm, a class that inherits from Plant your own')
        require('plant', plant, plant, REQUIRED, 'Plant')
        require_call('plant', plant, plant, 'advance', 'dt')
        require('controller', controller, controller, ('arm', 'reference', 'update'))
        self.plant = plant
        self.controller = controller
        self.identifier = Identifier(controller.arm) if identifier is None else identifier
        require('identifier', identifier, self.identifier, ('arm', 'theta', 'stack', 'update'))
        self.period = checked_finite('period', period, 'a time > 0 s', above=0.0)
        if not known:
            _check_period(self.period, self.identifier)
        arm = controller.arm
        _check_same('identifier', self.identifier, 'joints', self.identifier.arm, arm)
        _check_same('identifier', self.identifier, 'parameters', self.identifier.arm, arm)
        _check_same('plant', plant, 'joints', plant, arm)
        for name in ('q', 'qd', 'torque'):
            checked_array(f'plant.{name}', getattr(plant, name), (arm.n,), arm.joints)
        self._initial_estimate = (
            self.identifier.theta.copy() if initial_estimate is None else checked_theta(
                'initial_estimate', initial_estimate, arm.parameters))
        self._known = known
        self._set_estimator = set_estimator
        self.sample_by_sample = False

    def __repr__(self) -> str:
        """Name the parts and the rate."""
        parts = ', '.join(type(part).__name__ for part in (
            self.plant, self.controller, self.identifier))
        return f'<ClosedLoop of {parts} for {self.arm!r} at {1.0 / self.period:g} Hz>'

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

    @property
    def _parts(self) -> LoopParts:
        return LoopParts(self.plant, self.controller, self.identifier, self.period,
                         self._initial_estimate, self._known)

    @property
    def in_python(self) -> tuple[str, ...]:
        """The parts for which it goes sample by sample, see `Trace`."""
        return parts_in_python(self._parts)

    def check_start(self) -> None:
        """Raise SetViolation where the plant is not inside the sets in which the motion begins.

        ``controller.begin(plant.q, plant.qd)`` begins it where the plant is.
        """
        check = getattr(self.controller, 'check_start', None)
        if check is not None:  # another controller than ours may have no sets
            check(self.plant.measured_position(), self.plant.qd)

    def warm_up(self) -> None:
        """Compile everything on throw-away objects, so that a run starts at full speed."""
        if self.in_python:
            self.warm_up_parts()
        else:
            BlockRun(self._parts).warm_up()

    def warm_up_parts(self) -> None:
        """Compile what the parts call one sample at a time, as the nodes do."""
        self.controller.warm_up(self._initial_estimate)
        self.identifier.warm_up()
        if isinstance(self.plant, SimulatedArm):
            self.plant.trial(np.zeros(self.arm.n), self.period)

    def run(self, duration: float, observer: Callable[[Sample], None] | None = None) -> Trace:
        """Run for ``duration`` [s] of arm time and return the trace.

        Where every part is ours, whole blocks of samples run in one compiled function, and the
        observer is called with those of a block after it; else it goes sample by sample. To
        change a part while the loop runs, use `samples`.

        Args:
            duration: Length of the run [s]; the sample at its end is included.
            observer: Called with every sample, e.g. to write a bag.

        Raises:
            ParameterError: the duration cannot be used.
            SetViolation: the plant is not inside the sets in which the motion begins.
        """
        self.check_start()
        times = sample_times(self._steps(duration), self.period)
        rows = trace_rows(times.size, self.arm.n, self.arm.m)
        begin = time.perf_counter()  # duration of the computation, not a time of the logic
        in_python, failure = self.in_python, None
        if in_python or self.sample_by_sample:
            failure = self._run_by_samples(duration, rows, observer)
        else:
            BlockRun(self._parts).run(times, rows, observer)
        seconds = time.perf_counter() - begin
        state = first_failure(times, self.arm.joints,
                              (('position', rows.q), ('velocity', rows.qd)))
        if failure is None or (state is not None and state.t <= failure.t):
            failure = state  # a law that is asked about no number is not to blame
        return Trace(times, rows.q, rows.qd, rows.e1, rows.torque, rows.theta_hat, rows.rank,
                     rows.sigma_min, seconds, in_python, measured=rows.measured, failure=failure)

    def _run_by_samples(self, duration: float, rows: TraceRows,
                        observer: Callable[[Sample], None] | None) -> Failure | None:
        plant, failure = self.plant, None
        for k, sample in enumerate(self.samples(duration)):
            row = (plant.q, plant.qd, plant.q - sample.output.reference.position,
                   sample.output.torque, sample.theta_hat, sample.rank, sample.sigma_min)
            for column, value in zip((*rows[:-1], *rows.measured), (*row, *sample.measured)):
                column[k] = value
            failure = failure or failure_at(sample.t, sample.output.wanted, self.arm.joints,
                                            "law's torque")
            if observer is not None:
                observer(sample)
        return failure

    def samples(self, duration: float) -> Iterator[Sample]:
        """Run for ``duration`` [s] of arm time, the sample at its end included; store nothing.

        Yields:
            Each sample, before the plant moves on.

        Raises:
            SetViolation: the plant is not inside the sets in which the motion begins.
        """
        self.check_start()
        plant, controller, identifier = self.plant, self.controller, self.identifier
        theta, term = self._initial_estimate, np.zeros(self.arm.m)
        estimator = self._set_estimator
        for k in range(self._steps(duration)):
            t = sample_time(k, self.period)
            measured = plant.measure(plant.torque, self.period if k else 0.0)
            output = controller.update(t, measured.q, measured.qd, theta, measured.torque)
            estimate = identifier.update(t, *measured, term)
            term = output.adaptation_term
            if estimator is not None and estimator.observe(t, identifier):
                narrow(controller.safety_filter, estimator.bounds())
            stack = identifier.stack
            yield Sample(t, measured, output, theta, estimate, stack.rank, stack.sigma_min,
                         stack.insertions, identifier.excitation,
                         getattr(identifier, 'external_torque', None))
            theta = theta if self._known else estimate
            plant.apply(output.torque)
            plant.advance(self.period)

    def _steps(self, duration: float) -> int:
        duration = checked_finite('duration', duration, _DURATION)
        if duration < 0.0:
            raise ParameterError('duration', duration, _DURATION)
        return int(round(duration / self.period)) + 1


def _check_period(period: float, identifier: Identifier) -> None:
    """Raise ParameterError where an identifier would restart at every sample."""
    filters: Any = getattr(getattr(identifier, 'settings', None), 'filter', None)
    gap = getattr(filters, 'gap', np.inf)
    if period > gap:
        unit = unit_of_period(period)
        raise ParameterError('period', period, f'a time in s of at most filter.gap = {gap:g} s of '
                             'the identifier, which else restarts at every sample and learns '
                             'nothing' + ('' if unit == 's' else f'; {period:g} {unit} are '
                                          f'{period / UNITS[unit]:g} s'))


def _check_same(name: str, part: Any, what: str, other: Any, arm: Arm) -> None:
    """Raise ParameterError where a part has other joints or parameters than the controller's arm.

    Args:
        name: What the caller calls the part.
        part: The part.
        what: ``joints`` or ``parameters``.
        other: What has them; a plant of a user's own need not.
        arm: The arm of the controller.
    """
    theirs, ours = getattr(other, what, None), getattr(arm, what)
    if theirs is not None and tuple(theirs) != tuple(ours):
        raise ParameterError(name, part, f'one for the arm of the controller, with the {what} '
                             f'{", ".join(ours)} in this order; it has {", ".join(theirs)}')
