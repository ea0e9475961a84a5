# SPDX-License-Identifier: Apache-2.0
"""A simulated run, whose θ* is known, against what Theorem 2 guarantees for it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.control.barrier import INTERIOR
from adaptive_blf_control.control.guarantee import (
    Departure,
    Guarantee,
    guarantee,
    GuaranteeMonitor,
    lyapunov_along,
    mass_range,
)
from adaptive_blf_control.control.laws.ablf import ablf_gains, AblfLaw
from adaptive_blf_control.control.reference import along, ReferencePoint
from adaptive_blf_control.control.step import AblfGains
from adaptive_blf_control.runs.summary import listed
from adaptive_blf_control.simulation.abilities import unexpressed_by
from adaptive_blf_control.simulation.actuated_arm import ActuatedArm
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace
from adaptive_blf_control.simulation.plant import known_truth, Plant, SimulatedArm, truth_of
from adaptive_blf_control.simulation.sensors import Encoder, NoisyTorque, PerfectSensor

__all__ = ['RunGuarantee', 'guarantee_of_trace', 'why_not']


class RunGuarantee(NamedTuple):
    """What was guaranteed at the start and again at every change of θ*, and whether it was kept.

    Attributes:
        starts: Times of the guarantees [s].
        guaranteed: One guarantee per start.
        first: Where the run first left the guarantee in force, None where it was kept.
        values: V (57) at every sample, shape (N,).
    """

    starts: tuple[float, ...]
    guaranteed: tuple[Guarantee, ...]
    first: Departure | None
    values: np.ndarray

    def figures(self) -> dict[str, Any]:
        """Return the first guarantee and the verdict as plain values for JSON."""
        start = self.guaranteed[0]
        return {
            'V0': start.value, 'U_e1_lower': start.error_lower.tolist(),
            'U_e1_upper': start.error_upper.tolist(), 'e2_norm': start.e2_norm,
            'output_lower': start.output_lower.tolist(),
            'output_upper': start.output_upper.tolist(),
            'V_largest': float(np.max(self.values)), 'V_last': float(self.values[-1]),
            'restarted_at': list(self.starts[1:]), 'left': self.first is not None,
            'message': None if self.first is None else str(self.first)}

    def line(self) -> str:
        """Say in a line of the summary what was guaranteed and whether it was kept."""
        start = self.guaranteed[0]
        part = np.max(np.concatenate([-start.error_lower, start.error_upper]))
        return (f'Theorem 2            V(0) = {start.value:.4g}, so |e1| <= {part:.4g} rad; '
                + ('kept' if self.first is None else f'left: {self.first}'))


def why_not(loop: ClosedLoop) -> str | None:
    """Return why Theorem 2 says nothing about a loop, None where it does."""
    plant, parameters = loop.plant, loop.arm.parameters
    if truth_of(plant, parameters) is None:
        return 'theta* of the plant is not known'
    if not isinstance(loop.controller.law, AblfLaw):
        return 'is not about this law'
    if loop.controller.settings.coupling_reach < INTERIOR:
        return ('is not about this law: its coupling stops growing at '
                f'{loop.controller.settings.coupling_reach:.0%} of the bounds (coupling_reach)')
    if unexpressed_by(plant, parameters) is not None:
        return 'is not about this plant: no theta expresses all of its torque'
    disturbed = _disturbances(plant)
    return (f'is not about this loop: it has {listed(disturbed)}, and the theorem none'
            if disturbed else None)


def _disturbances(plant: Plant) -> list[str]:
    """Return what of the simulated arm the theorem leaves out, in words."""
    if not isinstance(plant, SimulatedArm):
        return []
    sensor = plant.sensor
    inner = type(sensor.sensor if isinstance(sensor, NoisyTorque) else sensor)
    named = ('' if inner is PerfectSensor else 'encoders' if inner is Encoder
             else 'sensors of its own')
    return [words for words, there in (
        ('dead time', plant.settings.dead_time > 0), (named, bool(named)),
        ('noise of the torque', isinstance(sensor, NoisyTorque)),
        ('actuators or forces beside the law', isinstance(plant, ActuatedArm))) if there]


def guarantee_of_trace(loop: ClosedLoop, trace: Trace) -> RunGuarantee | None:
    """Compare a run with Theorem 2, on the true state.

    θ* is constant in the theorem: where it changes, V is taken again as the V(0) of what follows.

    Returns:
        None where `why_not` has a reason.
    """
    controller, settings = loop.controller, loop.identifier.settings
    arm, performance = loop.arm, controller.performance
    if why_not(loop) is not None:
        return None
    t, reference = trace.t, along(controller.reference, trace.t)
    estimates = trace.theta_hat if loop.known is None else np.tile(loop.known, (t.size, 1))
    truth, gains = known_truth(loop.plant, arm.parameters), _gains(loop)
    values, starts, guaranteed = np.empty(t.size), [], []
    first: Departure | None = None
    begins = np.searchsorted(t, [begin - 1e-9 for begin, _ in truth])
    for (_, theta), begin, end in zip(truth, begins, [*begins[1:], t.size]):
        if begin == end:
            continue
        part = slice(begin, end)
        values[part] = lyapunov_along(
            arm, trace.q[part], trace.qd[part], ReferencePoint(*(row[part] for row in reference)),
            performance, gains, estimates[part], theta, settings.gamma)
        starts.append(float(t[begin]))
        guaranteed.append(_run_guarantee(loop, float(values[begin]), theta))
        monitor = GuaranteeMonitor(guaranteed[-1], performance, arm.joints, gains.weight)
        first = first or monitor.observe_along(t[part], trace.e1[part], values[part])
    return RunGuarantee(tuple(starts), tuple(guaranteed), first, values)


def _run_guarantee(loop: ClosedLoop, value: float, theta: np.ndarray) -> Guarantee:
    performance, reference = loop.controller.performance, loop.controller.reference.range()
    weight = _gains(loop).weight
    rough = guarantee(value, performance, reference, 1.0, weight)
    smallest, _ = mass_range(loop.arm, theta, rough.output_lower, rough.output_upper)
    return guarantee(value, performance, reference, smallest, weight)


def _gains(loop: ClosedLoop) -> AblfGains:
    return ablf_gains(loop.controller.settings.resolved(joints=loop.arm.n))
