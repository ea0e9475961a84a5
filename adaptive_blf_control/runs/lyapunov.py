# SPDX-License-Identifier: Apache-2.0
"""V of Theorem 2 along a recorded run, and its guarantee, where θ* is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from adaptive_blf_control.arms.arm import Arm
from adaptive_blf_control.configuration.build_arm import build_arm
from adaptive_blf_control.configuration.initial_theta import initial_theta
from adaptive_blf_control.configuration.node_settings import (
    ControllerNodeSettings,
    IdentifierNodeSettings,
)
from adaptive_blf_control.configuration.parameter_file import node_settings
from adaptive_blf_control.control.guarantee import guarantee, lyapunov_value
from adaptive_blf_control.errors import BlfError
from adaptive_blf_control.runs.recording import Recording
from adaptive_blf_control.runs.thinning import POINTS

__all__ = ['GuaranteeOverTime', 'arm_of', 'guarantee_of_recording', 'true_over_time']


class GuaranteeOverTime(NamedTuple):
    """Theorem 2 for one run.

    Attributes:
        t: Times, shape (K,) [s].
        v: V (57) at these times, shape (K,).
        bound: V at the last change of θ*, which V must not exceed, shape (K,).
        lower: Lower end of (39) from V(0), shape (n,) [rad].
        upper: Upper end of (39) from V(0), shape (n,) [rad].
    """

    t: np.ndarray
    v: np.ndarray
    bound: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def arm_of(recording: Recording) -> Arm:
    """Build the arm of the run from the parameters in the bag.

    Raises:
        BlfError: the bag has no parameters, no URDF is found in it or where they say, or
            Pinocchio is missing.
    """
    if recording.parameters is None:
        raise BlfError('the bag holds no parameters')
    return build_arm(node_settings(recording.parameters, ControllerNodeSettings),
                     recording.robot_description)


def true_over_time(recording: Recording) -> np.ndarray | None:
    """θ* at the times of ``recording.theta_hat``, shape (K, m); None where it is not known."""
    if recording.run is None or not recording.run.truth or recording.theta_hat is None:
        return None
    return recording.run.theta_true(recording.theta_hat.t)


def guarantee_of_recording(recording: Recording) -> GuaranteeOverTime | None:
    """Return V and its bound, or None where θ*, Γ, the arm or the errors are not known."""
    run, estimates, answered = recording.run, recording.theta_hat, recording.answered
    sets = recording.performance
    if run is None or not run.truth or estimates is None or answered is None or sets is None:
        return None
    try:
        arm = arm_of(recording)
        identifier = node_settings(recording.parameters or {}, IdentifierNodeSettings)
        gamma = identifier.resolved(parameters=arm.m).gamma
        controller = node_settings(recording.parameters or {}, ControllerNodeSettings)
        initial = initial_theta(controller, arm)
        weight = controller.resolved(joints=arm.n).barrier_weight.copy()
    except BlfError:
        return None
    # θ that the controller used: its own value until the first estimate, or always (34).
    at = np.searchsorted(estimates.t, answered.t, side='right') - 1
    if controller.model == 'known':
        at = np.full_like(at, -1)
    known = np.flatnonzero(np.isfinite(answered.e2).all(axis=1)
                           & np.isfinite(answered.q).all(axis=1))
    if arm.parameters != recording.theta_names or known.size == 0:
        return None
    truth = run.theta_true(answered.t[known])
    changed = np.flatnonzero(np.any(np.diff(truth, axis=0) != 0.0, axis=1)) + 1
    picked = np.unique(np.concatenate([
        np.linspace(0, known.size - 1, min(POINTS, known.size)).astype(int), changed]))
    v = np.array([
        lyapunov_value(arm, answered.q[i], answered.e1[i], answered.e2[i], sets,
                       estimates.values[at[i]] if at[i] >= 0 else initial, truth[k], gamma,
                       weight)
        for k, i in zip(picked, known[picked])])
    restart = np.maximum.accumulate(np.where(np.isin(picked, changed), np.arange(v.size), 0))
    nothing = np.zeros(arm.n)
    start = guarantee(float(v[0]), sets, (nothing, nothing), 1.0, weight)
    return GuaranteeOverTime(answered.t[known[picked]], v, v[restart], start.error_lower,
                    start.error_upper)
