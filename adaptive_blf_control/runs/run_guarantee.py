# SPDX-License-Identifier: Apache-2.0
"""A simulated run, whose θ* is known, against what Theorem 2 guarantees for it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from adaptive_blf_control.control.guarantee import (
    Departure,
    Guarantee,
    guarantee,
    GuaranteeMonitor,
    lyapunov_value,
    mass_range,
)
from adaptive_blf_control.control.law import errors
from adaptive_blf_control.control.laws.ablf import AblfLaw
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace
from adaptive_blf_control.simulation.plant import known_truth, truth_of
from adaptive_blf_control.simulation.truth_fit import unexpressed_by

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
    unexpressed = unexpressed_by(plant, parameters)
    if unexpressed is not None:
        return (f'is not about this plant: no theta expresses {100.0 * unexpressed.max():.2g} % '
                'of the torque of a joint')
    return None


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
    truth = known_truth(loop.plant, arm.parameters)
    values, starts, guaranteed = np.empty(trace.t.size), [], []
    monitor: GuaranteeMonitor | None = None
    first: Departure | None = None
    epoch = -1
    for k, t in enumerate(trace.t):
        q, e1 = trace.q[k], trace.e1[k]
        point = controller.reference.at(t)
        e2 = errors(q, trace.qd[k], *point, performance.lower, performance.upper,
                    controller.settings.k1)[1]
        begun = epoch
        while epoch + 1 < len(truth) and t >= truth[epoch + 1][0] - 1e-9:
            epoch += 1
        theta = truth[epoch][1]
        estimate = trace.theta_hat[k] if loop.known is None else loop.known
        values[k] = lyapunov_value(arm, q, e1, e2, performance, estimate, theta, settings.gamma)
        if epoch != begun or monitor is None:
            starts.append(float(t))
            guaranteed.append(_run_guarantee(loop, float(values[k]), theta))
            monitor = GuaranteeMonitor(guaranteed[-1], performance, arm.joints)
        departure = monitor.observe(float(t), e1, float(values[k]))
        first = first or departure
    return RunGuarantee(tuple(starts), tuple(guaranteed), first, values)


def _run_guarantee(loop: ClosedLoop, value: float, theta: np.ndarray) -> Guarantee:
    performance, reference = loop.controller.performance, loop.controller.reference.range()
    rough = guarantee(value, performance, reference, 1.0)
    smallest, _ = mass_range(loop.arm, theta, rough.output_lower, rough.output_upper)
    return guarantee(value, performance, reference, smallest)
