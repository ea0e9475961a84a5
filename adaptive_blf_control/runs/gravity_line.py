# SPDX-License-Identifier: Apache-2.0
"""Whether gravity as told fits the first moments of a run (`identification.gravity_check`)."""

from __future__ import annotations

from adaptive_blf_control.identification.gravity_check import gravity_check_of, GravityMisfit
from adaptive_blf_control.simulation.closed_loop import ClosedLoop, Trace

__all__ = ['gravity_line', 'gravity_misfit']


def gravity_misfit(loop: ClosedLoop, trace: Trace) -> GravityMisfit | None:
    """Return what the measured torques of a run say against the gravity that was told, or None."""
    check = gravity_check_of(loop.arm)
    if check is None:
        return None
    for t, q, qd, torque in zip(trace.t.tolist(), *trace.measured):
        if check.take(t, q, qd, torque) or not check.watching:
            break
    return check.misfit


def gravity_line(misfit: GravityMisfit) -> str:
    """Return the line of the table."""
    return f'gravity              at {misfit.t:.3f} s: {misfit.text()}'
